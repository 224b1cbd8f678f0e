"""Writing an edit into its folder, and telling the user about it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from hopdiff.export.tables import write_npz
from hopdiff.export.take import Take
from hopdiff.export.write import plain
from hopdiff.feet.contacts import contact_points
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import write_bvh
from hopdiff.io.events import write_events
from hopdiff.io.record import write_json
from hopdiff.joins.files import together
from hopdiff.messages import plural
from hopdiff.plots.edit import edit_figure
from hopdiff.plots.feet import feet_figure
from hopdiff.plots.sticks import sticks_figure
from hopdiff.tasks.edit_job import Edit
from hopdiff.tasks.edit_join import seam_rows
from hopdiff.tasks.edit_request import Request
from hopdiff.tasks.results import Figures, shown, write_pictures
from hopdiff.terrain.ground import Ground

CURVE_SPACING = 0.02  # m between the points of a drawn curve
FEWEST_DRAWN = 5  # frames of a path that is drawn: fewer have no style to show


def write_edit(folder: Path, edit: Edit, request: Request, settings: Mapping[str, Any], ground: Ground) -> None:
    """Write everything an edit leaves behind. settings: the whole configuration as plain data. ground: to be drawn.

    Raises HopdiffError if a file cannot be written, or the motion does not fit the channels of its file.
    """
    source = edit.source
    if source.file is None:
        write_bvh(folder / "edited.bvh", edit.clip)
    elif edit.neighbours is not None:
        together(source.file, edit.clip, edit.neighbours).write(folder / "edited.bvh")
    else:
        source.file.with_motion(edit.clip).write(folder / "edited.bvh")
    if source.known and edit.planted is not None:
        # Exports then need not find out again when feet stand.
        name = f"{plain(Path(source.name).stem)}_edited"
        write_npz(folder / "motion.npz", Take.of_clip(name, edit.clip, edit.metrics, edit.planted.touching))
    write_json(folder / "metrics.json", edit.metrics)
    pictures = write_pictures(folder, edit_figures(edit, request, ground)) if settings["pictures"] else {}
    numbers = {name: float(value) for name, value in edit.metrics.items() if isinstance(value, float)}
    write_events(folder, results=numbers, pictures=pictures)


def edit_figures(edit: Edit, request: Request, ground: Ground) -> Figures:
    source = edit.source
    clip = source.clip
    curve = None
    if request.curve is not None:
        count = max(2, round(request.curve.length / CURVE_SPACING))
        curve = request.curve.position(torch.linspace(0.0, request.curve.length, count, dtype=torch.float64)).numpy()
    seams = edit.metrics.get("seam_frames", ())
    figures: Figures = {"strip": lambda: sticks_figure(edit.clip, before=clip, curve=curve, ground=ground, seams=seams)}
    if clip.frames >= FEWEST_DRAWN:
        path = edit.solved.path
        figures["path"] = lambda: edit_figure(
            source.path, path, edit.constraints, clip.frame_time, curve, ground=ground
        )
    if source.contacts is not None:
        contacts = source.contacts
        stages = {"source": clip, "edited": edit.moved, "cleaned": edit.clip}
        points = {name: contact_points(stage, contacts) for name, stage in stages.items()}
        figures["feet"] = lambda: feet_figure(
            torch.arange(clip.frames) * clip.frame_time,
            contacts.names,
            contacts.touching,
            {name: _speed(place, clip) for name, place in points.items()},
            {name: place[..., 1] for name, place in points.items()},
        )
    return figures


def _speed(points: torch.Tensor, clip: Clip) -> torch.Tensor:
    """(T, P) horizontal speed of points (T, P, 3) [m/s]."""
    moved = points[..., [0, 2]].diff(dim=0).norm(dim=-1) / clip.frame_time
    return torch.cat((moved[:1], moved))


def edit_summary(folder: Path, edit: Edit) -> str:
    """The table at the end of an edit."""
    m = edit.metrics
    rows = [
        ("clip", f"{m['clip']}, {m['frames']} frames" + (f", {m['repeats']} strides" if m["repeats"] > 1 else "")),
        (
            "edited",
            f"{plural(m['constraints'], 'frame')} bound, {plural(m['rounds'], 'round')};"
            f" {1000 * m['error_place']:.2f} mm and {m['error_yaw_deg']:.3f} deg off",
        ),
        (
            "",
            f"way {m['path_length_before']:.2f} to {m['path_length']:.2f} m (x {m['stretch']:.2f}), side-slip"
            f" {m['side_slip_p95_deg']:.1f} deg, turns up to {m['turn_max_deg']:.1f} deg in 1/30 s",
        ),
    ]
    if "slide_speed_source" in m:
        stages = ("source", "edited", "cleaned")
        slides = ", ".join(f"{100 * m[f'slide_speed_{stage}']:.1f}" for stage in stages)
        drifts = ", ".join(f"{100 * m[f'drift_{stage}']:.1f}" for stage in stages)
        rows.append(("feet", f"slide {slides} cm/s, drift {drifts} cm (source, edited, cleaned)"))
    rows += seam_rows(m)
    rows.append(("took", f"{m['ms_set_up'] + m['ms_solve']:.1f} ms for the path, {m['ms_all']:.0f} ms in all"))
    rows += [("note", warning) for warning in edit.warnings]
    rows.append(("files", shown(folder)))
    return "\n".join(f"{name:<9} {text}" for name, text in rows)
