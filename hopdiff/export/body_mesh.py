"""A body to look at, around the bones of a skeleton in its rest pose: made by rule, as tall and thick as they say.

A mannequin: head with a face, trunk, limbs that keep their volume when they bend, hands, and feet that bend at the
ball. Lengths are those of the bones; parts are as thick as their masses make them at the density of water. Colours tell
left from right.
"""

from __future__ import annotations

from collections.abc import Mapping

from hopdiff.export.body.build import Build
from hopdiff.export.body.feet import foot
from hopdiff.export.body.head import head, skull_of
from hopdiff.export.body.limbs import arm, leg
from hopdiff.export.body.loft import Surface, joined
from hopdiff.export.body.plain import bones
from hopdiff.export.body.trunk import neck_base, trunk
from hopdiff.geometry.joint_names import SIDES
from hopdiff.geometry.skeleton import Skeleton


def body_mesh(
    skeleton: Skeleton, masses: Mapping[str, float] | None = None, parts: Mapping[str, str] | None = None
) -> dict[str, Surface]:
    """Surfaces by side: left, right and middle, in the rest pose with joint 0 at the origin [m].

    masses: of the eleven segments of hopdiff's bodies [kg] by joint; None for those of an ordinary build. parts:
    of the body -> joint; None where names and shape tell them. Then joints that are no part get plain bones, otherwise
    nothing: what else hangs on a character of others moves no flesh of its own.
    """
    body = Build.of(skeleton, masses, parts)
    for side in SIDES:
        leg(body, side)
        arm(body, side)
        foot(body, side)
    skull = skull_of(body, neck_base(body))
    trunk(body, skull)
    if skull is not None:
        head(body, skull)
    bones(body)
    return {side: joined(surfaces) for side, surfaces in body.made.items() if surfaces}
