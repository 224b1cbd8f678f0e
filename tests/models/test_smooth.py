"""The smooth model: one motion at every frame rate, that loops, without a jump, on feet that stand."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from numpy.polynomial.chebyshev import Chebyshev
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.costs import energy_rate_raw
from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.gait import Pose, stride_motion
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.smooth_gait import SmoothGait
from hopdiff.models.trajectory import JOINT_CHANNELS
from hopdiff.motion import Motion
from hopdiff.numerics import chebyshev_nodes
from hopdiff.problem import RunProblem
from hopdiff.search.loop import Budget, run_search
from tests.builders import make_problem, valid_genes

SPEEDS = (2.0, 5.0, 10.0)


def problem_at(speed: float) -> RunProblem:
    return make_problem(f"speed={speed}", "beta=0.5")


def gait_of(problem: RunProblem, genes: Tensor) -> SmoothGait:
    gait = problem.gait(genes.unsqueeze(0))
    assert isinstance(gait, SmoothGait)
    return gait


def step_time(gait: SmoothGait) -> float:
    return float(gait.contact_times[0, 0] + gait.flight_times[0, 0])


def poses_at(gait: SmoothGait, times: Tensor) -> Pose:
    """The one candidate at times (T,); every field (T, ...)."""
    pose = gait.sample(times)
    return Pose({name: values[0] for name, values in pose.channels.items()}, *(field[0] for field in pose[1:]))


def runs(problem: RunProblem) -> Tensor:
    """The ordinary run and four random ones."""
    return torch.cat((problem.ordinary_genes.unsqueeze(0), valid_genes(problem, 4, seed=5)))


@pytest.mark.parametrize("speed", SPEEDS)
def test_every_frame_rate_shows_the_same_motion(speed: float) -> None:
    problem = problem_at(speed)
    for genes in runs(problem):
        gait = gait_of(problem, genes)
        for fps in (30.0, 60.0, 120.0):
            motion = problem.motion(genes, fps)
            pose = poses_at(gait, motion.times)
            torch.testing.assert_close(
                motion.clip.rotations, problem.character.rotations(pose.channels), atol=1e-12, rtol=0.0
            )
            assert motion.clip.duration == pytest.approx(2.0 * step_time(gait), abs=1e-12)
            assert 1.0 / motion.clip.frame_time == pytest.approx(fps, rel=0.5 / (motion.clip.frames - 1))


def test_frames_at_common_times_are_the_same_frames() -> None:
    problem = problem_at(5.0)
    whole = step_time(gait_of(problem, problem.ordinary_genes))
    motions = [problem.motion(problem.ordinary_genes, 18.0 * k / (2.0 * whole)) for k in (1, 2, 4)]
    assert [m.clip.frames for m in motions] == [19, 37, 73]
    coarse = motions[0].clip
    for motion, every in ((motions[1], 2), (motions[2], 4)):
        for name in ("rotations", "root_position"):
            difference = getattr(motion.clip, name)[::every] - getattr(coarse, name)
            assert float(difference.abs().max()) < 1e-9


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_stride_loops_travels_and_stands_still_on_its_feet(speed: float) -> None:
    problem = problem_at(speed)
    for genes in runs(problem):
        motion = problem.motion(genes, 120.0)
        assert loop_error(motion) < 1e-7
        assert stance_foot_drift(motion) < 1e-6
        assert float(motion.feet[..., 1].min()) > -5e-4 - 1e-9
        root = motion.clip.root_position
        assert float((root[:, 2] - speed * motion.times).abs().max()) < 1e-12
        for k, phase in enumerate(p for p in motion.phases if p.kind == "stance"):
            here = (motion.times >= phase.start) & (motion.times <= phase.end)
            assert float(motion.feet[here, k, 1].abs().max()) < 1e-6
            # The last frame is the first of the next stride.
            assert torch.equal(here[:-1], motion.contact[:-1, k])
            assert bool(motion.contact[-1, k]) == (phase.side == "left")


@pytest.mark.parametrize("speed", SPEEDS)
def test_second_step_mirrors_the_first(speed: float) -> None:
    problem = problem_at(speed)
    genes = runs(problem)[1]
    gait = gait_of(problem, genes)
    times = torch.linspace(0.0, step_time(gait) * 0.999, 37, dtype=torch.float64)
    first, second = poses_at(gait, times), poses_at(gait, times + step_time(gait))
    signed = ("pelvis_roll", "pelvis_yaw", "trunk_side", "trunk_yaw", "neck_side")
    for name, values in first.channels.items():
        twin = name.replace("left", "LEFT").replace("right", "left").replace("LEFT", "right")
        sign = -1.0 if name in signed or (name.endswith("tilt") and name != "pelvis_tilt") else 1.0
        torch.testing.assert_close(second.channels[twin], sign * values, atol=1e-9, rtol=0.0)
    torch.testing.assert_close(second.height, first.height, atol=1e-12, rtol=0.0)


@pytest.mark.parametrize("speed", SPEEDS)
def test_no_jump_in_angle_or_rate_where_phases_meet(speed: float) -> None:
    problem = problem_at(speed)
    for genes in runs(problem):
        gait = gait_of(problem, genes)
        contact, step = float(gait.contact_times[0, 0]), step_time(gait)
        tiny = 1e-7

        def poses(times: list[float], gait: SmoothGait = gait) -> Tensor:
            """(C + 1, T): all channels and the height of HIP."""
            pose: Pose = poses_at(gait, torch.tensor(times, dtype=torch.float64))
            return torch.stack([*pose.channels.values(), pose.height])

        for junction in (contact, step, step + contact, 2.0 * step, 0.5 * contact + step):
            around = poses([junction + k * tiny for k in (-3, -2, -1, 1, 2, 3)])
            before = (3.0 * around[:, 2] - 4.0 * around[:, 1] + around[:, 0]) / (2.0 * tiny)
            after = (-3.0 * around[:, 3] + 4.0 * around[:, 4] - around[:, 5]) / (2.0 * tiny)
            at_once = around[:, 3] - around[:, 2] - 2.0 * tiny * 0.5 * (before + after)
            assert float(at_once.abs().max()) < 1e-7
            assert float((before - after).abs().max()) < 5e-3 * max(1.0, float(before.abs().max()))


@pytest.mark.parametrize("speed", SPEEDS)
def test_what_is_priced_is_what_is_shown(speed: float) -> None:
    """The nodes of the costs lie on the curves of the motion."""
    problem = problem_at(speed)
    genes = runs(problem)[2]
    gait = gait_of(problem, genes)
    with torch.no_grad():
        trajectory = problem.trajectory(genes.unsqueeze(0))
    n, cycle = gait.sway.shape[-1], gait.steps.cycle
    x = chebyshev_nodes(n, torch.float64, torch.device("cpu"))
    # The junction nodes belong to both phases: stay inside.
    times = torch.cat((x[:-1] * cycle.contact_time, cycle.contact_time + x[1:-1] * cycle.flight_time))
    rows = torch.cat((torch.arange(n - 1), torch.arange(n + 1, 2 * n - 1)))
    pose = poses_at(gait, times)
    shown = torch.stack([pose.channels[name] for name, _, _ in JOINT_CHANNELS], dim=-1)
    torch.testing.assert_close(trajectory.angles[0, rows], shown, atol=1e-7, rtol=0.0)
    torch.testing.assert_close(trajectory.leg_force[0, rows], pose.leg_force, atol=1e-6, rtol=1e-6)
    assert float(trajectory.weights.sum()) == pytest.approx(step_time(gait), rel=1e-12)


def test_accelerations_are_second_derivatives_of_the_angles() -> None:
    problem = problem_at(5.0)
    gait = gait_of(problem, problem.ordinary_genes)
    with torch.no_grad():
        trajectory = problem.trajectory(problem.ordinary_genes.unsqueeze(0))
    node, tiny = gait.sway.shape[-1] // 3, 1e-4
    time = float(
        chebyshev_nodes(gait.sway.shape[-1], torch.float64, torch.device("cpu"))[node] * gait.contact_times[0, 0]
    )
    pose = poses_at(gait, torch.tensor([time - tiny, time, time + tiny], dtype=torch.float64))
    for k, (name, _, _) in enumerate(JOINT_CHANNELS):
        a, b, c = pose.channels[name].tolist()
        central = (a - 2.0 * b + c) / tiny**2
        # The swinging knee is a spline in stance, which a polynomial through the nodes follows less closely.
        slack = 0.03 if name in ("right_knee", "right_thigh") else 0.003
        assert float(trajectory.accelerations[0, node, k]) == pytest.approx(central, rel=slack, abs=0.05)


@pytest.mark.parametrize("speed", [3.0, 8.0])
def test_the_nodes_see_the_energy_of_every_candidate(speed: float) -> None:
    """A knee that stops short costs much in little time; a search would live off what the nodes miss."""
    problem = problem_at(speed)
    genes = valid_genes(problem, 200, seed=9)
    fine = SmoothModel(problem.character, nodes=64)
    with torch.no_grad():
        found = energy_rate_raw(problem.trajectory(genes), problem.character)
        decoded, pace = problem.table.decode(genes), torch.full((200,), speed, dtype=torch.float64)
        wanted = energy_rate_raw(fine.trajectory(decoded, pace), problem.character)
    error = (found / wanted - 1.0).abs()
    assert float(error.median()) < 1e-3
    assert float(error.quantile(0.9)) < 0.01
    # Only a knee that takes off all but straight, at many turns a second, is too short a stop for the nodes.
    assert float((error > 0.05).double().mean()) < 0.03


def test_a_search_finds_no_energy_that_the_nodes_miss() -> None:
    """What a brisk search asks for is what its motion costs, measured with many more nodes."""
    job = build_job(compose(["model=smooth", "speed=8", "beta=0.8"]))
    problem = job.problem
    found = run_search(problem, job.search, Budget(2500), torch.Generator().manual_seed(0))
    fine = SmoothModel(problem.character, nodes=64)
    genes, pace = problem.table.decode(found.best_genes.unsqueeze(0)), torch.tensor([8.0], dtype=torch.float64)
    with torch.no_grad():
        raw = float(energy_rate_raw(fine.trajectory(genes, pace), problem.character))
    assert raw / problem.ordinary.energy_unit == pytest.approx(found.best_terms["energy"], rel=0.015)


def test_the_balance_leaves_no_error_on_average() -> None:
    """A periodic lag without own decay needs a mean error of zero: the body neither falls forward nor back."""
    problem = problem_at(5.0)
    with torch.no_grad():
        trajectory = problem.trajectory(runs(problem))
    error = (trajectory.balance_error * trajectory.weights.unsqueeze(-1)).sum(1) / trajectory.weights.sum(
        -1, keepdim=True
    )
    assert float(error[:, 1].abs().max()) < 2e-3


def test_more_nodes_and_sweeps_change_little() -> None:
    problem = problem_at(5.0)
    fine = SmoothModel(problem.character, nodes=48, sweeps=6)
    for genes in runs(problem)[:3]:
        decoded = problem.table.decode(genes.unsqueeze(0))
        speed = torch.tensor([5.0], dtype=torch.float64)
        coarse_motion: Motion = problem.motion(genes, 60.0)
        fine_motion = stride_motion(fine.gait(decoded, speed), 60.0)
        difference = (coarse_motion.clip.joint_positions() - fine_motion.clip.joint_positions()).norm(dim=-1)
        assert float(difference.max()) < 2e-3


def test_float32_is_the_same_run() -> None:
    wide, narrow = problem_at(5.0), make_problem("speed=5", "beta=0.5", "dtype=float32")
    genes = runs(wide)
    found, wanted = narrow.evaluate(genes.float(), False), wide.evaluate(genes, False)
    assert found.cost.dtype == torch.float32
    assert torch.equal(found.status, wanted.status)
    for name, slack in (("energy", 1e-2), ("gamma", 2e-2), ("leg_force", 1e-5), ("style", 1e-3), ("posture", 1e-4)):
        torch.testing.assert_close(found.terms[name].double(), wanted.terms[name], rtol=slack, atol=slack)


def test_gamma_looks_a_sixtieth_of_a_second_ahead_from_both_sides_of_take_off() -> None:
    """Equation (12): rate and acceleration of the motion itself, fitted through moments close to take-off."""
    problem = problem_at(5.0)
    for genes in runs(problem):
        with torch.no_grad():
            t = problem.trajectory(genes.unsqueeze(0))
        gait = gait_of(problem, genes)
        share = chebyshev_nodes(9, torch.float64, torch.device("cpu"))
        for phase, sign, found in ((t.contact_time, -1.0, t.rates_before[0]), (t.flight_time, 1.0, t.rates_after[0])):
            for joint, (name, _, _) in enumerate(JOINT_CHANNELS[:4]):
                # What touchdown asks of the other knee sets in as a power of 2.5, which no polynomial follows far.
                powered = sign > 0 and name.startswith("right_")
                away = sign * (2e-3 if powered else 5e-3) * float(phase) * share
                # The moment itself belongs to the stance.
                times = float(t.contact_time) + (away.clamp_min(1e-12) if sign > 0 else away)
                curve = Chebyshev.fit(away.numpy(), poses_at(gait, times).channels[name].numpy(), 6)
                rate, bend = (float(curve.deriv(k)(0.0)) for k in (1, 2))
                slack = 0.1 if powered else 1e-3
                assert float(found[joint]) == pytest.approx(rate + bend / 60.0, rel=1e-3, abs=slack)


@pytest.mark.parametrize("speed", [3.0, 8.0])
def test_gamma_does_not_depend_on_the_nodes(speed: float) -> None:
    problem = problem_at(speed)
    genes = torch.cat((problem.ordinary_genes.unsqueeze(0), valid_genes(problem, 100, seed=9)))
    fine = replace(problem.model, nodes=84)
    decoded, pace = problem.table.decode(genes), torch.full((101,), speed, dtype=torch.float64)
    with torch.no_grad():
        _, found, _ = problem.price(genes, problem.trajectory(genes))
        _, wanted, _ = problem.price(genes, fine.trajectory(decoded, pace))
    torch.testing.assert_close(found["gamma"], wanted["gamma"], rtol=1e-6, atol=0.0)
    error = (found["eval"] / wanted["eval"] - 1.0).abs()
    assert float(error.median()) < 1e-4


def test_the_target_leads_the_foot_by_its_gene() -> None:
    """Target minus error is where the centre of mass is; a lead moves the target and the body follows."""
    problem = problem_at(4.0)
    genes = problem.table.decode(problem.ordinary_genes.unsqueeze(0))
    speed = torch.tensor([4.0], dtype=torch.float64)
    mean = []
    for lead in (0.0, 0.03):
        gait = problem.model.gait({**genes, "com_lead": torch.tensor([lead]).double()}, speed)
        times = torch.linspace(0.0, 2.0 * step_time(gait), 201, dtype=torch.float64)[:-1]  # type: ignore[arg-type]
        target = poses_at(gait, times).target  # type: ignore[arg-type]
        mean.append(float(target[:, 1].mean()))
        # In stance the target is the foot, which stands half a step width to its side.
        standing = poses_at(gait, times).leg_force > 1e-9  # type: ignore[arg-type]
        first = times < float(gait.contact_times[0, 0])
        width = 0.5 * float(genes["step_width"])
        assert target[standing & first, 0].numpy() == pytest.approx(width)
        reach = float(gait.steps.cycle.reach)  # type: ignore[attr-defined]
        assert float(target[0, 1]) == pytest.approx(reach + lead)
    assert mean[1] - mean[0] == pytest.approx(0.03, abs=1e-9)
