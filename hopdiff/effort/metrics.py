"""The numbers of a finished whole-body run."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from hopdiff.effort.priced import Priced
from hopdiff.effort.problem import BodyProblem
from hopdiff.effort.terms import JOINT_KINDS, arm_swing, energy_target
from hopdiff.motion import SIDES, Motion
from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.finish import stride_motion
from hopdiff.whole_body.layout import SEGMENTS
from hopdiff.whole_body.skeleton import BALL, HEEL

MEASURING_FPS = 240.0  # dense enough that maxima between frames do not matter
FIRM = 0.1  # body weights of vertical force from which on the needed friction is told
AXES = ("flexion", "turn", "sideways")


def body_metrics(problem: BodyProblem, genes: Tensor) -> dict[str, float]:
    """What one candidate (G,) of the unit box measures, in SI units unless a name ends in _deg, _bw or _nm.

    external_work, cost_of_transport (what the muscles' work costs) and energy_unit (external work of the least run):
    in body weights times the way. energy_rate: told in that unit so that its target is beta / (1 - beta).
    flight_residual_bw, stance_residual_bw, moment_residual_nm: largest difference between what the body does and what
    the force asks. momentum_drift: of the angular momentum in flight [kg m^2/s]. cop_excess: how far the centre of
    pressure leaves the sole [m]. foot_slip: way of the sole's point of contact over the ground, a stance [m].
    """
    with torch.no_grad():
        evaluation = problem.evaluate(genes.unsqueeze(0), with_grad=False)
        run = problem.run(genes.unsqueeze(0), with_grad=False)
        gait = problem.gait(genes.unsqueeze(0))
        motion = stride_motion(gait, MEASURING_FPS)
        solved = problem.solved(genes.unsqueeze(0))
    left, right = gait.contact_times[0].tolist()
    terms = {name: float(value) for name, value in evaluation.terms.items()}
    flights = gait.flight_times[0]
    stride = float(gait.stride_time[0])
    contact, flight = 0.5 * (left + right), float(flights.mean())
    step = 0.5 * stride
    target, energy = energy_target(problem.beta), terms["energy"]
    gamma = _rate_gaps(solved)
    work = float(run.external_work())
    muscle = {name: terms.get(name, 0.0) for name in ("positive_work", "negative_work")}
    return {
        "speed": problem.speed,
        "beta": problem.beta,
        "froude": problem.froude,
        "leg_length": problem.character.leg_length,
        "cost": float(evaluation.cost),
        "eval": 1.0 - 0.5 / (1.0 + gamma) - 0.5 / (1.0 + (target - energy) ** 2),
        "gamma": gamma,
        "energy_rate": energy,
        "energy_rate_raw": work,
        "energy_unit": work if problem.least is None else problem.least.external_work,
        "energy_target": target,
        "external_work": work,
        "cost_of_transport": sum(muscle.values()),
        **{f"cost_{name}": value for name, value in terms.items() if name != "energy"},
        "contact_time": contact,
        "contact_time_left": left,
        "contact_time_right": right,
        "flight_time": flight,
        "flight_share": flight / step,
        "step_frequency": 1.0 / step,
        "step_length": problem.speed * step,
        "step_width": float(problem.table.decode(genes.unsqueeze(0))["step_width"]),
        "stride_time": stride,
        "duty_factor": contact / stride,
        **body_motion_metrics(motion),
        **_physics(solved),
        **_torques(solved),
        "arm_swing_deg": math.degrees(float(arm_swing(solved))),
        "stance_leg_reach": float(torch.cat(solved.body.reach, dim=-1).max()),
    }


def body_motion_metrics(motion: Motion) -> dict[str, float]:
    """What can be read off the finished frames alone."""
    assert motion.force is not None
    assert motion.cop is not None
    knees = torch.stack([motion.angles[f"{side}_knee"] for side in SIDES], dim=-1)
    height = motion.com[:-1, 1]
    force = motion.force
    lift = force[..., 1]
    firm = lift > FIRM
    sideways = torch.sqrt(force[..., 0] ** 2 + force[..., 2] ** 2)

    def spread(name: str) -> float:
        return math.degrees(float(motion.angles[name].max() - motion.angles[name].min()))

    return {
        "com_oscillation": float(height.max() - height.min()),
        "com_side_range": float(motion.com[:, 0].max() - motion.com[:, 0].min()),
        "peak_leg_force_bw": float(motion.leg_force.max()),
        "peak_force_bw": float(lift.max()),
        "least_force_bw": float(lift[motion.contact].min()),
        "friction_needed": float((sideways[firm] / lift[firm]).max()),
        "knee_touchdown_deg": math.degrees(float(knees[0, 0])),
        "knee_takeoff_deg": math.degrees(_at_takeoff(motion)),
        "knee_stance_max_deg": math.degrees(float(knees[motion.contact].max())),
        "knee_swing_max_deg": math.degrees(float(knees[~motion.contact].max())),
        "trunk_lean_deg": math.degrees(float(motion.angles["trunk"][:-1].mean())),
        "trunk_lean_range_deg": spread("trunk"),
        "trunk_side_deg": -math.degrees(float(motion.angles["trunk_side"][:-1].mean())),
        "trunk_side_range_deg": spread("trunk_side"),
        "pelvis_roll_range_deg": spread("pelvis_roll"),
        "pelvis_yaw_range_deg": spread("pelvis_yaw"),
        "loop_error": joint_gap(motion),
        **_feet(motion),
    }


def _at_takeoff(motion: Motion) -> float:
    """Flexion of the left knee in the last frame of its stance [rad]."""
    last = int(motion.contact[: len(motion.times) // 2, 0].nonzero().max())
    return float(motion.angles["left_knee"][last])


def joint_gap(motion: Motion) -> float:
    """Largest difference between first and last frame, the way aside: places of joints [m]."""
    places, _ = motion.clip.forward()
    way = motion.clip.root_position[-1] - motion.clip.root_position[0]
    ahead = way * way.new_tensor((0.0, 0.0, 1.0))
    return float((places[-1] - places[0] - ahead).norm(dim=-1).max())


def _feet(motion: Motion) -> dict[str, float]:
    """How feet stand: slip of the sole where it is pressed [m], lowest point of heels and balls [m], and by how much
    the centre of pressure leaves the line from heel to toe [m]."""
    assert motion.cop is not None
    skeleton = motion.clip.skeleton
    places, frames = motion.clip.forward()
    slips, lows, excess = [], [], []
    for k, side in enumerate(SIDES):
        ankle, toe = skeleton.index(f"{side}_ankle"), skeleton.index(f"{side}_toe")
        turn, where = frames[:, ankle], places[:, ankle]
        ball, tip = skeleton.offsets[toe], skeleton.offsets[toe] + skeleton.end_sites[f"{side}_toe"]
        heel = ball * ball.new_tensor((1.0, 1.0, 0.0)) - ball.new_tensor((0.0, 0.0, 1.0)) * float(ball[2]) * HEEL / BALL
        standing = motion.contact[:, k]
        cop = motion.cop[:, k]
        # The point of the foot that is under the pressure now, half a frame before and after.
        local = (turn.transpose(-1, -2) @ (cop - where).unsqueeze(-1)).squeeze(-1)
        ahead = (turn[1:] @ local[:-1].unsqueeze(-1)).squeeze(-1) + where[1:] - cop[:-1]
        behind = (turn[:-1] @ local[1:].unsqueeze(-1)).squeeze(-1) + where[:-1] - cop[1:]
        moved = 0.5 * ((ahead - behind) * ahead.new_tensor((1.0, 0.0, 1.0))).norm(dim=-1)
        both = standing[1:] & standing[:-1]
        # Summed over each stance by itself.
        number = torch.cumsum((both & ~torch.cat((both.new_zeros(1), both[:-1]))).long(), dim=0)
        slips.append(float(torch.zeros(int(number.max()) + 1).to(moved).index_add(0, number, moved * both).max()))
        points = torch.stack([(turn @ point.unsqueeze(-1)).squeeze(-1) + where for point in (heel, ball)], dim=1)
        lows.append(float(points[..., 1].min()))
        heading = (turn @ (tip - heel).unsqueeze(-1)).squeeze(-1) * tip.new_tensor((1.0, 0.0, 1.0))
        heading = heading / heading.norm(dim=-1, keepdim=True)
        first = ((points[:, 0] - cop) * heading).sum(-1)
        last = ((cop - where) * heading).sum(-1) - float(tip[2])
        excess.append(float(torch.maximum(first, last)[standing].max()))
    return {"foot_slip": max(slips), "min_foot_clearance": min(lows), "cop_excess": max(*excess, 0.0)}


def standing_feet(motion: Motion) -> dict[str, float]:
    """foot_slip: longest way of a sole's point of contact over the ground in a stance [m]. min_foot_clearance: lowest
    point of heels and balls [m]. cop_excess: how far the centre of pressure leaves the sole [m].
    """
    return _feet(motion)


def _physics(run: Priced) -> dict[str, float]:
    """How well the body does what the force asks, on the nodes of the solution."""
    movement, body = run.movement, run.body
    grid, mass = movement.grid, movement.layout.mass
    centre = torch.einsum("s,psim->pim", movement.shares, body.centres)
    acceleration = grid.derivative(grid.derivative(centre))
    gap = acceleration - body.carried.force.sum(1) + centre.new_tensor((0.0, GRAVITY, 0.0))[:, None]
    size = gap[0].norm(dim=0) / GRAVITY
    flying = {phase for phase in range(len(grid.nodes)) if phase not in movement.plan.standing}
    air = torch.zeros(grid.size, dtype=torch.bool, device=size.device)
    for phase in flying:
        air[grid.slice(phase)] = True
    spin = movement.momentum(body)[0] * mass
    drift = 0.0
    for phase in flying:
        here = grid.slice(phase)
        drift = max(drift, float((spin[:, here].amax(-1) - spin[:, here].amin(-1)).max()))
    moments = run.dynamics.residual[0].norm(dim=0) * mass
    return {
        "flight_residual_bw": float(size[air].max()) if bool(air.any()) else 0.0,
        "stance_residual_bw": float(size[~air].max()),
        "moment_residual_nm": float(moments.max()),
        "momentum_drift": drift,
    }


def _torques(run: Priced) -> dict[str, float]:
    """Largest torque at every kind of joint and axis [Nm]."""
    largest: dict[str, float] = {}
    torque = run.dynamics.torque[0].abs().amax(-1) * run.movement.layout.mass
    for k, segment in enumerate(SEGMENTS[1:]):
        for axis, name in enumerate(AXES):
            key = f"torque_{JOINT_KINDS[segment]}_{name}_nm"
            largest[key] = max(largest.get(key, 0.0), float(torque[k, axis]))
    return largest


def _rate_gaps(run: Priced) -> float:
    """gamma of Kang (1999), equation (12), in its bounded form: jumps of hip and knee rates at take-off."""
    angles = torch.stack((run.body.angles.thigh, run.body.angles.knee), dim=1)[0].flatten(0, 1)
    grid = run.movement.grid
    rates = grid.derivative(angles.unsqueeze(0))[0]
    end = grid.slice(0).stop
    before, after = rates[:, end - 1], rates[:, end]
    return float(((after - before) ** 2 / (before**2 + after**2 + 1.0)).sum())
