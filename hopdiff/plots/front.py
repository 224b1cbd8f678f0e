"""One stride from behind: how far the body leans to a side, and how long each leg carries."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from hopdiff.motion import Motion, Phase
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.poses import sample, steps
from hopdiff.plots.scene import draw_seen, footprints
from hopdiff.plots.view import Array, Camera

_WIDTH = 15.0  # inches
_GAP = 0.22  # metres between neighbours
_ABOVE = 0.28  # metres of paper over the highest head, for the angle
_HEAD, _BELOW = 0.5, 1.15  # inches for the title and for what stands under the figures
_TRUNK = "#FFFFFF"
_MARK = style.SERIES[2]


@dataclass(frozen=True)
class _View:
    """One drawn moment. points: (J + E, 3) with the middle of the feet's tracks as origin; name: what happens."""

    name: str
    time: float
    step: int
    points: Array


def front_figure(motion: Motion, title: str = "") -> Figure:
    """The first stride of a motion from behind, left on the left: four poses of each step in true proportions.

    From behind, since nothing hides the trunk there and left stays left. The dashed line stands over the middle
    between the tracks of both feet; the white line is the trunk, waist to neck; the number is its lean in degrees.
    """
    body = Body(motion.clip.skeleton)
    stride = steps(motion)[:2]
    views, camera = _views(motion, body, stride)
    seen = [camera.project(view.points)[:, :2] for view in views]
    reach = max(float(np.abs(flat[:, 0]).max()) for flat in seen) + 0.06
    pitch = 2 * reach + _GAP
    wide = pitch * len(views) + _GAP
    top = max(float(flat[:, 1].max()) for flat in seen) + _ABOVE
    tall = _WIDTH * top / wide
    height = _HEAD + tall + _BELOW
    figure = style.new_figure(_WIDTH, height, layout=None)
    line = 1 - 0.5 * _HEAD / height
    text = title or "One stride from behind"
    figure.text(0.02, line, text, va="center", fontsize=13, fontweight="bold", color=style.INK)
    note = "dashed: middle between the feet; white: trunk, with its lean to the left or right"
    figure.text(0.98, line, note, ha="right", va="center", fontsize=9, color=style.GROUND)
    axes = figure.add_axes((0.0, _BELOW / height, 1.0, tall / height))
    axes.set(xlim=(0.0, wide), ylim=(0.0, top))
    axes.axis("off")
    axes.plot((0, wide), (0, 0), color=style.GROUND, linewidth=2.0, clip_on=False, zorder=2)
    names = [*body.joint_names]
    for order, (view, flat) in enumerate(zip(views, seen, strict=True)):
        centre = _GAP / 2 + pitch * (order + 0.5)
        draw_seen(axes, body, view.points, camera, np.array([centre, 0.0]))
        axes.plot((centre, centre), (0, top - 0.55 * _ABOVE), "--", color=_MARK, linewidth=1.3, zorder=5)
        trunk = flat[[names.index(name) for name in ("waist", "neck")]]
        axes.plot(centre + trunk[:, 0], trunk[:, 1], color=_TRUNK, linewidth=1.8, zorder=6, solid_capstyle="round")
        axes.text(centre, top - 0.3 * _ABOVE, _lean(trunk[-1] - trunk[0]), ha="center", fontsize=9, color=_MARK)
        _label(axes, centre, view, stride[view.step][0].side)
    for number, step in enumerate(stride):
        places = [_GAP / 2 + pitch * (order + 0.5) for order, view in enumerate(views) if view.step == number]
        _bracket(axes, places[0] - reach, places[-1] + reach, step)
    return figure


def _views(motion: Motion, body: Body, stride: list[tuple[Phase, ...]]) -> tuple[list[_View], Camera]:
    """The poses to draw, moved to the middle between the feet, and the camera behind the run."""
    times = motion.times.detach().cpu().double().numpy()
    moments = []
    for number, step in enumerate(stride):
        carried, flown = step[0], step[-1]
        middle, apex = 0.5 * (carried.start + carried.end), 0.5 * (flown.start + flown.end)
        pairs = (
            ("touchdown", carried.start),
            ("mid-stance", middle),
            ("take-off", carried.end),
            ("middle of flight", apex),
        )
        moments += [(name, time, number) for name, time in pairs]
    poses = sample(times, body.points(motion.clip), [time for _, time, _ in moments])
    start, end = (poses[0, 0], sample(times, body.points(motion.clip), [stride[-1][-1].end])[0, 0])
    heading = math.atan2(end[0] - start[0], end[2] - start[2])
    camera = Camera(heading + math.pi)
    left = camera.axes[0] * np.array([1.0, 0.0, 1.0])
    prints = footprints(motion)[:2]
    # Of the ground only what lies across the run is taken off: along it the camera sees nothing.
    middle_of_feet = np.mean([step.place @ left for step in prints]) if prints else 0.0
    poses = poses - middle_of_feet * left
    return [_View(*moment, pose) for moment, pose in zip(moments, poses, strict=True)], camera


def _lean(trunk: Array) -> str:
    """A direction (2,) in the picture as an angle from the upright."""
    angle = math.degrees(math.atan2(trunk[0], trunk[1]))
    if abs(angle) < 0.05:
        return "0.0\u00b0"
    return f"{abs(angle):.1f}\u00b0 {'right' if angle > 0 else 'left'}"


def _label(axes: Axes, x: float, view: _View, side: str) -> None:
    lines = ((view.name, 0.18, 9.5, style.SIDE_COLOURS[side]), (f"{view.time:.2f} s", 0.36, 8.5, style.GROUND))
    for text, inches, size, ink in lines:
        _below(axes, x, text, inches, size, ink)


def _below(axes: Axes, x: float, text: str, inches: float, size: float, ink: str, weight: str = "normal") -> None:
    axes.annotate(
        text,
        (x, 0),
        (0, -72 * inches),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=size,
        color=ink,
        fontweight=weight,
        annotation_clip=False,
    )


def _bracket(axes: Axes, low: float, high: float, step: tuple[Phase, ...]) -> None:
    """A line under the poses of a step, and how long its leg carries."""
    carried, flown = step[0], step[-1]
    colour = style.SIDE_COLOURS[carried.side]
    lower = ScaledTranslation(0.0, -0.58, axes.figure.dpi_scale_trans)
    axes.plot((low, high), (0, 0), color=colour, linewidth=2.0, transform=axes.transData + lower, clip_on=False)
    text = f"the {carried.side} leg carries for {carried.end - carried.start:.3f} s"
    _below(axes, (low + high) / 2, text, 0.78, 11.0, colour, "bold")
    _below(axes, (low + high) / 2, f"then {flown.end - flown.start:.3f} s in the air", 0.98, 9.0, style.GROUND)
