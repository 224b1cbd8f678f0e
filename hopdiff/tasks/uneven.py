"""A run on level ground put on uneven ground: its exact contacts are planted there, and the body follows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import Leg, find_legs
from hopdiff.effort.metrics import standing_feet
from hopdiff.feet.contacts import Contacts, contact_points, known_contacts, slide_numbers
from hopdiff.feet.planting import clean_feet
from hopdiff.feet.track import turned
from hopdiff.geometry.clip import Clip
from hopdiff.io.run_folder import Note
from hopdiff.motion import SIDES, Motion
from hopdiff.terrain.ground import Ground

NOTED = 0.02  # share of the contacts' frames that may be given up without a word


@dataclass(frozen=True, eq=False)
class Raised:
    """motion: on the ground. numbers: how it stands there, for metrics.json."""

    motion: Motion
    numbers: dict[str, float]


def on_ground(motion: Motion, ground: Ground) -> Raised:
    """A run on level ground, on another ground.

    Feet come down on it and turn with it, the body follows the ground under its feet. Forces, angles and phases stay
    those of the level run; the centre of mass goes with the pelvis. numbers: ground_rise, from the lowest ground under
    the pelvis to the highest [m]; ground_lowered, by how much that is lowered at most, where legs are too short [m];
    ground_given_up, share of the contacts' frames in which a foot cannot reach its place; ground_depth, ground_gap:
    deepest that a standing point of a foot is in the ground, and highest above it [m]; foot_slide_max: longest way of
    the point that a foot stands on over the ground [m]; min_foot_clearance: of all feet above the ground [m].
    """
    if ground.flat:
        return Raised(motion, {})
    clip = motion.clip
    contacts = exact_contacts(motion)
    planted = clean_feet(clip, clip, contacts, ground)
    stands = planted.touching.to(motion.contact.device)
    feet = _with_feet(motion.feet, clip, planted.clip, contacts.legs)
    cop = None if motion.cop is None else _with_feet(motion.cop, clip, planted.clip, contacts.legs)
    lifted = planted.clip.root_position - clip.root_position
    target = motion.com_target.clone()
    target[:, 1] += ground.height(target[:, [0, 2]]).to(target)
    raised = replace(
        motion,
        clip=planted.clip,
        contact=stands,
        feet=feet,
        com=motion.com + lifted.to(motion.com),
        com_target=target,
        cop=cop,
    )
    off = ground.above(contact_points(planted.clip, contacts)) - contacts.heights()
    standing = planted.kept(contacts)
    held = off[standing]
    if cop is None:
        slide = slide_numbers(planted.clip, replace(contacts, touching=standing))["drift"]
    else:
        slide = standing_feet(raised)["foot_slip"]
    heights = ground.height(clip.root_position[:, [0, 2]])
    return Raised(
        raised,
        {
            "ground_rise": float(heights.max() - heights.min()),
            "ground_lowered": float(planted.lowered.max()),
            "ground_given_up": float(planted.given_up.sum()) / max(1, int(motion.contact.sum())),
            "ground_depth": max(0.0, -float(held.min())) if len(held) else 0.0,
            "ground_gap": max(0.0, float(held.max())) if len(held) else 0.0,
            "foot_slide_max": slide,
            "min_foot_clearance": float(ground.above(feet).min()),
        },
    )


def ground_rows(metrics: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the table at the end says of the ground; nothing of level ground."""
    if "ground_rise" not in metrics:
        return []
    m = metrics
    rise, depth, gap = m["ground_rise"], 1000 * m["ground_depth"], 1000 * m["ground_gap"]
    return [("ground", f"rises by {rise:.2f} m; standing feet up to {depth:.0f} mm in it and {gap:.0f} mm above it")]


def ground_notes(metrics: Mapping[str, Any]) -> list[Note]:
    """A warning where feet do not reach the ground as long as they should."""
    share = metrics.get("ground_given_up", 0.0)
    if share <= NOTED:
        return []
    return [Note("ground", f"feet leave the ground {100 * share:.0f} % sooner than on level ground: it is too steep.")]


def exact_contacts(motion: Motion) -> Contacts:
    """The contacts of a run, whose feet are known to stand."""
    legs = find_legs(motion.clip.skeleton)
    return known_contacts(motion.clip, legs, motion.contact.cpu()[:, [SIDES.index(leg.side) for leg in legs]])


def _with_feet(points: Tensor, before: Clip, after: Clip, legs: tuple[Leg, ...]) -> Tensor:
    """Points (T, 2, 3) of the left and the right foot, taken along by it from one clip to another."""
    old, new = before.forward(), after.forward()
    moved = []
    for leg in sorted(legs, key=lambda leg: SIDES.index(leg.side)):
        joint = leg.knee if leg.ankle is None else leg.ankle
        turn = new[1][:, joint] @ old[1][:, joint].transpose(-1, -2)
        own = points[:, SIDES.index(leg.side)]
        moved.append(new[0][:, joint] + turned(turn, own - old[0][:, joint]))
    return torch.stack(moved, dim=1).to(points)
