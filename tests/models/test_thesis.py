"""The thesis model: the same run as the smooth one where they must agree, frame by frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.gait import stride_motion
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.thesis import ThesisModel
from hopdiff.models.trajectory import JOINT_CHANNELS
from hopdiff.physics.legs import knee_offset, leg_reach
from hopdiff.problem import RunProblem
from hopdiff.types import HopdiffError, Status
from tests.builders import make_problem, random_genes, valid_genes


def thesis(*overrides: str) -> RunProblem:
    """With the genes that it shares with the smooth model, and all terms of the cost."""
    return make_problem("model=thesis", "genes=default", "costs=default", "speed=5", "beta=0.2", *overrides)


def printed(*overrides: str) -> RunProblem:
    """With its own genes, and its own objective."""
    return make_problem("model=thesis", "speed=5", "beta=0.5", *overrides)


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
    shares = {(3, "default"): 0.8, (5, "default"): 0.8, (8, "default"): 0.6, (2, "thesis"): 0.5, (5, "thesis"): 0.6}
    for (speed, genes), share in shares.items():
        problem = make_problem("model=thesis", f"speed={speed}", "beta=0.5", f"genes={genes}")
        result = problem.evaluate(random_genes(problem, 256), with_grad=False)
        assert torch.isfinite(result.cost).eq(result.status == int(Status.OK)).all()
        assert float((result.status == int(Status.OK)).double().mean()) > share
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


def test_gamma_holds_the_rate_that_stance_predicts_against_the_one_that_flight_begins_with() -> None:
    """One frame ahead by equation (12): the last rate of stance and its last change, against the first of flight."""
    problem = thesis()
    with torch.no_grad():
        t = problem.trajectory(valid_genes(problem, 4))
    h = problem.model.step  # type: ignore[attr-defined]
    for p in range(4):
        n = round(float(t.contact_time[p]) / h)
        rates = t.angles[p, :, :4].diff(dim=0) / h
        # Rate k lies between frames k and k + 1; stance are the frames 0 to n - 1.
        torch.testing.assert_close(t.rates_before[p], 2.0 * rates[n - 2] - rates[n - 3])
        torch.testing.assert_close(t.rates_after[p], rates[n])


def test_accelerations_do_not_reach_across_take_off() -> None:
    problem = thesis()
    with torch.no_grad():
        t = problem.trajectory(valid_genes(problem, 4))
    h = problem.model.step  # type: ignore[attr-defined]
    for p in range(4):
        n = round(float(t.contact_time[p]) / h)
        count = int((t.weights[p] > 0).sum())
        central = (t.angles[p, 2:] - 2.0 * t.angles[p, 1:-1] + t.angles[p, :-2]) / h**2
        wanted = torch.cat((central[:1], central, central[-1:]))[:count]
        wanted[n - 1], wanted[n] = wanted[n - 2], wanted[n + 1]
        wanted[-1] = wanted[-2]
        torch.testing.assert_close(t.accelerations[p, :count], wanted, rtol=1e-9, atol=1e-6)
        assert float(t.weights[p].sum()) == pytest.approx(count * h)


def curve_of(values: Tensor, phase: Tensor, degree: int) -> np.polynomial.Polynomial:
    """The polynomial in the phase that values (F,) lie on, to rounding."""
    fit = np.polynomial.Polynomial.fit(phase.numpy(), values.numpy(), degree, domain=[0, 1], window=[0, 1])
    assert float(np.abs(fit(phase.numpy()) - values.numpy()).max()) < 1e-9
    return fit


def test_legs_move_by_equations_5_and_6() -> None:
    """theta_l blends linearly through the air and leg angles go on the parabola (6); the genes are its ends."""
    problem = thesis()
    genes = problem.table.decode(valid_genes(problem, 4, seed=3))
    body, speed = problem.character, torch.full((4,), 5.0, dtype=torch.float64)
    with torch.no_grad():
        f = ThesisModel(body, 1e-3).frames(genes, speed)
    cycle = f.steps.cycle
    height = cycle.leg_length * torch.cos(cycle.touchdown_angle)
    half = 0.5 * genes["step_width"] - body.hip_half_width
    for p in range(4):
        g = {name: float(value[p]) for name, value in genes.items()}
        flying = f.hops.in_flight[p] & f.hops.alive[p]
        standing = ~f.hops.in_flight[p] & f.hops.alive[p]
        angles, knees = {}, {}
        for side in ("left", "right"):
            knees[side] = f.base[f"{side}_knee"][p]
            angles[side] = f.base[f"{side}_thigh"][p] - knee_offset(knees[side], body.thigh, body.shank)
        in_air, on_ground = f.hops.phase[p, flying], f.hops.phase[p, standing]
        down = math.hypot(float(height[p]), float(half[p]))
        touchdown = math.atan2(float(cycle.reach[p]), down)
        end_angle = touchdown - g["swing_reach"]

        swinging = curve_of(angles["right"][standing], on_ground, 1)
        assert swinging([0.0, 1.0]) == pytest.approx([g["swing_angle_start"], end_angle])
        folding = curve_of(knees["right"][standing], on_ground, 2)
        assert folding([0.0, 0.5]) == pytest.approx([g["swing_knee_start"], g["swing_knee_middle"]])
        above = float(height[p]) - float(leg_reach(torch.tensor(folding(1.0)), body.thigh, body.shank)) * math.cos(
            end_angle
        )
        assert above == pytest.approx(g["swing_clearance_end"], abs=1e-9)

        trailing, leading = (curve_of(angles[side][flying], in_air, 2) for side in ("left", "right"))
        assert trailing(1.0) == pytest.approx(g["swing_angle_start"])
        assert leading([0.0, 1.0]) == pytest.approx([end_angle, touchdown])
        # Both have their extremum at alpha, and the leading leg ends as fast as HIP passes over a planted foot.
        alphas = [float(curve.deriv().roots()[0]) for curve in (trailing, leading)]
        assert alphas[0] == pytest.approx(alphas[1])
        assert 0.5 < alphas[0] < 1.0
        speed_over_foot = 5.0 * float(height[p]) + float(cycle.touchdown_rate[p] * cycle.reach[p])
        rate = -speed_over_foot / float(cycle.leg_length[p]) ** 2
        assert leading.deriv()(1.0) / float(cycle.flight_time[p]) == pytest.approx(rate)

        offsets = {side: knee_offset(knees[side][flying], body.thigh, body.shank) for side in ("left", "right")}
        straightening, stretching = (curve_of(offsets[side], in_air, 1) for side in ("left", "right"))

        def flexion(theta: float) -> float:
            return theta + math.asin(body.thigh / body.shank * math.sin(theta))

        assert flexion(straightening(1.0)) == pytest.approx(g["swing_knee_start"])
        assert flexion(stretching(0.0)) == pytest.approx(folding(1.0))
        final = float(leg_reach(torch.tensor(flexion(stretching(1.0))), body.thigh, body.shank))
        assert final == pytest.approx(math.hypot(down, float(cycle.reach[p])))


def test_the_target_is_the_foot_in_stance_and_runs_to_the_other_in_flight() -> None:
    problem = thesis()
    genes = problem.table.decode(valid_genes(problem, 3, seed=4))
    with torch.no_grad():
        f = ThesisModel(problem.character).frames(genes, torch.full((3,), 5.0, dtype=torch.float64))
    reach = f.steps.cycle.reach
    for p in range(3):
        flying, alive = f.hops.in_flight[p], f.hops.alive[p]
        lead, width = float(genes["com_lead"][p]), 0.5 * float(genes["step_width"][p])
        on_foot = (f.hops.foot - f.hops.forward)[p] + lead
        torch.testing.assert_close(f.target_forward[p, alive & ~flying], on_foot[alive & ~flying])
        assert (f.target_side[p, alive & ~flying] == width).all()
        phase = f.hops.phase[p, alive & flying]
        torch.testing.assert_close(f.target_forward[p, alive & flying], float(reach[p]) * (2.0 * phase - 1.0) + lead)
        torch.testing.assert_close(f.target_side[p, alive & flying], width * (1.0 - 2.0 * phase))


def test_what_the_costs_see_is_the_body_on_its_frames() -> None:
    """Centre of mass, feet and force of the trajectory against the skeleton, posed frame by frame."""
    problem = thesis()
    genes = problem.table.decode(valid_genes(problem, 2, seed=6))
    speed = torch.full((2,), 5.0, dtype=torch.float64)
    with torch.no_grad():
        model = ThesisModel(problem.character)
        t, f = model.trajectory(genes, speed), model.frames(genes, speed)
    body, cycle = problem.character, f.steps.cycle
    for p in range(2):
        count = int((t.weights[p] > 0).sum())
        channels = {name: t.angles[p, :count, k] for k, (name, _, _) in enumerate(JOINT_CHANNELS)}
        channels["pelvis_tilt"] = t.pelvis_tilt[p].expand(count)
        inward = genes["arm_inward"][p].expand(count)
        channels |= {f"{side}_inward": inward for side in ("left", "right")}
        rotations = body.rotations(channels)
        root = torch.zeros(count, 3, dtype=torch.float64)
        root[:, 1] = f.hops.height[p, :count]
        positions, orientations = body.skeleton.forward(root, rotations)
        com = body.centre_of_mass(positions, orientations)
        torch.testing.assert_close(t.com_height[p, :count], com[:, 1], rtol=0.0, atol=1e-9)
        error = torch.stack((f.target_side[p, :count] - com[:, 0], f.target_forward[p, :count] - com[:, 2]), dim=-1)
        torch.testing.assert_close(t.balance_error[p, :count], error, rtol=0.0, atol=1e-9)
        ends = body.skeleton.end_positions(positions, orientations)
        for k, side in enumerate(("left", "right")):
            feet = ends[f"{side}_knee"][:, 1]
            torch.testing.assert_close(t.foot_height[p, :count, k], feet, rtol=0.0, atol=1e-9)
        length = torch.hypot(f.hops.forward - f.hops.foot, f.hops.height)[p, :count]
        force = cycle.stiffness[p] * (cycle.leg_length[p] - length) / 9.81
        force = torch.where(f.hops.in_flight[p, :count], 0.0, force)
        torch.testing.assert_close(t.leg_force[p, :count], force, rtol=1e-3, atol=1e-6)


def test_arms_swing_with_the_phase_of_the_stride() -> None:
    """Shoulders go as a cosine of the time since left touchdown, once a stride, the right half a stride after."""
    problem = thesis()
    genes = problem.ordinary_genes
    motion = problem.motion(genes, 200.0)
    g = problem.table.decode(genes.unsqueeze(0))
    phase = 2.0 * math.pi * motion.times / motion.clip.duration
    for name, late in (("left_shoulder", 0.0), ("right_shoulder", math.pi)):
        swing = motion.angles[name][:-1] - motion.angles[name][:-1].mean()
        wave = torch.exp(1j * (phase[:-1] - late))
        found = 2.0 * (swing * wave).mean()
        rest = swing - (found.real * wave.real + found.imag * wave.imag)
        assert float(rest.abs().max()) < 0.15 * float(swing.abs().max()), name
        assert abs(found) == pytest.approx(float(g["arm_swing"]), rel=0.1)


def test_its_own_genes_are_the_numbers_of_the_thesis() -> None:
    """Spring, rest length, alpha and the active leg's polar path come out as the genes say."""
    problem = printed()
    genes = problem.table.decode(valid_genes(problem, 4))
    body = problem.character
    with torch.no_grad():
        f = ThesisModel(body, 1e-3).frames(genes, torch.full((4,), 5.0, dtype=torch.float64))
    cycle = f.steps.cycle
    torch.testing.assert_close(cycle.stiffness, genes["stiffness"])
    torch.testing.assert_close(cycle.touchdown_angle, genes["touchdown_angle"])
    torch.testing.assert_close(cycle.leg_length, genes["leg_extension"] * body.leg_length)
    # The vertical speed at touchdown is that of a hop which repeats itself: it comes down as it went up.
    torch.testing.assert_close(-2.0 * cycle.touchdown_rate / 9.81, cycle.flight_time)
    for p in range(4):
        g = {name: float(value[p]) for name, value in genes.items()}
        standing = ~f.hops.in_flight[p] & f.hops.alive[p]
        flying = f.hops.in_flight[p] & f.hops.alive[p]
        knee = f.base["right_knee"][p]
        length = leg_reach(knee, body.thigh, body.shank) / body.leg_length
        angle = f.base["right_thigh"][p] - knee_offset(knee, body.thigh, body.shank)
        assert float(length[0]) == pytest.approx(g["active_length_start"])
        folding = curve_of(knee[standing], f.hops.phase[p, standing], 2)
        for share, name in ((0.5, "middle"), (1.0, "end")):
            found = leg_reach(torch.tensor(folding(share)), body.thigh, body.shank) / body.leg_length
            assert float(found) == pytest.approx(g[f"active_length_{name}"])
        swinging = curve_of(angle[standing], f.hops.phase[p, standing], 1)
        assert swinging([0.0, 1.0]) == pytest.approx([g["active_angle_start"], g["active_angle_end"]])
        leading = curve_of(angle[flying], f.hops.phase[p, flying], 2)
        assert float(leading.deriv().roots()[0]) == pytest.approx(g["alpha"])


def test_a_stiffness_without_a_hop_that_repeats_itself_is_an_impossible_run() -> None:
    problem = printed()
    genes = valid_genes(problem, 2)
    genes[1, problem.table.names.index("stiffness")] = -0.8  # far too soft for its angle
    found = problem.evaluate(genes, False)
    assert [Status(int(s)) for s in found.status] == [Status.OK, Status.STANCE_UNSOLVED]
    assert math.isinf(float(found.cost[1]))
    alone = problem.evaluate(genes[:1], False)
    torch.testing.assert_close(found.cost[:1], alone.cost)


def test_no_printed_run_connects_and_joined_ones_do() -> None:
    """The knee that carries turns its rate at take-off; a joined one goes on with it."""
    gammas, turned = {}, {}
    for knee in ("printed", "joined"):
        problem = printed(f"model.knee={knee}")
        genes = random_genes(problem, 256)
        found = problem.evaluate(genes, False)
        possible = found.status == int(Status.OK)
        steps = problem.trajectory(genes[possible])
        gammas[knee] = found.terms["gamma"][possible]
        turned[knee] = float((steps.rates_before[:, 2] * steps.rates_after[:, 2] < 0).double().mean())
    assert len(gammas["printed"]) > 100
    assert float(gammas["printed"].min()) > 4.0
    assert float(gammas["joined"].min()) < 0.2
    assert turned["printed"] > 0.95
    assert turned["joined"] < 0.3


def test_a_joined_knee_starts_with_the_rate_of_stance_and_ends_where_the_printed_one_does() -> None:
    genes = None
    knees = {}
    for way in ("flexion", "joined"):
        problem = printed()
        genes = problem.table.decode(valid_genes(problem, 3)) if genes is None else genes
        h = 2e-4
        with torch.no_grad():
            f = ThesisModel(problem.character, h, knee=way).frames(genes, torch.full((3,), 5.0, dtype=torch.float64))
        knees[way] = f
    for p in range(3):
        joined, linear = knees["joined"], knees["flexion"]
        flying = joined.hops.in_flight[p] & joined.hops.alive[p]
        first = int(flying.nonzero()[0])
        for side in ("left_knee", "right_knee"):
            knee = joined.base[side][p]
            before, after = (knee[first - 1] - knee[first - 2]) / h, (knee[first + 1] - knee[first]) / h
            assert float(after) == pytest.approx(float(before), rel=0.05)
            # What was added has faded where the flight ends.
            gap = (knee - linear.base[side][p])[flying]
            assert abs(float(gap[-1])) < 1e-3 < abs(float(gap.abs().max()))
            standing = ~joined.hops.in_flight[p] & joined.hops.alive[p]
            torch.testing.assert_close(linear.base[side][p, standing], knee[standing])


def test_an_impulse_at_take_off_grows_as_the_frame_interval_shrinks() -> None:
    energy = {}
    for h in (0.005, 0.0025):
        plain, struck = printed(f"model.step={h}"), printed(f"model.step={h}", "model.impulse=true")
        genes = plain.ordinary_genes.unsqueeze(0)
        energy[h] = float(struck.evaluate(genes, False).terms["energy_raw"]) - float(
            plain.evaluate(genes, False).terms["energy_raw"]
        )
    assert energy[0.005] > 0.0
    assert energy[0.0025] / energy[0.005] == pytest.approx(2.0, rel=0.25)


def test_bad_settings_get_a_sentence() -> None:
    with pytest.raises(HopdiffError, match=r"model\.knee"):
        make_problem("model=thesis", "model.knee=bent")
    with pytest.raises(HopdiffError, match=r"genes=thesis are those of model=thesis: model=smooth takes genes=default"):
        make_problem("model=smooth", "genes=thesis")
