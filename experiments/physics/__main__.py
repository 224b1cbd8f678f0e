"""Do runs obey the laws of motion? python -m experiments.physics"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

from experiments.physics.captured import read_clip
from experiments.physics.check import check
from experiments.physics.making import FRAME_RATE, OWN_RATES, made_with, make
from experiments.physics.momentum import analyse
from experiments.physics.picture import momentum_figure
from experiments.physics.recording import UnfitError, read_recording
from experiments.physics.tables import CAPTURED, FILE, GROUND, LEFT_OVER, Row, by_axis, label, misses, table, verdicts
from experiments.report import floats, integers, read_table, words
from hopdiff.io.files import read_text, write_whole
from hopdiff.io.record import git_state, write_table
from hopdiff.plots.save import save_figure
from hopdiff.types import HopdiffError

HERE = Path(__file__).parent
TEXT = ("kind", "run", "model")
PICTURED = (3.5, 0.2)  # m/s and briskness of the run in the picture, if it is among them

FOLDERS = ("--runs", "--clips", "--made", "--out")


def main(arguments: Sequence[str] | None = None) -> None:
    options = parser().parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    source, results = options.out / "runs.csv", options.out / "results.md"
    if options.redraw:
        rows, said = read_rows(source), read_text(results).partition("\n\n")[2].partition("\n## ")[0]
    else:
        rows, left_out = measure(options)
        columns = list(dict.fromkeys((*TEXT, "speed", "beta", "seed", *(name for row in rows for name in row))))
        write_table(source, columns, ([_cell(row.get(name)) for name in columns] for row in rows))
        said = circumstances(sys.argv[1:] if arguments is None else arguments, options, left_out)
    text = report(rows, said)
    write_whole(results, text)
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.physics", description=__doc__)
    parser.add_argument("--speeds", type=floats, default=[2, 3.5, 5, 8], help="m/s")
    parser.add_argument("--betas", type=floats, default=[0.2, 0.5, 0.7])
    parser.add_argument("--seeds", type=integers, default=[0, 1, 2])
    parser.add_argument("--models", type=words, default=["body", "smooth", "thesis"])
    parser.add_argument("--clips", type=Path, help="folder of captured BVH files, for comparison")
    parser.add_argument(
        "--runs", type=Path, help="folder with NumPy archives of runs to be checked; nothing is searched"
    )
    parser.add_argument("--made", type=Path, default=Path("outputs/physics"), help="folder for the runs that are made")
    parser.add_argument("--evaluations", type=int, default=argparse.SUPPRESS, help="another budget than the default")
    parser.add_argument("--processes", type=int, default=1, help="runs side by side")
    parser.add_argument("--redraw", action="store_true", help="only the tables again, from runs.csv")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for runs.csv, results.md and momentum.png")
    return parser


def measure(options: argparse.Namespace) -> tuple[list[Row], list[str]]:
    """One row a run, and sentences on those left out. Draws the picture of one of them."""
    rows: list[Row] = []
    left_out: list[str] = []
    paths: list[Path] = []
    if options.runs is not None:
        asked = [(path,) for path in sorted(options.runs.rglob("*.npz"))]
        found = map(checked, *zip(*asked, strict=True)) if asked else ()
        pool = None
    else:
        runs = product(options.models, options.speeds, options.betas, options.seeds)
        asked = [(*run, options.made, chosen(options)) for run in runs]
        pool = ProcessPoolExecutor(options.processes)
        found = pool.map(searched, *zip(*asked, strict=True))
    for row, path in found:
        if path is None:
            left_out.append(str(row["reason"]))
        else:
            rows.append(row)
            paths.append(path)
        print(row["reason"] if path is None else label(row), flush=True)
    if pool is not None:
        pool.shutdown()
    if rows:
        draw(rows, paths, options.out)
    clips, reasons = captured(options.clips)
    return rows + clips, left_out + reasons


def chosen(options: argparse.Namespace) -> dict[str, int]:
    """What is asked of the search beyond its defaults."""
    return {name: value for name, value in vars(options).items() if name == "evaluations"}


def searched(
    model: str, speed: float, beta: float, seed: int, folder: Path, chosen: dict[str, int]
) -> tuple[Row, Path | None]:
    """Make a run and check it; without a path, the row says why there is none."""
    try:
        path = make(model, speed, beta, seed, folder, chosen)
    except HopdiffError as error:
        return {"reason": f"{model} {speed:g} m/s, beta {beta:g}, seed {seed}: {error}"}, None
    return checked(path, {"model": model, "speed": float(speed), "beta": float(beta), "seed": float(seed)})


def checked(path: Path, asked: Row | None = None) -> tuple[Row, Path | None]:
    """The row of a run in a file. asked: what it was made as; else its own numbers say so."""
    try:
        recording = read_recording(path)
    except UnfitError as error:
        return {"reason": f"{path.parent.name}: {error}"}, None
    if asked is None:
        own = recording.numbers
        asked = {name: float(own[name]) for name in ("speed", "beta", "seed") if isinstance(own.get(name), int | float)}
        asked = {"model": str(own.get("model", "unknown")), **(asked if len(asked) == 3 else {})}
    return {"kind": "run", "run": recording.name, **asked, **check(recording)}, path


def captured(folder: Path | None) -> tuple[list[Row], list[str]]:
    """Rows of the captured clips that run, and why others are left out."""
    if folder is None:
        return [], []
    rows: list[Row] = []
    left_out = [] if folder.is_dir() else [f"There is no folder {folder.name}."]
    for path in sorted(folder.glob("*.bvh")):
        try:
            rows.append({"kind": "clip", "run": path.stem, "model": "captured", **check(read_clip(path))})
        except UnfitError as error:
            left_out.append(f"{error}")
    return rows, left_out


def draw(rows: Sequence[Row], paths: Sequence[Path], out: Path) -> None:
    """The picture of the first run of the first model, at the usual speed and briskness if there is one."""
    usual = [k for k, row in enumerate(rows) if (row.get("speed"), row.get("beta")) == PICTURED]
    first = usual[0] if usual else 0
    found = analyse(read_recording(paths[first]))
    save_figure(momentum_figure(found, label(rows[first])), out / "momentum.png", dpi=110)


def circumstances(arguments: Sequence[str], options: argparse.Namespace, left_out: Sequence[str]) -> str:
    """Commit, command, objective and priors of the runs, and what was left out."""
    state = git_state(HERE)
    commit = f"`{state['commit']}`{' with changes' if state.get('dirty') else ''}" if state.get("commit") else "unknown"
    # What lies where on a machine is left out.
    shown = ["FOLDER" if before in FOLDERS else word for before, word in zip(("", *arguments), arguments, strict=False)]
    lines = [f"Commit {commit}; `{shlex.join(['python', '-m', 'experiments.physics', *shown])}`.", ""]
    if options.runs is not None:
        lines += ["The runs were there already; those of this version are made with these settings.", ""]
    for model in options.models:
        try:
            lines.append(
                f"- {model}, at {OWN_RATES.get(model, FRAME_RATE):g} frames/s: {made_with(model, chosen(options))}."
            )
        except Exception:  # Hydra's; why there are no such runs is told below
            lines.append(f"- {model}: not a model of this version.")
    lines += ["", "Left out:" if left_out else "Nothing was left out.", ""]
    return "\n".join([*lines, *(f"- {reason}" for reason in left_out)]).rstrip() + "\n"


def report(rows: Sequence[Row], said: str) -> str:
    """Markdown: bars with the runs that miss them, then every table."""
    runs = [row for row in rows if row["kind"] == "run"]
    clips = [row for row in rows if row["kind"] == "clip"]
    lines = [f"# Physics: {len(runs)} runs, {len(clips)} captured clips\n", said]
    if runs:
        lines += ["## Bars\n", verdicts(runs), "## Runs that miss a bar\n", misses(runs)]
        lines += ["## What is left over\n", "Worst of the seeds.\n", table(runs, LEFT_OVER)]
        lines += ["## The ground and the feet\n", "Worst of the seeds.\n", table(runs, GROUND)]
        lines += [
            "## By axis\n",
            "x to the left, y up, z ahead; root mean square / maximum, worst of the seeds.\n",
            by_axis(runs),
        ]
        lines += ["## The files\n", table(runs, FILE)]
    if clips:
        lines += ["## Captured clips\n", "Rough: see the README.\n", table(clips, CAPTURED)]
    return "\n".join(lines)


def read_rows(path: Path) -> list[Row]:
    """The rows of runs.csv; what was not known is not in them."""
    return [
        {name: cell if name in TEXT else float(cell) for name, cell in row.items() if cell != ""}
        for row in read_table(path)
    ]


def _cell(value: str | float | None) -> str | None:
    return value if value is None or isinstance(value, str) else format(value, ".6g")


if __name__ == "__main__":
    main()
