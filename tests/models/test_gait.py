"""Gaits: many candidates sampled at once, at any moment of their endless runs."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from hopdiff.models.gait import LEAST_FRAMES, contacts, phases, stride_frames, stride_time
from hopdiff.problem import RunProblem
from hopdiff.types import HopdiffError
from tests.builders import make_problem, valid_genes

KINDS = [("smooth", 0.0), ("smooth", 0.4), ("thesis", 0.0), ("thesis", 0.4)]


def problem_of(model: str, amount: float) -> RunProblem:
    return make_problem(f"model={model}", "speed=4", "beta=0.3", f"limp.amount={amount}")


@pytest.mark.few(3)
@pytest.mark.parametrize(("model", "amount"), KINDS)
def test_a_candidate_runs_alone_as_it_runs_among_others(model: str, amount: float) -> None:
    problem = problem_of(model, amount)
    genes = valid_genes(problem, 5, seed=3)
    times = torch.linspace(0.0, 3.0, 97, dtype=torch.float64)
    together = problem.gait(genes)
    pose = together.sample(times)
    assert pose.height.shape == pose.travel.shape == pose.leg_force.shape == (5, 97)
    assert pose.target.shape == (5, 97, 2)
    for k in range(5):
        alone = problem.gait(genes[k : k + 1])
        torch.testing.assert_close(alone.contact_times, together.contact_times[k : k + 1])
        single = alone.sample(times)
        torch.testing.assert_close(single.travel[0], pose.travel[k])
        for name, values in single.channels.items():
            torch.testing.assert_close(values[0], pose.channels[name][k], atol=1e-7, rtol=0.0)


@pytest.mark.parametrize(("model", "amount"), KINDS)
def test_strides_repeat_before_and_after(model: str, amount: float) -> None:
    problem = problem_of(model, amount)
    gait = problem.gait(valid_genes(problem, 1, seed=3))
    whole = stride_time(gait)[0]
    times = torch.linspace(0.01, 0.99, 41, dtype=torch.float64) * whole
    here = gait.sample(times)
    way = gait.sample(whole.unsqueeze(0)).travel
    for strides in (-1, 1, 7):
        there = gait.sample(times + strides * whole)
        torch.testing.assert_close(there.travel - strides * way, here.travel, atol=1e-9, rtol=0.0)
        for name, values in here.channels.items():
            torch.testing.assert_close(there.channels[name], values, atol=1e-7, rtol=0.0)


def test_phases_and_contacts_of_many_strides() -> None:
    problem = problem_of("smooth", 0.4)
    gait = problem.gait(valid_genes(problem, 1, seed=3))
    course = phases(gait, 3)
    assert [(p.kind, p.side) for p in course[:4]] == [
        ("stance", "left"),
        ("flight", "left"),
        ("stance", "right"),
        ("flight", "right"),
    ]
    for before, after in pairwise(course):
        assert before.end == pytest.approx(after.start, abs=1e-12)
    assert course[-1].end == pytest.approx(3.0 * float(stride_time(gait)[0]), abs=1e-12)
    middles = torch.tensor([0.5 * (p.start + p.end) for p in course], dtype=torch.float64)
    standing = contacts(middles, course).tolist()
    assert standing == [[p.kind == "stance" and p.side == side for side in ("left", "right")] for p in course]
    assert contacts(torch.tensor([course[-1].end]), course).tolist() == [[True, False]]


def test_too_few_frames_a_second_are_refused() -> None:
    assert stride_frames(0.5, 60.0) == 30
    with pytest.raises(HopdiffError, match="fps=5 is too low"):
        stride_frames(0.5, 5.0)


@pytest.mark.parametrize("duration", [0.31, 0.648, 1.37])
def test_the_frame_rate_that_is_told_will_do(duration: float) -> None:
    with pytest.raises(HopdiffError, match=r"at least (\d+)\.") as caught:
        stride_frames(duration, 2.0)
    told = int(str(caught.value).split()[-1].rstrip("."))
    assert stride_frames(duration, told) >= LEAST_FRAMES
    with pytest.raises(HopdiffError, match="too low"):
        stride_frames(duration, told - 2.0 / duration)
