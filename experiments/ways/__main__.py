"""Do ways lead through any rooms, and does no joint get into a wall? python -m experiments.ways --clips FOLDER"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import multiprocessing
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import torch
import yaml

from experiments.report import markdown, origin, read_table, words
from experiments.ways.judge import Shortest, judge, read_walk
from experiments.ways.scenes import HALF_WIDTH, SCENES, Data, Pair, pairs
from hopdiff.cli import main as hopdiff
from hopdiff.io.files import write_whole

HERE = Path(__file__).parent
CLIP, UNIT = "wander_snu_93s_30hz.bvh", 0.01  # 93 s of one person walking about, in centimetres
SEED = 7
BUSY = 2  # processes that keep the machine busy
INSIDE = 0.01  # m that a joint may be inside a wall
KEPT = (
    *("scene", "pair", "found", "shortest", "length", "detour", "depth", "deepest", "inside", "off", "off_deg"),
    *("fastest", "bend_deg", "expansions", "seconds", "digest", "said"),
)
Row = dict[str, Any]


def walk(clip: Path, scene: Path, pair: Pair, folder: Path) -> tuple[Path | None, str]:
    """Run the command; the walk that it wrote, or None and what it said."""
    start, goal = (f"[{','.join(map(str, place))}]" for place in (pair.start, pair.goal))
    words = [f"clips=['{clip}']", f"scene={scene}", f"start={start}", f"goal={goal}", "pictures=false"]
    sys.argv = ["hopdiff", "+experiment=navigate", *words, f"hydra.run.dir={folder}"]
    said = io.StringIO()
    with redirect_stdout(io.StringIO()), redirect_stderr(said):
        status = hopdiff()
    return (folder / "walk.bvh", "") if status == 0 else (None, said.getvalue().strip().splitlines()[-1])


def measured(clip: Path, unit: float, scene: Path, data: Data, shortest: Shortest, pair: Pair) -> Row:
    """One way, found and judged from its file."""
    row: Row = {"shortest": shortest.length(pair.start[:2], pair.goal[:2])}
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        file, said = walk(clip, scene, pair, Path(folder) / "run")
        row |= {"seconds": time.perf_counter() - begun, "said": said, "found": int(file is not None)}
        if file is None:
            return row
        metrics = json.loads((file.parent / "metrics.json").read_text(encoding="utf-8"))
        row |= {name: metrics[name] for name in ("expansions", "bend_deg")}
        row |= vars(judge(read_walk(file, unit), data, pair))
        row["detour"] = row["length"] / row["shortest"]
        row["digest"] = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    return row


def _spin() -> None:
    while True:
        pass


@contextmanager
def busy(count: int) -> Iterator[None]:
    """A machine on which other processes run all the time."""
    others = [multiprocessing.Process(target=_spin, daemon=True) for _ in range(count)]
    for other in others:
        other.start()
    try:
        yield
    finally:
        for other in others:
            other.terminate()
            other.join()


def study(clip: Path, unit: float, names: Sequence[str], count: int, loaded: int, table: Path) -> list[Row]:
    """All pairs of all scenes, those left out that the table has; and the first ones again on a busy machine."""
    rows: list[Row] = [*read_table(table)]
    done = {(row["scene"], row["pair"]) for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            data = SCENES[name]()
            scene = Path(folder) / f"{name}.yaml"
            scene.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
            shortest = Shortest(data, HALF_WIDTH)
            drawn = pairs(data, count, SEED)
            cases = [(str(k), pair, 0) for k, pair in enumerate(drawn)]
            cases += [(f"{k} busy", pair, BUSY) for k, pair in enumerate(drawn[:loaded])]
            for label, pair, others in cases:
                if (name, label) in done:
                    continue
                with busy(others):
                    row = measured(clip, unit, scene, data, shortest, pair)
                rows.append({"scene": name, "pair": label, **row})
                _keep(table, rows)
    return rows


def _keep(table: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, KEPT, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: f"{value:.5g}" if isinstance(value, float) else value for name, value in row.items()})
    write_whole(table, text.getvalue())


def report(rows: Sequence[Mapping[str, Any]], clip: str) -> str:
    """The tables, as Markdown."""
    free = [row for row in rows if "busy" not in row["pair"]]
    names = list(dict.fromkeys(row["scene"] for row in free))
    found = [row for row in free if int(row["found"])]
    lines = [
        f"Clip: {clip}. Detour: length of the root's way over the shortest one for a body .5 m wide. Deepest: of any",
        "joint or end site in a wall or furniture, over all frames. Off: of the root at start and goal.",
        "",
        markdown(
            (
                "scene",
                "found",
                "detour (median)",
                "largest",
                "deepest cm",
                "off mm",
                "deg",
                "m/s",
                "s (median)",
                "most",
            ),
            [_line(name, [row for row in free if row["scene"] == name]) for name in names] + [_line("all", free)],
        ),
        "## On a busy machine",
        "",
        markdown(("scene", "ways", "the same file"), _busy(rows, names)),
        "## Bars",
        "",
    ]
    detours = [float(row["detour"]) for row in found]
    again = [int(line[1]) == int(line[2]) for line in _busy(rows, names)]
    bars = (
        ("98 of 100 found", f"{len(found)} of {len(free)}", len(found) >= 0.98 * len(free)),
        ("detour, median, 1.1 at most", *_median(detours, 1.1)),
        ("no joint deeper than 1 cm", *_most([float(row["depth"]) for row in found], INSIDE)),
        ("the same on a busy machine", f"{sum(again)} of {len(again)} scenes", all(again)),
    )
    lines.append(markdown(("bar", "measured", "met"), [(*bar[:2], "yes" if bar[2] else "**no**") for bar in bars]))
    missed = [f"- {row['scene']}, pair {row['pair']}: {row['said']}" for row in free if not int(row["found"])]
    lines += ["## Not found", "", *(missed or ["None."]), ""]
    return "\n".join(lines)


def _median(values: Sequence[float], most: float) -> tuple[str, bool]:
    middle = statistics.median(values) if values else float("nan")
    return f"{middle:.3f}", middle <= most


def _most(values: Sequence[float], limit: float) -> tuple[str, bool]:
    largest = max(values, default=float("nan"))
    return f"{100.0 * largest:.2f} cm", largest <= limit


def _line(name: str, rows: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    found = [row for row in rows if int(row["found"])]
    seconds = [float(row["seconds"]) for row in rows]

    def column(key: str) -> list[float]:
        return [float(row[key]) for row in found] or [float("nan")]

    return (
        name,
        f"{len(found)} of {len(rows)}",
        f"{statistics.median(column('detour')):.3f}",
        f"{max(column('detour')):.2f}",
        f"{100.0 * max(column('depth')):.2f}",
        f"{1000.0 * max(column('off')):.3f}",
        f"{max(column('off_deg')):.3f}",
        f"{max(column('fastest')):.2f}",
        f"{statistics.median(seconds):.1f}",
        f"{max(seconds):.1f}",
    )


def _busy(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Of every scene, ways that were made again on a busy machine, and how many came out as before."""
    own = {(row["scene"], row["pair"]): row.get("digest", "") for row in rows}
    lines = []
    for name in names:
        again = {pair: digest for (scene, pair), digest in own.items() if scene == name and "busy" in pair}
        same = sum(own.get((name, pair.split()[0])) == digest for pair, digest in again.items())
        lines.append((name, str(len(again)), str(same)))
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.ways", description=__doc__)
    parser.add_argument("--clips", type=Path, required=True, help=f"folder with {CLIP}, or one file")
    parser.add_argument("--unit", type=float, default=UNIT, help="metres in a unit of the file")
    parser.add_argument("--scenes", type=words, default=list(SCENES))
    parser.add_argument("--pairs", type=int, default=25, help="in each scene")
    parser.add_argument("--busy", type=int, default=5, help="of them, made again on a busy machine")
    parser.add_argument(
        "--out", type=Path, default=HERE, help="folder for results.md and ways.csv, which is gone on with"
    )
    typed = list(sys.argv[1:] if arguments is None else arguments)
    given = parser.parse_args(typed)
    made = origin("ways", typed)
    torch.set_num_threads(1)
    given.out.mkdir(parents=True, exist_ok=True)
    clip = given.clips / CLIP if given.clips.is_dir() else given.clips
    rows = study(clip, given.unit, given.scenes, given.pairs, given.busy, given.out / "ways.csv")
    text = f"{made}\n\n{report(rows, clip.stem)}"
    write_whole(given.out / "results.md", text)
    print(text)


if __name__ == "__main__":
    main()
