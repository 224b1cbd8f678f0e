"""Do finished runs look like people running, and does briskness do what it says? python -m experiments.realism"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

import hopdiff
from experiments.realism.picture import briskness_figure, curves_figure
from experiments.realism.runs import MODEL, captured, found, made
from experiments.realism.tables import read_rows, report, write_rows
from experiments.report import floats, integers, words
from hopdiff.io.files import write_whole
from hopdiff.io.record import git_state
from hopdiff.plots.save import save_figure

HERE = Path(__file__).parent
KEEP = Path("outputs") / "realism"
FOLDERS = ("--runs", "--clips", "--keep", "--out")  # what lies where on a machine is left out of the results


def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    options = parser().parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.redraw:
        entries, (*origin, notes) = read_rows(options.out)
        missing = [note for note in notes.removeprefix("Left out: ").split(" | ") if note]
    else:
        if options.runs:
            entries, missing = found(options.runs)
        else:
            chosen = {name: value for name, value in vars(options).items() if name in ("model", "evaluations")}
            asked = (options.costs, options.speeds, options.betas, options.seeds)
            entries, missing = made(*asked, options.keep, options.processes, chosen)
        clips, absent = captured(options.clips)
        entries, missing = [*entries, *clips], [*missing, *absent]
        origin = [f"commit {commit()}", f"`{command(arguments)}`"]
        write_rows(options.out, entries, [*origin, f"Left out: {' | '.join(missing)}"])
    text = report(entries, missing, origin)
    write_whole(options.out / "results.md", text)
    save_figure(curves_figure(entries), options.out / "curves.png", dpi=100)
    save_figure(briskness_figure(entries), options.out / "briskness.png", dpi=100)
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.realism", description=__doc__)
    parser.add_argument("--speeds", type=floats, default=[2.5, 3.5, 4.5, 6], help="m/s")
    parser.add_argument("--betas", type=floats, default=[0.2, 0.35, 0.5, 0.7])
    parser.add_argument("--seeds", type=integers, default=[0])
    parser.add_argument("--costs", type=words, default=["human", "effort"], help="names of files in conf/costs/")
    parser.add_argument("--model", default=MODEL, help="another one, to compare with")
    parser.add_argument("--evaluations", type=int, default=argparse.SUPPRESS, help="another budget than the default")
    parser.add_argument("--processes", type=int, default=1, help="runs side by side")
    parser.add_argument("--runs", type=Path, help="folder of runs that exist: no searches")
    parser.add_argument("--keep", type=Path, default=KEEP, help="folder for the runs that are made")
    parser.add_argument("--clips", type=Path, help="folder of captured BVH files")
    parser.add_argument("--redraw", action="store_true", help="only tables and pictures again, from the CSV files")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md, CSV files and pictures")
    return parser


def command(arguments: Sequence[str]) -> str:
    """The command as typed, without the places of folders."""
    shown = ["FOLDER" if before in FOLDERS else word for before, word in zip(("", *arguments), arguments, strict=False)]
    return shlex.join(["python", "-m", "experiments.realism", *shown])


def commit() -> str:
    """Of this checkout, and whether files differ from it."""
    state = git_state(Path(hopdiff.__file__).parent)
    if not state["checkout"]:
        return "unknown: no checkout"
    return f"{state['commit'][:12]}{', with changes' if state['dirty'] else ''}"


if __name__ == "__main__":
    main()
