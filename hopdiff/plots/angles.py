"""Joint angles over a stride."""

from __future__ import annotations

import torch
from matplotlib.figure import Figure

from hopdiff.motion import SIDES, Motion
from hopdiff.plots import style

PANELS = (
    ("hip", "thigh, forward of the vertical"),
    ("knee", "knee flexion"),
    ("trunk", "trunk, forward of the vertical"),
    ("shoulder", "upper arm, forward of the trunk"),
    ("elbow", "elbow flexion"),
)


def angles_figure(motion: Motion) -> Figure:
    """Hip, knee, trunk, shoulder and elbow over the stride in degrees; stances are tinted in their leg's colour."""
    figure = style.new_figure(9.0, 11.0, "Joint angles over one stride [deg]")
    panels = figure.subplots(len(PANELS), 1, sharex=True)
    times = motion.times.cpu()
    for row, (axes, (joint, label)) in enumerate(zip(panels, PANELS, strict=True)):
        style.tidy(axes)
        style.shade_phases(axes, motion.phases, names=row == 0)
        if joint in motion.angles:
            axes.plot(times, torch.rad2deg(motion.angles[joint].cpu()), color=style.BODY, linewidth=1.8)
        for side in SIDES:
            name = f"{side}_{joint}"
            if name in motion.angles:
                curve = torch.rad2deg(motion.angles[name].cpu())
                axes.plot(times, curve, color=style.SIDE_COLOURS[side], linewidth=1.8, label=side if row == 0 else None)
        axes.set_title(label, loc="left", fontsize=10, color=style.INK, pad=18 if row == 0 else 4)
    panels[-1].set_xlabel("time since left touchdown [s]")
    panels[-1].set_xlim(float(times[0]), float(times[-1]))
    figure.legend(loc="outside upper right", ncols=2, frameon=False, fontsize=9)
    return figure
