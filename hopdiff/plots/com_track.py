"""The centre of mass from above, as in Kang (1999), figure 3.14."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.view import Array, numbers

_SCALE = {True: 1.0, False: 100.0}  # sideways in metres, or in centimetres where it is drawn larger


def com_track_figure(motion: Motion, strides: int = 2, equal: bool = False) -> Figure:
    """Target (dashed) and actual (solid) centre of mass and the footprints, seen from above, left side up.

    strides: how many to show; a motion that holds fewer is repeated. equal: both ways in one scale; without it
    sideways is drawn larger than forward, since the body sways by centimetres and travels by metres.
    """
    scale = _SCALE[equal]
    rounds = max(1, -(-strides // held_strides(motion)))
    end = _end(motion, strides) if rounds == 1 else float(motion.times[-1])
    keep = numbers(motion.times) <= end + 1e-9
    root = numbers(motion.clip.root_position)
    travel = root[-1] - root[0]
    figure = style.new_figure(11.0, 4.2, "Centre of mass from above")
    axes = style.tidy(figure.add_subplot())
    for name, track, line, colour in (
        ("target", motion.com_target, "--", style.GROUND),
        ("actual", motion.com, "-", style.INK),
    ):
        path = np.concatenate([numbers(track)[keep] + k * travel for k in range(rounds)])
        axes.plot(path[:, 2], scale * path[:, 0], line, color=colour, linewidth=1.8, label=name)
    for side, name in enumerate(SIDES):
        places = [place + k * travel for k in range(rounds) for place in _touchdowns(motion, side, end)]
        for number, place in enumerate(places):
            size = (0.26, 0.1) if equal else (0.26, 0.7)
            label = f"{name} foot" if number == 0 else None
            axes.add_patch(Ellipse((place[2], scale * place[0]), *size, color=style.SIDE_COLOURS[name], label=label))
    axes.set_xlabel("forward [m]")
    if equal:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_ylabel("to the left [m]")
    else:
        low, high = axes.get_ylim()
        reach = max(abs(low), abs(high), 5.0) * 1.15
        axes.set_ylim(-reach, reach)
        axes.set_ylabel("to the left [cm]")
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def held_strides(motion: Motion) -> int:
    """How many strides, of two steps each, a motion holds."""
    return max(1, len(motion.phases) // 4)


def _end(motion: Motion, strides: int) -> float:
    """When the last of so many strides ends [s]."""
    return motion.phases[4 * strides - 1].end if motion.phases else float(motion.times[-1])


def _touchdowns(motion: Motion, side: int, end: float) -> list[Array]:
    """Where a foot (0 left, 1 right) stands (3,) [m] in the first frame of each of its stances that begins before
    `end`; a stance without a frame leaves none."""
    times, feet = numbers(motion.times), numbers(motion.feet)[:, side]
    contact = numbers(motion.contact)[:, side] > 0
    found = []
    for phase in motion.phases:
        if phase.kind == "stance" and phase.side == SIDES[side] and phase.start < end - 1e-9:
            frames = np.flatnonzero(contact & (times >= phase.start - 1e-9) & (times <= phase.end + 1e-9))
            found += [feet[frame] for frame in frames[:1]]
    return found
