"""The pictures and TensorBoard events of a comparison; apart, so that only who makes them loads what draws them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hopdiff.io.events import FINAL, Columns, write_events
from hopdiff.plots.compare import choose, compare_figures
from hopdiff.plots.save import save_figure
from hopdiff.plots.scaled import can_scale, scaled_convergence_figure
from hopdiff.runs.folders import RunRecord


def draw(folder: Path, records: Sequence[RunRecord], settings: Mapping[str, Sequence[Any]]) -> list[str]:
    """Draw runs that have their series, and write events with the pictures in them.

    settings: columns of the HParams table that the runs' own folders have the rows of, with their values; if there are
    none, it gets no columns from here. Returns a sentence for everything that is not drawn. Raises HopdiffError if a
    file cannot be written.
    """
    chosen = choose(records)
    figures = compare_figures(chosen)
    if can_scale(chosen.records):
        figures["scaled"] = scaled_convergence_figure(chosen.records)
    pictures = {name: folder / f"{name}.png" for name in figures}
    for name, figure in figures.items():
        save_figure(figure, pictures[name])
    reached = [name for name in FINAL if any(name in record.metrics for record in records)]
    write_events(folder, pictures=pictures, columns=Columns(settings, reached) if settings else None)
    return chosen.sentences
