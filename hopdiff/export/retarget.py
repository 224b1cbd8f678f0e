"""A finished motion on another body: a user's own skeleton, given as a BVH or a GLB file.

Thighs, shanks, arms and the line of the back point where the source's do, in every frame. Hands, feet, neck and head
are shaped for the body that they are in, so they are turned from its rest pose as the source's are from theirs: a sole
that is level stays level, however high the ankle is above it.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import SIDES
from hopdiff.export.contact_events import contact_events, with_feet
from hopdiff.export.full_body import full_body, is_model_body
from hopdiff.export.glb import clip_extras
from hopdiff.export.hanging import TRUNK
from hopdiff.export.mapping import few
from hopdiff.export.planting import Sole, foot_points, planted
from hopdiff.export.prepare import with_way_on_root
from hopdiff.export.skin_check import SkinCheck, check_skin
from hopdiff.export.take import Take
from hopdiff.export.target import Target, body_of, target_of
from hopdiff.export.target_file import read_target
from hopdiff.feet.contacts import spans
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation, between_directions
from hopdiff.io.bvh import BvhFile
from hopdiff.io.files import write_whole
from hopdiff.io.glb_file import Animation, GlbFile
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS

__all__ = ["Target", "read_target", "retargeted", "target_of", "transferred", "write_retargeted"]

FLAT = 1e-3  # m: shorter bones have no direction
# Numbers of a run that hold on another body: as they are, and in the ratio of the legs.
TIMES = (
    *("beta", "turn", "contact_time", "flight_time", "flight_share", "step_frequency", "stride_time", "duty_factor"),
    *("search", "model", "seed", "frames", "frame_time"),
)
LENGTHS = ("speed", "step_length", "step_width", "com_oscillation", "com_side_range")
ON_GROUND_ROOT = 0.02  # of a leg's length that a root joint on the ground may be off it
ON_GROUND = 1e-3  # m off y = 0 that contact points of our own runs may be
# Bones that point where the source's do: joint -> what hangs on it, without the side.
_LIMBS = {"hip": "knee", "knee": "ankle", "shoulder": "elbow", "elbow": "wrist"}
# What is turned in the rest pose as the part before it, to begin with.
_BEFORE = {"knee": "hip", "elbow": "shoulder", "wrist": "elbow", "toe": "ankle"}
_TOPS = (("neck",), ("head",), ("left_shoulder", "right_shoulder"))  # where the line of the trunk ends


def retargeted(take: Take, target: Target) -> Take:
    """The motion of a take on another body, feet planted on the ground y = 0.

    Every place is scaled by the ratio of the legs' lengths and time stays as it is, so the speed goes with the legs.
    The result has the target's joints, names and bones; joints that are no known part stay as in the rest pose. While a
    foot of the source stands, that of the target does not slide; what a loop ends with is what it began with. A root
    joint on the ground carries the steady way in GLB files.
    numbers: what holds for this body, too, lengths and speed scaled; body, parts found, and leg_ratio. Apply this to
    motions that travel: those in place slide over the ground.
    Contacts begin and end when the source's do.
    Raises HopdiffError if the parts of the take's own skeleton cannot be told.
    """
    if is_model_body(take.clip.skeleton) and take.contact is not None:
        take = full_body(take)
    source = body_of(take.name, take.clip)
    ratio = target.standing() / source.standing()
    clip = transferred(take, source, target)
    soles, contact, feet = [Sole.of(target, leg) for leg in target.legs], take.contact, None
    if contact is not None:
        clip = planted(clip, soles, contact, take.loop)
        feet = foot_points(clip, soles)
    clip = replace(clip, skeleton=target.skeleton, rotations=target.own_frames(clip.rotations))
    numbers = {name: value for name, value in take.numbers.items() if name in TIMES}
    numbers |= {name: ratio * take.numbers[name] for name in LENGTHS if isinstance(take.numbers.get(name), float)}
    numbers |= {"body": Path(target.name).name, "parts": target.report().count, "leg_ratio": ratio}
    unknown: dict[str, Any] = dict.fromkeys(("com", "leg_force", "masses", "force", "cop", "segments"))
    parts = {part: target.skeleton.names[joint] for part, joint in target.parts.items()}
    found = replace(take, clip=clip, feet=feet, numbers=numbers, parts=parts, **unknown)
    found = with_feet(found, contact_events(take))
    return with_way_on_root(found, target.parts["pelvis"]) if _ground_root(target) else found


def _ground_root(target: Target) -> bool:
    """Whether the root joint is there to carry the way, as in Unreal Engine. Joints below it move in GLB files only."""
    grounded = abs(float(target.places[0, 1])) < ON_GROUND_ROOT * target.standing()
    return isinstance(target.file, GlbFile) and target.parts["pelvis"] > 0 and grounded


def transferred(take: Take, source: Target, target: Target) -> Clip:
    """The poses of a take on another body before its feet are planted, on `target.aligned`.

    source: the body of the take. The middle between the hips is where the source's is, from its ground and scaled.
    """
    positions, orientations = take.clip.forward()
    turned = orientations @ source.rest.transpose(-1, -2)
    whole = _alignments(source, target)
    skeleton, frames = target.aligned, list[Tensor]()
    lines: dict[int, Tensor] = {}
    for part in whole:
        lines[target.parts[part]] = turned[:, source.parts[_origin(part, source, target)]] @ whole[part]
        ours, theirs = _bone(target, part), _bone_now(source, part, positions, orientations)
        if ours is not None and theirs is not None:
            # Nothing, unless joints between the two bend the source's bone.
            now = lines[target.parts[part]]
            lines[target.parts[part]] = between_directions(now @ ours, theirs) @ now
    pelvis = lines[target.parts["pelvis"]]
    yaw = torch.atan2(pelvis[:, 0, 2] - pelvis[:, 2, 0], pelvis[:, 0, 0] + pelvis[:, 2, 2])
    for joint, parent in enumerate(skeleton.parents):
        if joint in lines:
            frames.append(lines[joint])
        else:
            # A root above the pelvis heads where the body does.
            frames.append(frames[parent] if parent >= 0 else axis_rotation("Y", yaw))
    above = [frames[p] if p >= 0 else torch.eye(3, dtype=torch.float64).expand_as(pelvis) for p in skeleton.parents]
    rotations = torch.stack([a.transpose(-1, -2) @ b for a, b in zip(above, frames, strict=True)], dim=1)
    ratio = target.standing() / source.standing()
    hips = positions[:, [source.parts[f"{side}_hip"] for side in SIDES]].mean(dim=1)
    hips = ratio * (hips - hips.new_tensor((0.0, _ground(take, source), 0.0)))
    own = skeleton.forward(torch.zeros_like(hips), rotations)[0]
    root = hips - own[:, [target.parts[f"{side}_hip"] for side in SIDES]].mean(dim=1)
    return Clip(skeleton, root, rotations, take.clip.frame_time)


def _origin(part: str, source: Target, target: Target) -> str:
    """The part of the source that turns a part of the target: the highest of the trunk turns the highest."""
    trunk = [[name for name in TRUNK if name in body.parts] for body in (source, target)]
    return trunk[0][-1] if trunk[0] and trunk[1] and part == trunk[1][-1] else part


def _alignments(source: Target, target: Target) -> dict[str, Tensor]:
    """Part -> (3, 3) what turns it from the rest pose of the target into that of the source, parents first."""
    body = axis_rotation("Y", torch.tensor(source.facing() - target.facing(), dtype=torch.float64))
    found = {"pelvis": body}
    trunk = _trunk(source, target, body)
    for part in JOINTS[1:]:
        if part not in target.parts or _origin(part, source, target) not in source.parts:
            continue
        side, _, name = part.rpartition("_")
        if side not in SIDES:
            side, name = "", part
        if name in _LIMBS:
            before = found.get(f"{side}_{_BEFORE.get(name)}", body if name in ("hip", "knee") else trunk)
            ours, theirs = _bone(target, part), _bone(source, part)
            if ours is not None and theirs is not None:
                before = between_directions(before @ ours, theirs) @ before
            found[part] = before
        elif name == "ankle":
            found[part] = _heading(source, target, part, body)
        elif part in TRUNK or name == "collar":
            found[part] = trunk
        else:
            found[part] = found.get(f"{side}_{_BEFORE[name]}", body) if side else body
    return found


def _trunk(source: Target, target: Target, body: Tensor) -> Tensor:
    """(3, 3) of the whole trunk: its line, from its lowest joint to the neck, points where the source's does."""
    lines = []
    tops = next((top for top in _TOPS if all(part in one.parts for one in (source, target) for part in top)), None)
    for one in (source, target):
        low = next((one.parts[part] for part in TRUNK if part in one.parts), None)
        if low is None or tops is None:
            return body
        lines.append(one.places[[one.parts[part] for part in tops]].mean(dim=0) - one.places[low])
    if min(float(line.norm()) for line in lines) < FLAT:
        return body
    return between_directions(body @ lines[1], lines[0]) @ body


def _heading(source: Target, target: Target, part: str, body: Tensor) -> Tensor:
    """(3, 3) of a foot: level stays level, and it heads where the source's does."""
    headings = []
    for one in (source, target):
        joint = one.parts[part]
        toe = one.parts.get(part.replace("ankle", "toe"))
        line = one.end_of(joint) if toe is None else one.places[toe] - one.places[joint]
        headings.append(None if line is None else line * line.new_tensor((1.0, 0.0, 1.0)))
    theirs, ours = headings
    if theirs is None or ours is None or min(float(theirs.norm()), float(ours.norm())) < FLAT:
        return body
    return between_directions(body @ ours, theirs) @ body


def _next(body: Target, part: str) -> int | None:
    """The joint at the other end of a limb's bone; None if it is an end site, or there is no such bone."""
    side, _, name = part.rpartition("_")
    return body.parts.get(f"{side}_{_LIMBS[name]}") if name in _LIMBS and side in SIDES else None


def _bone(body: Target, part: str) -> Tensor | None:
    """(3,) from joint to joint of a limb in the rest pose; None if it has no length, or is none."""
    if part.rpartition("_")[2] not in _LIMBS:
        return None
    joint, far = body.parts[part], _next(body, part)
    bone = body.end_of(joint) if far is None else body.places[far] - body.places[joint]
    return None if bone is None or float(bone.norm()) < FLAT else bone


def _bone_now(body: Target, part: str, positions: Tensor, orientations: Tensor) -> Tensor | None:
    """(T, 3) the same in every frame."""
    if part not in body.parts or _bone(body, part) is None:
        return None
    joint, far = body.parts[part], _next(body, part)
    if far is not None:
        return positions[:, far] - positions[:, joint]
    return orientations[:, joint] @ body.skeleton.end_sites[body.skeleton.names[joint]]


def _ground(take: Take, source: Target) -> float:
    """Height of the ground that a take is on [m]: in captured motions it need not be 0."""
    if take.contact is None or take.feet is None or not bool(take.contact.any()):
        return 0.0
    if float(take.feet[take.contact][:, 1].abs().max()) < ON_GROUND:
        return 0.0
    positions, frames = take.clip.forward()
    frames = frames @ source.rest.transpose(-1, -2)
    heights = []
    for k, leg in enumerate(source.legs):
        lowest = Sole.of(source, leg).points(frames)[..., 1].amin(dim=1)
        end = take.clip.end_positions().get(source.skeleton.names[leg.knee])
        ankle = positions[:, leg.ankle, 1] if leg.ankle is not None or end is None else end[:, 1]
        heights += [(lowest + ankle)[first : last + 1].min() for first, last in spans(take.contact[:, k])]
    return float(torch.stack(heights).median())


def write_retargeted(path: str | os.PathLike[str], takes: Sequence[Take], target: Target) -> list[SkinCheck]:
    """Write takes that `retargeted` made into the target's own file; it appears whole or not at all.

    A BVH file keeps its names, offsets, channels, unit and axes and has the new motion, only one, in place of its own;
    a GLB file keeps all that it has and gets one more animation for each take. Returns how the skin of a GLB file
    follows each, where it can be read. Raises HopdiffError if the file's suffix is another, a joint lacks a channel
    that the motion needs, the skin of a GLB file would tear, or the file cannot be written.
    """
    if Path(path).suffix.lower() != target.suffix:
        raise HopdiffError(f"{path}: a motion on {target.name} is written into a {target.suffix} file.")
    match target.file:
        case BvhFile() as file:
            if len(takes) != 1:
                raise HopdiffError(f"cannot write {len(takes)} motions into {path}: a BVH file holds one.")
            clip = takes[0].clip
            width = sum(len(joint.channels) for joint in file.joints)
            values = file.values[:1] if file.frames else torch.zeros(1, width, dtype=torch.float64)
            replace(file, values=values, frame_time=clip.frame_time).with_motion(clip).write(path)
            return []
        case GlbFile() as file:
            data = file.with_animations([_animation(take, file) for take in takes])
            checks = check_skin(data, takes, target)
            for take, check in zip(takes, checks, strict=False):
                if check.torn:
                    where = few(check.behind) if check.behind else check.where
                    raise HopdiffError(
                        f"{target.name}: {take.name} would tear its skin at {where}, which does not follow the body;"
                        " name the parts in a file and give it as retarget.names, or bind the skin to other joints."
                    )
            write_whole(path, data)
            return checks
        case _:
            raise HopdiffError(f"cannot write {path}: {target.name} comes from no file.")


def _animation(take: Take, file: GlbFile) -> Animation:
    """A take as the joints of a file move in the world."""
    clip = take.clip
    order = [clip.skeleton.index(name) for name in file.names]
    places, turns = clip.forward()
    times = clip.frame_time * torch.arange(clip.frames, dtype=torch.float64)
    return Animation(take.name, times, places[:, order], turns[:, order], clip_extras(take))
