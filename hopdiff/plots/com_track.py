"""The centre of mass from above, as in Kang (1999), figure 3.14."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style
from hopdiff.plots.scene import FOOT
from hopdiff.plots.view import Array, numbers

_WIDEST, _TALLEST, _LARGEST = 13.0, 8.0, 5.0  # inches of the map's sides, and of a metre
_AROUND = (1.1, 1.75)  # inches beside the map, and over and under it
_MARGIN = (0.12, 0.06)  # metres of ground along and across the run, around everything
_STRAIGHT = 0.01  # of the way, that a straight run may end to its side


def com_track_figure(motion: Motion, strides: int = 1, title: str = "") -> Figure:
    """The centre of mass (solid), what it is held over (dashed) and the footprints from above, left side up.

    Both ways have one scale, so that the sway is as small as it is; a line says how small, and why. Dashed is the
    target of the balance, or, where the ground force is known, the centre of pressure. strides: how many to show; a
    motion that holds fewer is repeated. title: stands before the name of the picture.
    """
    rounds = max(1, -(-strides // held_strides(motion)))
    end = _end(motion, strides) if rounds == 1 else float(motion.times[-1])
    keep = numbers(motion.times) <= end + 1e-9
    root = numbers(motion.clip.root_position)
    travel = root[-1] - root[0]

    def repeated(track: Array) -> Array:
        return np.concatenate([track + k * travel for k in range(rounds)])[:, [2, 0]]

    held = repeated(numbers(motion.com_target)[keep])
    moved = repeated(numbers(motion.com)[keep])
    feet = {name: repeated(_stands(motion, side, end)) for side, name in enumerate(SIDES)}
    low, high = _window(np.concatenate((held, moved)), np.concatenate(list(feet.values())))
    wide, tall = high - low
    scale = min(_WIDEST / wide, _TALLEST / tall, _LARGEST)  # inches in a metre
    name = "Centre of mass from above"
    size = scale * wide + _AROUND[0], scale * tall + _AROUND[1]
    figure = style.new_figure(*size, f"{title}: {name[0].lower()}{name[1:]}" if title else name)
    axes = style.tidy(figure.add_subplot())
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    for name, places in feet.items():
        for number, place in enumerate(places):
            colour, label = style.pale(style.SIDE_COLOURS[name], 0.45), f"{name} foot" if number == 0 else None
            axes.add_patch(Ellipse((place[0], place[1]), *FOOT, color=colour, linewidth=0, label=label, zorder=1.5))
    dashed = "target" if motion.cop is None else "centre of pressure, joined through the air"
    axes.plot(*held.T, "--", color=style.GROUND, linewidth=1.4, label=dashed)
    axes.plot(*moved.T, "-", color=style.INK, linewidth=1.8, label="centre of mass")
    axes.set(xlabel="forward [m]", ylabel="to the left [m]")
    if abs(travel[0]) < _STRAIGHT * abs(travel[2]):
        note = _why(motion, moved, feet)
        axes.set_title(note, loc="left", fontsize=9, color=style.GROUND)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def held_strides(motion: Motion) -> int:
    """How many strides, of two steps each, a motion holds."""
    return max(1, len(motion.phases) // 4)


def _why(motion: Motion, moved: Array, feet: dict[str, Array]) -> str:
    """How far the centre of mass sways, and why no farther."""
    text = f"One scale both ways: the centre of mass sways by {100 * np.ptp(moved[:, 1]):.1f} cm"
    if all(len(places) for places in feet.values()):
        left, right = (places[:, 1].mean() for places in feet.values())
        text += f", the feet stand {100 * abs(left - right):.1f} cm apart"
    step = 0.5 * (motion.phases[3].end - motion.phases[0].start) if len(motion.phases) > 3 else None
    over = f"a step of {step:.2f} s" if step else "a step"
    return f"{text}:\n{over} is over before the body has come to the side of its foot"


def _window(lines: Array, feet: Array) -> tuple[Array, Array]:
    """Corners (2,) of the ground to be shown [m]."""
    half = 0.5 * np.array(FOOT)
    points = np.concatenate((lines, feet - half, feet + half))
    return points.min(axis=0) - _MARGIN, points.max(axis=0) + _MARGIN


def _end(motion: Motion, strides: int) -> float:
    """When the last of so many strides ends [s]."""
    return motion.phases[4 * strides - 1].end if motion.phases else float(motion.times[-1])


def _stands(motion: Motion, side: int, end: float) -> Array:
    """(K, 3) where a foot (0 left, 1 right) stands on the average in each of its stances that begins before `end` [m];
    a stance without a frame leaves none."""
    times, feet = numbers(motion.times), numbers(motion.feet)[:, side]
    contact = numbers(motion.contact)[:, side] > 0
    found = []
    for phase in motion.phases:
        if phase.kind == "stance" and phase.side == SIDES[side] and phase.start < end - 1e-9:
            frames = contact & (times >= phase.start - 1e-9) & (times <= phase.end + 1e-9)
            found += [feet[frames].mean(axis=0)] if frames.any() else []
    return np.array(found).reshape(-1, 3)
