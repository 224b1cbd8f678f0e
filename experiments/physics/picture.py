"""One run over its stride: the force of the ground, the flight of the centre of mass, and the angular momentum."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.physics.frames import stretches
from experiments.physics.momentum import Analysis
from experiments.physics.recording import GRAVITY, Array
from hopdiff.plots import style

AXES = (("x, to the left", style.SERIES[2]), ("y, up", style.SERIES[0]), ("z, ahead", style.SERIES[1]))

LEGEND: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1, 0.98),
    "ncols": 3,
    "frameon": False,
    "fontsize": 9,
}


def momentum_figure(found: Analysis, title: str) -> Figure:
    """Dots: what the motion asks for; lines: what the file says. Tinted: a foot is on the ground."""
    own = found.recording
    times = own.frame_time * np.arange(own.frames)
    figure = style.new_figure(10, 9, title)
    force, height, spin, moment = figure.subplots(4, 1, sharex=True, height_ratios=(3, 2, 2.4, 2.4))
    for axes in (force, height, spin, moment):
        style.tidy(axes)
        _shade(axes, found, times)
    _lines(
        force,
        times,
        found.wanted / found.weight,
        found.given / found.weight if found.given is not None else None,
        found,
    )
    force.set_ylabel("ground force [BW]")
    force.legend(**LEGEND)
    height.plot(times, found.com[:, 1], color=style.INK, lw=1.6, label="centre of mass")
    for frames in stretches(found.flight, False):
        if len(frames) > 2:
            own_times = times[frames]
            fallen = found.com[frames, 1] + 0.5 * GRAVITY * (own_times - own_times.mean()) ** 2
            line = np.polynomial.Polynomial.fit(own_times, fallen, 1)
            wide = np.linspace(own_times[0] - 0.04, own_times[-1] + 0.04, 60)
            height.plot(
                wide, line(wide) - 0.5 * GRAVITY * (wide - own_times.mean()) ** 2, "--", color=style.SERIES[4], lw=2
            )
    height.plot([], [], "--", color=style.SERIES[4], lw=2, label="parabola of a thrown body")
    height.set_ylabel("height [m]")
    height.legend(**LEGEND)
    for (name, colour), values in zip(AXES, found.spin.T, strict=True):
        spin.plot(times, values, color=colour, lw=1.6, label=name)
    spin.set_ylabel("angular momentum\n[kg m²/s]")
    _lines(moment, times, found.wanted_moment, found.given_moment, found)
    moment.set(ylabel="moment about the\ncentre of mass [Nm]", xlabel="time since left touchdown [s]")
    return figure


def _lines(axes: Axes, times: Array, wanted: Array, given: Array | None, found: Analysis) -> None:
    """Given by the file as lines, wanted by the motion as dots where it is steady."""
    every = np.flatnonzero(found.steady)[:: max(1, int(found.steady.sum()) // 160)]
    for k, (name, colour) in enumerate(AXES):
        if given is not None:
            axes.plot(times, given[:, k], color=colour, lw=1.6, label=name)
        axes.plot(times[every], wanted[every, k], ".", ms=4, color=colour, label=name if given is None else None)


def _shade(axes: Axes, found: Analysis, times: Array) -> None:
    for side, colour in ((0, style.LEFT), (1, style.RIGHT)):
        for frames in stretches(found.recording.contact[:, side], False):
            axes.axvspan(times[frames[0]], times[frames[-1]], color=style.pale(colour, 0.86), lw=0, zorder=0)
