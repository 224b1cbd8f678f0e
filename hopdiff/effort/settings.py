# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a whole-body run is judged by: weights and limits, all of them numbers without units unless a name tells one.

Their defaults stand in conf/costs/.
"""

from dataclasses import dataclass
from typing import Any


@dataclass
class LeastSettings:
    """The run of least cost at this speed, which the energy is told in: its external work, in body weights times the
    way, and its contact time [s]. Where they are null that run is searched for first.
    """

    external_work: float | None
    contact_time: float | None


@dataclass
class HumanSettings:
    """Wishes about posture, each with a weight; weight 0 switches a wish off. They are what people do, put in.

    trunk_lean_deg: mean lean of the chest. pelvis_drop_deg: by how much the swing side of the pelvis is lower in
    mid-stance. pelvis_yaw_deg: how far the landing side of the pelvis is turned back at touchdown. arm_swing_deg: least
    swing of the shoulders, root mean square, times the energy asked for, in that of the least run, to the power
    arm_growth. swing_knee_deg: largest flexion in the air, a number or a table over the Froude speed.
    """

    trunk_lean_deg: float
    trunk_lean: float
    pelvis_drop_deg: float
    pelvis_drop: float
    pelvis_yaw_deg: float
    pelvis_yaw: float
    arm_swing_deg: float
    arm_growth: float
    arm_swing: float
    swing_knee_deg: Any
    swing_knee: float


@dataclass
class BodyLimits:
    """Limits of what is possible. clearance: of heel and ball half-way through the swing [leg lengths]; apart: of the
    knees, and of the ankles, sideways [leg lengths]. knee_deg, ankle_deg, hip_deg, elbow_deg: flexion,
    low and high.
    """

    friction: float
    clearance: float
    apart: float
    flight_time: float
    reach: float
    knee_deg: list[float]
    ankle_deg: list[float]
    hip_deg: list[float]
    elbow_deg: list[float]
    weight: float


@dataclass
class EffortSettings:
    """The cost of a run, in body weights times the way: weights of work, torque and its rate, and what is asked.

    positive_work, negative_work: of the muscles. torque: of the squares of torques over strength, per time sqrt(l/g).
    torque_rate: of the squares of their rates, over the same. transfer: share of a leg's power that passes between
    its joints (muscles that span two), 0 to 1. steady: mean square yaw of the chest. strength: by joint, of flexion,
    turn and sideways, in m g l; a pair where the two directions differ, null where an axis is passive. tendon:
    stiffness in m g l per rad. ankle_stiffness, ankle_rest_deg: what ligaments and resting muscles hold the foot with
    [m g l per rad], and where (toes up positive).
    extra: weights of terms that have no setting of their own.
    energy: of the squared relative distance from the energy target. contact_cap: of contacts longer than those of the
    least run, as squares of a tenth. scale: exponent with which the energy grows with the thesis' target.
    """

    name: str
    positive_work: float
    negative_work: float
    torque: float
    torque_rate: float
    transfer: float
    steady: float
    energy: float
    contact_cap: float
    scale: float
    least: LeastSettings
    human: HumanSettings
    limits: BodyLimits
    strength: dict[str, list[Any]]
    tendon: dict[str, float]
    ankle_stiffness: float
    ankle_rest_deg: float
    extra: dict[str, float]
