"""The picture that shows why a printed run cannot connect: the legs about take-off, printed and joined."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from matplotlib.figure import Figure
from torch import Tensor

from experiments.kang1999.variants import LEGS, problem_of, shares, take_offs
from hopdiff.api import optimise
from hopdiff.models.trajectory import JOINT_CHANNELS
from hopdiff.plots import style
from hopdiff.problem import RunProblem
from hopdiff.search.ga_thesis import GAThesis
from hopdiff.search.loop import Budget

KNEES = ("left_knee", "right_knee")


class Found(NamedTuple):
    """The best run (G,) of the GA of the thesis with one way of the knee. cost: its eval."""

    knee: str
    problem: RunProblem
    genes: Tensor
    cost: float


def best(knee: str, evaluations: int) -> Found:
    problem = problem_of(f"model.knee={knee}")
    result = optimise(problem, GAThesis(), Budget(evaluations))
    return Found(knee, problem, result.best_genes, result.best_cost)


def figure(found: Sequence[Found]) -> Figure:
    """Above: flexion of both knees over a step. Below: their rates. Right: what each channel adds to gamma."""
    drawn = style.new_figure(11, 6, "Both knees about take-off: best runs of the thesis' search, 5 m/s, beta 0.5")
    columns = [name for name, _, _ in JOINT_CHANNELS]
    axes = drawn.subplots(2, len(found) + 1, sharex=False)
    for column, run in enumerate(found):
        with torch.no_grad():
            steps = run.problem.trajectory(run.genes.unsqueeze(0))
        h = run.problem.model.step  # type: ignore[attr-defined]
        used = int((steps.weights[0] > 0).sum())
        angles = torch.rad2deg(steps.angles[0, :used])
        off = float(steps.contact_time[0])
        times = torch.arange(used) * h
        above, below = axes[0, column], axes[1, column]
        for name, label in zip(KNEES, ("carries", "active"), strict=True):
            angle = angles[:, columns.index(name)]
            above.plot(times, angle, ".-", label=label)
            # A rate across take-off belongs to neither side.
            rate = torch.deg2rad(angle.diff()) / h
            rate[round(off / h) - 1] = torch.nan
            below.plot(times[:-1] + 0.5 * h, rate, ".-")
        for panel in (above, below):
            style.tidy(panel)
            panel.axvline(off, color="0.4", lw=1, ls="--")
        above.set(title=f"{run.knee}: eval {run.cost:.4f}")
        below.set(xlabel="time since touchdown [s]")
        take = take_offs(run.problem, steps)
        parts = shares(take, run.problem.settings.gamma_guard)[0, : len(LEGS)]
        bars = axes[column, -1] if column < 2 else None
        if bars is not None:
            style.tidy(bars)
            bars.barh(range(len(LEGS)), parts.tolist())
            bars.set_yticks(range(len(LEGS)), LEGS)
            bars.set(title=f"{run.knee}: gamma {float(parts.sum()):.3f}", xlim=(0, 4.2))
            bars.invert_yaxis()
    axes[0, 0].set(ylabel="knee [deg]")
    axes[1, 0].set(ylabel="its rate [rad/s]")
    axes[0, 0].legend(frameon=False)
    return drawn
