"""The centre of mass from above, as in Kang (1999), figure 3.14."""

from __future__ import annotations

import torch
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style


def com_track_figure(motion: Motion, strides: int = 2) -> Figure:
    """Target (dashed) and actual (solid) centre of mass and the footprints, seen from above, left side up.

    Sideways is drawn larger than forward, since the body sways by centimetres and travels by metres.
    """
    travel = (motion.clip.root_position[-1] - motion.clip.root_position[0]).cpu()
    figure = style.new_figure(11.0, 4.2, "Centre of mass from above")
    axes = style.tidy(figure.add_subplot())
    for name, track, line, colour in (
        ("target", motion.com_target, "--", style.GROUND),
        ("actual", motion.com, "-", style.INK),
    ):
        path = torch.cat([track.cpu() + k * travel for k in range(strides)])
        axes.plot(path[:, 2], 100.0 * path[:, 0], line, color=colour, linewidth=1.8, label=name)
    for side, name in enumerate(SIDES):
        frames = motion.contact[:-1, side].nonzero()
        if len(frames) == 0:
            continue
        place = motion.feet[int(frames[0, 0]), side].cpu()
        for k in range(strides):
            left, forward = 100.0 * float(place[0]), float(place[2] + k * travel[2])
            axes.add_patch(
                Ellipse(
                    (forward, left), 0.26, 0.7, color=style.SIDE_COLOURS[name], label=f"{name} foot" if k == 0 else None
                )
            )
    low, high = axes.get_ylim()
    reach = max(abs(low), abs(high), 5.0) * 1.15
    axes.set_ylim(-reach, reach)
    axes.set_xlabel("forward [m]")
    axes.set_ylabel("to the left [cm]")
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure
