"""Joint angles over a stride."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.view import Array, numbers

# Curve, what turns, and which way is positive.
PANELS = (
    ("hip", "thigh", "forward of the vertical"),
    ("knee", "knee", "flexion"),
    ("ankle", "ankle", "toes up, 0 at a right angle"),
    ("trunk", "trunk", "forward of the vertical"),
    ("shoulder", "upper arm", "forward of the trunk"),
    ("elbow", "elbow", "flexion"),
)
LEAST_SPAN = 40.0  # degrees of an axis: what hardly moves shall look so
_TICK = 20.0  # degrees
_DEGREES = 48.0  # in an inch, in every panel
_WIDTH, _AROUND, _BETWEEN = 9.0, 1.5, 0.34  # inches


def angles_figure(motion: Motion, title: str = "") -> Figure:
    """Thigh, knee, ankle, trunk, upper arm and elbow over the stride in degrees, all in one scale.

    Curves go through the frames of the motion: with frames a millisecond apart they are smooth. A joint that the
    motion has no curve of gets no panel. Stances are tinted in their leg's colour from touchdown to take-off.
    title: stands before the name of the picture.
    """
    times = numbers(motion.times)
    shown = [(name, sense, found) for joint, name, sense in PANELS if (found := _curves(motion, joint))]
    ends = [_ends(curves) for _, _, curves in shown]
    heights = [(high - low) / _DEGREES for low, high in ends]
    name = "Joint angles over one stride"
    size = _WIDTH, sum(heights) + _BETWEEN * len(heights) + _AROUND
    figure = style.new_figure(*size, f"{title}: {name[0].lower()}{name[1:]}" if title else name)
    panels = figure.subplots(max(1, len(shown)), 1, sharex=True, squeeze=False, height_ratios=heights or [1.0])[:, 0]
    for row, (axes, (part, sense, curves), limits) in enumerate(zip(panels, shown, ends, strict=False)):
        style.tidy(axes)
        style.shade_phases(axes, motion.phases, names=row == 0)
        if limits[0] < 0.0 < limits[1]:
            axes.axhline(0.0, color=style.GROUND, linewidth=0.8, zorder=1)
        for side, curve in curves.items():
            axes.plot(times, curve, color=style.SIDE_COLOURS[side], linewidth=1.8)
        axes.set(ylim=limits, ylabel=f"{part} [deg]")
        axes.yaxis.set_major_locator(MultipleLocator(_TICK))
        axes.set_title(f"{part}, {sense}", loc="left", fontsize=9, color=style.INK, pad=32 if row == 0 else 3)
    figure.align_ylabels()
    panels[-1].set_xlabel("time since left touchdown [s]")
    panels[-1].set_xlim(float(times[0]), float(times[-1]))
    sides = {side: None for _, _, curves in shown for side in curves}
    handles = [Line2D([], [], color=style.SIDE_COLOURS[side], linewidth=1.8) for side in sides]
    labels = ["trunk" if side == "middle" else side for side in sides]
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _curves(motion: Motion, joint: str) -> dict[str, Array]:
    """What the motion knows of a joint, by side ("middle" for the trunk) [deg]."""
    names = {"middle": joint, **{side: f"{side}_{joint}" for side in SIDES}}
    return {side: np.degrees(numbers(motion.angles[name])) for side, name in names.items() if name in motion.angles}


def _ends(curves: dict[str, Array]) -> tuple[float, float]:
    together = np.concatenate(list(curves.values()))
    return style.widened(float(together.min()), float(together.max()), LEAST_SPAN)
