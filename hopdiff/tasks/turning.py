"""A stride of a run that turns steadily, as it runs along an arc."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from hopdiff.export.take import Take, closes
from hopdiff.geometry.curve import curve_through
from hopdiff.job import Job, Run
from hopdiff.numerics import GRAVITY
from hopdiff.tasks.path import OF_STRAIGHT_RUNS, led_along, stride_times
from hopdiff.tasks.route import HOLD, Route
from hopdiff.types import HopdiffError

BEFORE, STRIDES = 2, 5  # strides of the arc before the one that is taken, and in all: its ends are not quite round
POINTS = 100  # of the arc for each stride
MOST_LEAN = math.radians(30.0)  # of the body into the turn


def check_turn(speed: float, turn: float, setting: str) -> None:
    """Raises HopdiffError, naming the setting, for a turn [deg/s] that no foot holds at a speed [m/s]."""
    most = math.degrees(HOLD * GRAVITY / speed)
    if not abs(turn) <= most:
        raise HopdiffError(
            f"{setting} must lie between -{most:.0f} and {most:.0f} deg/s at {speed:g} m/s, not {turn:g}."
        )


def turning(job: Job, run: Run, turn: float) -> Take:
    """One stride of a run along an arc, from the left foot's touchdown at x = z = 0, where it heads along +z.

    turn: to the left [deg/s]. The straight run is bent for it, as task=path does.
    """
    genes = job.table.to_unit(job.table.low.new_tensor(list(run.genes.values())))
    stride = float(stride_times(job.problem, genes.unsqueeze(0)))
    length, rate = job.problem.speed * stride, math.radians(turn)
    radius = job.problem.speed / rate
    along = np.linspace(-BEFORE * length, (STRIDES - BEFORE) * length, STRIDES * POINTS + 1) / radius
    points = radius * np.stack((1.0 - np.cos(along), np.sin(along)), axis=-1)
    route = Route(points, curve_through(points.tolist(), False, 0.0), STRIDES * stride, MOST_LEAN)
    frames = max(round(stride * job.fps), 1)
    with torch.no_grad():
        motion = led_along(job.problem, genes, route, STRIDES, frames / stride)
    numbers = {name: value for name, value in run.metrics.items() if name not in OF_STRAIGHT_RUNS}
    straight = run.take()
    whole = Take.of_motion(f"{straight.name}_turn{turn:g}", motion, run.masses, numbers | {"turn": turn}, run.segments)
    times = torch.arange(BEFORE * frames, (BEFORE + 1) * frames + 1, dtype=torch.float64)
    found = whole.at(times, stride / frames)
    return replace(found, loop=closes(found.clip))
