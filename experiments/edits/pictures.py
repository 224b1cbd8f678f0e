"""Strips of the edits that miss most, to be looked at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from experiments.edits.judge import BARS
from experiments.edits.study import ENDS, FILE, Result
from hopdiff.io.bvh import read_bvh
from hopdiff.plots.save import save_figure
from hopdiff.plots.sticks import sticks_figure


def badness(result: Result) -> float:
    """How far an edit misses its worst bar, in bars; frame 0 and the last pose aside, which look well."""
    if result.verdict is None:
        return math.inf
    missed = {name: value for name, value in result.verdict.failed.items() if name not in ENDS}
    return max((value / BARS[name] for name, value in missed.items()), default=0.0)


def draw_worst(results: Sequence[Result], count: int, out: Path) -> list[Path]:
    """Pictures of the worst edits that there is something to see of, the worst first; returns their files."""
    shown = [result for result in results if result.verdict is not None and badness(result) > 0.0]
    files = []
    for place, result in enumerate(sorted(shown, key=badness, reverse=True)[:count], start=1):
        source = read_bvh(result.file)
        edited = read_bvh(result.folder / FILE, source.unit, source.up)
        title = f"{result.clip}, {result.kind}"
        path = out / f"worst_{place:02d}.png"
        save_figure(sticks_figure(edited.clip(), before=source.clip(), title=title), path)
        files.append(path)
    return files
