"""The motion channels of the eleven joints: about which axis each turns which joint, and to which side.

Everything that turns channels into motion reads this: the rotations of joints, the written-out kinematics of the
search, and the mirror image.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from torch import Tensor

SIDES = {"left": 1.0, "right": -1.0}


class Turn(NamedTuple):
    """A rotation by sign * channel about an axis: "X" to the left, "Y" up, "Z" forward. sided: whether the sign is that
    of the side of the body, so that the channel means the same on both."""

    channel: str
    axis: str
    sign: float
    sided: bool = False

    def angle(self, channels: Mapping[str, Tensor]) -> Tensor:
        """What it turns by [rad], in the shape of its channel."""
        value = channels[self.channel]
        if self.sided:
            return self.sign * value
        return value if self.sign > 0 else -value


# From the outside in, in the order in which matrices are multiplied. Pelvis and trunk are attitudes in the world.
PELVIS = (Turn("pelvis_yaw", "Y", 1.0), Turn("pelvis_roll", "Z", 1.0), Turn("pelvis_tilt", "X", 1.0))
TRUNK = (Turn("trunk_yaw", "Y", 1.0), Turn("trunk_side", "Z", 1.0), Turn("trunk_lean", "X", 1.0))
# The head looks ahead: the yaw of the trunk is undone.
NECK = (Turn("trunk_yaw", "Y", -1.0), Turn("neck_side", "Z", 1.0), Turn("neck_flex", "X", 1.0))
SHOULDERS = {
    side: (
        Turn(f"{side}_abduction", "Z", sign, sided=True),
        Turn(f"{side}_shoulder", "X", -1.0),
        Turn(f"{side}_inward", "Y", -sign, sided=True),
    )
    for side, sign in SIDES.items()
}
ELBOWS = {side: (Turn(f"{side}_elbow", "X", -1.0),) for side in SIDES}
# Attitude of the thigh in the world.
HIPS = {side: (Turn(f"{side}_tilt", "Z", 1.0), Turn(f"{side}_thigh", "X", -1.0)) for side in SIDES}
KNEES = {side: (Turn(f"{side}_knee", "X", 1.0),) for side in SIDES}


# Channels whose mirror image has the other sign: of turns about an axis in the plane of symmetry, unless they are told
# by the side.
CHANGING = frozenset(
    turn.channel
    for turns in (PELVIS, TRUNK, NECK, *HIPS.values(), *KNEES.values(), *SHOULDERS.values(), *ELBOWS.values())
    for turn in turns
    if turn.axis != "X" and not turn.sided
)
