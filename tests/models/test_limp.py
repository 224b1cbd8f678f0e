"""Limping: two different legs, one endless run; the body hurries over the lame leg and leans over the sound one."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.gait import Gait
from hopdiff.models.limp import LimpSettings
from hopdiff.problem import RunProblem
from hopdiff.types import HopdiffError
from tests.builders import limp_settings, make_problem, valid_genes

AMOUNTS = (0.2, 0.4)


def limping(amount: float, *overrides: str, leg: str = "left", speed: float = 3.5) -> RunProblem:
    return make_problem(f"speed={speed}", "beta=0.3", f"limp.amount={amount}", f"limp.leg={leg}", *overrides)


def candidates(problem: RunProblem) -> Tensor:
    """The ordinary limp and three random ones."""
    return torch.cat((problem.ordinary_genes.unsqueeze(0), valid_genes(problem, 3, seed=2)))


def values_at(gait: Gait, times: Tensor) -> Tensor:
    """(C + 2, T): all channels of the one candidate, the height of HIP and its travel."""
    pose = gait.sample(times)
    return torch.stack([*(values[0] for values in pose.channels.values()), pose.height[0], pose.travel[0]])


@pytest.mark.few(3)
@pytest.mark.parametrize("model", ["smooth", "thesis"])
@pytest.mark.parametrize("amount", AMOUNTS)
@pytest.mark.parametrize("leg", ["left", "right"])
def test_the_lame_leg_carries_shorter_by_the_amount(model: str, amount: float, leg: str) -> None:
    problem = limping(amount, f"model={model}", leg=leg)
    gait = problem.gait(candidates(problem))
    left, right = gait.contact_times.unbind(-1)
    lame, sound = (left, right) if leg == "left" else (right, left)
    slack = 1e-9 if model == "smooth" else 0.15  # whole frames of 5 ms
    torch.testing.assert_close(lame / sound, torch.full_like(lame, 1.0 - amount), atol=slack, rtol=0.0)


@pytest.mark.parametrize("amount", AMOUNTS)
def test_a_limping_stride_loops_keeps_its_speed_and_stands_on_its_feet(amount: float) -> None:
    problem = limping(amount)
    for genes in candidates(problem):
        motion = problem.motion(genes, 240.0)
        assert loop_error(motion) < 1e-7
        assert stance_foot_drift(motion) < 1e-6
        travel = float(motion.clip.root_position[-1, 2] - motion.clip.root_position[0, 2])
        assert travel / motion.clip.duration == pytest.approx(3.5, rel=1e-9)


@pytest.mark.parametrize("amount", AMOUNTS)
def test_nothing_jumps_where_the_phases_of_a_limp_meet(amount: float) -> None:
    problem = limping(amount)
    for genes in candidates(problem):
        gait = problem.gait(genes.unsqueeze(0))
        spans = torch.stack((gait.contact_times[0], gait.flight_times[0]), dim=-1).flatten()
        for junction in torch.cumsum(spans, 0).tolist():
            tiny = 1e-7
            times = junction + tiny * torch.tensor([-3, -2, -1, 1, 2, 3], dtype=torch.float64)
            around = values_at(gait, times)
            before = (3.0 * around[:, 2] - 4.0 * around[:, 1] + around[:, 0]) / (2.0 * tiny)
            after = (-3.0 * around[:, 3] + 4.0 * around[:, 4] - around[:, 5]) / (2.0 * tiny)
            jump = around[:, 3] - around[:, 2] - tiny * (before + after)
            assert float(jump.abs().max()) < 1e-7
            assert float((before - after).abs().max()) < 5e-3 * max(1.0, float(before.abs().max()))


def test_the_body_is_fastest_over_the_lame_leg() -> None:
    problem = limping(0.4)
    gait = problem.gait(problem.ordinary_genes.unsqueeze(0))
    whole = float((gait.contact_times + gait.flight_times).sum())
    times = torch.linspace(0.0, whole, 2001, dtype=torch.float64)
    travel = gait.sample(times).travel[0]
    speed = torch.diff(travel) / torch.diff(times)
    assert float(times[int(speed.argmax())]) < float(gait.contact_times[0, 0])
    # Everywhere else it is the same.
    elsewhere = speed[times[1:] > gait.contact_times[0, 0] + 1e-3]
    assert float(elsewhere.max() - elsewhere.min()) < 1e-9
    assert float(speed.max()) > 1.2 * float(elsewhere.mean())


@pytest.mark.few(3)
@pytest.mark.parametrize("model", ["smooth", "thesis"])
@pytest.mark.parametrize(("leg", "sign"), [("left", -1.0), ("right", 1.0)])
def test_the_body_leans_over_the_sound_leg(model: str, leg: str, sign: float) -> None:
    """sign: of x, left positive, on the side of the sound leg."""
    problem = limping(0.5, f"model={model}", leg=leg, speed=2.0)
    motion = problem.motion(problem.ordinary_genes, 120.0)
    assert sign * float(motion.com[:-1, 0].mean()) > 1e-3
    # trunk_side is positive to the right.
    assert sign * float(motion.angles["trunk_side"][:-1].mean()) < 0.0


@pytest.mark.parametrize("model", ["smooth", "thesis"])
def test_limping_left_is_the_mirror_image_of_limping_right(model: str) -> None:
    left, right = (limping(0.4, f"model={model}", leg=leg) for leg in ("left", "right"))
    for genes in candidates(left)[:2]:
        costs = [p.evaluate(genes.unsqueeze(0), False) for p in (left, right)]
        for name, value in costs[0].terms.items():
            torch.testing.assert_close(costs[1].terms[name], value, rtol=1e-9, atol=1e-12)


def test_no_limp_is_the_ordinary_run() -> None:
    """With the smallest limp and legs alike, both steps together cost what the one step of a sound run costs."""
    tiny, sound = limping(1e-9), make_problem("speed=3.5", "beta=0.3")
    genes = sound.table.decode(sound.ordinary_genes.unsqueeze(0))
    lame = {f"lame_{name}": genes[name] for name in genes if name.startswith("swing_")}
    lame["lame_ease"] = torch.zeros(1, dtype=torch.float64)
    speed = torch.tensor([3.5], dtype=torch.float64)
    with torch.no_grad():
        both = tiny.model.trajectory({**genes, **lame}, speed)
        one = sound.model.trajectory(genes, speed)
    where = sound.ordinary_genes.unsqueeze(0)
    found, wanted = sound.price(where, both)[1], sound.price(where, one)[1]
    for name in ("gamma", "energy_raw", "leg_force", "style", "posture"):
        torch.testing.assert_close(found[name], wanted[name], rtol=1e-5, atol=1e-8)


def test_gradients_of_a_limp_are_those_of_finite_differences() -> None:
    problem = limping(0.4)
    genes = problem.ordinary_genes.unsqueeze(0)
    gradient = problem.evaluate(genes, True).grad
    assert gradient is not None
    step = 1e-6
    for index in [*range(0, problem.dimension, 4), problem.table.names.index("lame_ease")]:
        nudge = torch.zeros_like(genes)
        nudge[0, index] = step
        up, down = (problem.evaluate(genes + sign * nudge, False).merit for sign in (1.0, -1.0))
        assert float(gradient[0, index]) == pytest.approx(float((up - down) / (2 * step)), rel=2e-3, abs=2e-4)


@pytest.mark.parametrize(
    ("settings", "name"),
    [
        (limp_settings(leg="both"), "limp.leg"),
        (limp_settings(amount=-0.1), "limp.amount"),
        (limp_settings(amount=0.9), "limp.amount"),
        (limp_settings(amount=float("nan")), "limp.amount"),
        (limp_settings(haste=1.5), "limp.haste"),
    ],
)
def test_a_limp_that_cannot_be_is_named(settings: LimpSettings, name: str) -> None:
    with pytest.raises(HopdiffError, match=name):
        settings.check()
