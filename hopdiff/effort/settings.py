# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a whole-body run is judged by: weights and limits, all of them numbers without units unless a name tells one."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class LeastSettings:
    """The run of least cost at this speed, which the energy is told in: its external work, in body weights times the
    way, and its contact time [s]. Where they are null that run is searched for first.
    """

    external_work: float | None = None
    contact_time: float | None = None


@dataclass
class HumanSettings:
    """Wishes about posture, each with a weight; weight 0 switches a wish off. They are what people do, put in.

    trunk_lean_deg: mean lean of the chest. pelvis_drop_deg: by how much the swing side of the pelvis is lower in
    mid-stance. pelvis_yaw_deg: how far the landing side of the pelvis is turned back at touchdown. arm_swing_deg: least
    swing of the shoulders, root mean square, times the energy asked for, in that of the least run, to the power
    arm_growth. swing_knee_deg: largest flexion in the air, a number or a table over the Froude speed.
    """

    trunk_lean_deg: float = 10.0
    trunk_lean: float = 0.0
    pelvis_drop_deg: float = 4.5
    pelvis_drop: float = 0.0
    pelvis_yaw_deg: float = 4.0
    pelvis_yaw: float = 0.0
    arm_swing_deg: float = 16.0
    arm_growth: float = 2.0
    arm_swing: float = 0.0
    swing_knee_deg: Any = 105.0
    swing_knee: float = 0.0


@dataclass
class BodyLimits:
    """Limits of what is possible. clearance: of heel and ball half-way through the swing [leg lengths]; apart: of the
    knees, and of the ankles, sideways [leg lengths]. knee_deg, ankle_deg, hip_deg, elbow_deg: flexion,
    low and high.
    """

    friction: float = 0.54
    clearance: float = 0.065
    apart: float = 0.054
    flight_time: float = 0.16
    reach: float = 0.997
    knee_deg: list[float] = field(default_factory=lambda: [4.0, 145.0])
    ankle_deg: list[float] = field(default_factory=lambda: [-30.0, 32.0])
    hip_deg: list[float] = field(default_factory=lambda: [-28.0, 120.0])
    elbow_deg: list[float] = field(default_factory=lambda: [5.0, 145.0])
    weight: float = 1.5


@dataclass
class EffortSettings:
    """The cost of a run, in body weights times the way: weights of work, torque and its rate, and what is asked.

    positive_work, negative_work: of the muscles. torque: of the squares of torques over strength, per time sqrt(l/g).
    torque_rate: of the squares of their rates, over the same. transfer: share of a leg's power that passes between
    its joints (muscles that span two), 0 to 1. steady: mean square yaw of the chest. strength: by joint, of flexion,
    turn and sideways, in m g l; a pair where the two directions differ, null where an axis is passive. tendon:
    stiffness in m g l per rad. ankle_stiffness, ankle_rest_deg: what ligaments and resting muscles hold the foot with
    [m g l per rad], and where (toes up positive).
    energy: of the squared relative distance from the energy target. contact_cap: of contacts longer than those of the
    least run, as squares of a tenth. scale: exponent with which the energy grows with the thesis' target.
    """

    name: str = "effort"
    positive_work: float = 4.0
    negative_work: float = 0.8333
    torque: float = 0.07
    torque_rate: float = 0.0018
    transfer: float = 1.0
    steady: float = 0.03
    energy: float = 400.0
    contact_cap: float = 1.2
    scale: float = 0.15
    least: LeastSettings = field(default_factory=LeastSettings)
    human: HumanSettings = field(default_factory=HumanSettings)
    limits: BodyLimits = field(default_factory=BodyLimits)
    strength: dict[str, list[Any]] = field(default_factory=dict)
    tendon: dict[str, float] = field(default_factory=dict)
    ankle_stiffness: float = 0.03
    ankle_rest_deg: float = -12.0
