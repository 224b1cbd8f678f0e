"""The genes of a whole-body movement: their names, and the open interval in which each makes sense."""

from __future__ import annotations

from hopdiff.whole_body.swing import ANKLE_MOMENTS, MOMENTS

_ANGLE = (-180.0, 180.0)
BODY_GENES: dict[str, tuple[float, float]] = {
    "step_time": (0.0, 20.0),
    "contact_share": (0.0, 2.0),
    **{f"force_{k}": (-5.0, 5.0) for k in (2, 3, 4)},
    "aim_below": (-5.0, 5.0),
    "aim_sway": (-1.0, 1.0),
    "foot_touchdown": (-80.0, 80.0),
    "foot_settle": (-1.0, 1e3),
    "foot_slap": (-1.0, 1e3),
    "foot_rise": (2.0, 20.0),
    "reach_touchdown": (0.5, 0.998),
    "reach_takeoff": (0.5, 0.998),
    "step_width": (-1.0, 1.0),
    **{f"swing_{part}_{k}": _ANGLE for part in ("thigh", "knee") for k in range(1, len(MOMENTS) + 1)},
    **{f"swing_ankle_{k}": _ANGLE for k in range(1, len(ANKLE_MOMENTS) + 1)},
    "pelvis_tilt": (-90.0, 90.0),
    **{f"pelvis_{axis}_{wave}": (-90.0, 90.0) for axis in ("roll", "yaw") for wave in ("cos", "sin")},
    "trunk_lean": (-90.0, 90.0),
    **{f"shoulder_{part}": _ANGLE for part in ("mean", "cos", "sin")},
    **{f"elbow_{part}": _ANGLE for part in ("mean", "cos", "sin")},
    "arm_abduction": (-90.0, 180.0),
    "arm_inward": (-90.0, 180.0),
}
