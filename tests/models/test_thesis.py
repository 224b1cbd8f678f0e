"""The thesis model: the same run as the smooth one where they must agree, frame by frame."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.gait import stride_motion
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.thesis import ThesisModel
from hopdiff.problem import RunProblem
from hopdiff.types import Status
from tests.builders import make_problem, random_genes, valid_genes


def thesis(*overrides: str) -> RunProblem:
    return make_problem("model=thesis", "speed=5", "beta=0.2", *overrides)


def level(problem: RunProblem, genes: Tensor) -> dict[str, Tensor]:
    """Decoded genes with a pelvis that does not turn, as in the thesis."""
    still = torch.zeros(len(genes), dtype=torch.float64)
    return problem.table.decode(genes) | {"pelvis_roll": still, "pelvis_yaw": still, "trunk_yaw": still}


def test_stance_converges_to_the_smooth_model() -> None:
    """Same touchdown state, h halved: stance leg and HIP approach the smooth ones to the order of the integrator."""
    problem = thesis()
    genes = level(problem, problem.ordinary_genes.unsqueeze(0))
    speed = torch.tensor([5.0], dtype=torch.float64)
    smooth = SmoothModel(problem.character)
    gait = smooth.gait(genes, speed)
    errors = []
    for h in (4e-3, 2e-3, 1e-3, 5e-4):
        frames = ThesisModel(problem.character, h).frames(genes, speed)
        count = int(frames.stance_frames)
        pose = gait.sample(torch.arange(count, dtype=torch.float64) * h)
        inside = slice(0, count - 1)  # the last frame may lie beyond the smooth take-off
        gaps = [frames.base[name][0, inside] - pose.channels[name][0, inside] for name in ("left_thigh", "left_knee")]
        errors.append([float(gap.abs().max()) for gap in gaps])
    order = torch.log2(torch.tensor(errors[:-1]) / torch.tensor(errors[1:]))
    assert float(order.min()) > 1.7
    assert max(errors[-1]) < 1e-3


def test_contact_and_flight_are_those_of_the_smooth_model_to_a_few_frames() -> None:
    problem = thesis()
    genes = valid_genes(problem, 5)
    speed = torch.full((5,), 5.0, dtype=torch.float64)
    cycle = SmoothModel(problem.character).gait(problem.table.decode(genes), speed).steps.cycle
    h = 1e-3
    with torch.no_grad():
        found = ThesisModel(problem.character, h).trajectory(problem.table.decode(genes), speed)
    assert float((found.contact_time - cycle.contact_time).abs().max()) < 2 * h
    assert float((found.flight_time - cycle.flight_time).abs().max()) < 8 * h


def test_motion_stands_on_its_feet_and_keeps_its_speed() -> None:
    problem = thesis()
    motion = problem.motion(problem.ordinary_genes, 60.0)
    root = motion.clip.root_position
    torch.testing.assert_close(root[:, 2], 5.0 * motion.times)
    # Sampled between its frames of 5 ms the planted foot wanders by the error of linear interpolation.
    assert stance_foot_drift(motion) < 0.02
    assert torch.isfinite(motion.clip.rotations).all()
    assert [p.kind for p in motion.phases] == ["stance", "flight"] * 2


def test_the_loop_closes_as_the_balance_settles() -> None:
    problem = thesis()
    genes = problem.table.decode(problem.ordinary_genes.unsqueeze(0))
    speed = torch.tensor([5.0], dtype=torch.float64)
    models = [ThesisModel(problem.character, 0.005, strides) for strides in (0, 8, 40)]
    gaps = [loop_error(stride_motion(model.gait(genes, speed), 60.0)) for model in models]
    assert gaps[2] < 0.5 * gaps[1] < 0.5 * gaps[0]


def test_frame_interval_barely_changes_what_is_measured() -> None:
    """Costs are integrals over time: halving h must not double them."""
    coarse, fine = (thesis(f"model.step={h}") for h in (0.004, 0.001))
    genes = coarse.ordinary_genes.unsqueeze(0)
    for name in ("energy_raw", "leg_force"):
        values = [float(p.evaluate(genes, False).terms[name]) for p in (coarse, fine)]
        assert values[0] == pytest.approx(values[1], rel=0.25)


def test_random_candidates_are_priced_without_a_complaint() -> None:
    for speed in (3, 5, 8):
        problem = make_problem("model=thesis", f"speed={speed}", "beta=0.5")
        result = problem.evaluate(random_genes(problem, 256), with_grad=False)
        assert torch.isfinite(result.cost).eq(result.status == int(Status.OK)).all()
        assert float((result.status == int(Status.OK)).double().mean()) > 0.3
        assert all(bool(torch.isfinite(t[result.status == int(Status.OK)]).all()) for t in result.terms.values())


def test_a_neighbour_changes_nothing() -> None:
    problem = thesis()
    genes = random_genes(problem, 6)
    together = problem.evaluate(genes, False)
    for k in range(6):
        alone = problem.evaluate(genes[k : k + 1], False)
        assert int(alone.status) == int(together.status[k])
        if math.isfinite(float(alone.cost)):
            assert float(alone.cost) == pytest.approx(float(together.cost[k]), rel=1e-9)
