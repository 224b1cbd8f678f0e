"""What an edit did to a path."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.root_path import RootPath, steps_of

MOVING = 0.3  # of the mean speed: below it a direction says little
FRAME = 1.0 / 30.0  # s over which turns are measured


def path_measures(before: RootPath, after: RootPath, frame_time: float) -> dict[str, float]:
    """Numbers of an edit, for metrics.json.

    path_length, path_length_before: [m]. stretch: their ratio; stretch_p05, stretch_p95: of the single steps where the
    source moves. side_slip_p95_deg: change of the angle between way and facing there. turn_max_deg, _before: largest
    turn in 1/30 s. delta_max, _before: largest norm of the differential coordinates of a step.
    """
    old, new = steps_of(before), steps_of(after)
    pace, new_pace = (steps[:, :2].norm(dim=-1) for steps in (old, new))
    moving = pace > MOVING * pace.mean()
    ratio = (new_pace / pace.clamp_min(1e-12))[moving]
    slip = (torch.atan2(new[:, 0], new[:, 1]) - torch.atan2(old[:, 0], old[:, 1]))[moving]
    slip = (torch.remainder(slip + math.pi, math.tau) - math.pi).abs()
    length, new_length = float(pace.sum()), float(new_pace.sum())
    return {
        "path_length_before": length,
        "path_length": new_length,
        "stretch": new_length / length if length > 0 else math.inf,
        "stretch_p05": _quantile(ratio, 0.05),
        "stretch_p95": _quantile(ratio, 0.95),
        "side_slip_p95_deg": math.degrees(_quantile(slip, 0.95)),
        "turn_max_deg_before": math.degrees(largest_turn(before, frame_time)),
        "turn_max_deg": math.degrees(largest_turn(after, frame_time)),
        "delta_max_before": float(laplacian(old).norm(dim=-1).max()),
        "delta_max": float(laplacian(new).norm(dim=-1).max()),
    }


def largest_turn(path: RootPath, frame_time: float) -> float:
    """Largest change of yaw in 1/30 s, or from one frame to the next where they are farther apart [rad]."""
    reach = min(max(1, round(FRAME / frame_time)), path.frames - 1)
    return float((path.yaw[reach:] - path.yaw[:-reach]).abs().max())


def _quantile(values: Tensor, share: float) -> float:
    """torch.quantile, for any number of values."""
    if not len(values):
        return 0.0
    ordered = values.sort().values
    return float(ordered[min(len(values) - 1, round(share * (len(values) - 1)))])
