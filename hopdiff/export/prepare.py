"""From a motion as hopdiff has it to the motion that a file shall hold."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from hopdiff.editing.root_path import RootPath
from hopdiff.export.anatomy import renamed
from hopdiff.export.contact_events import with_events
from hopdiff.export.full_body import full_body, is_model_body
from hopdiff.export.ground import ground_path
from hopdiff.export.one_stride import one_stride
from hopdiff.export.pose import mirrored, root_height, with_rest_pose
from hopdiff.export.settings import ClipSettings, ExportSettings
from hopdiff.export.take import ContactEvent, Take
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError


def prepared(take: Take, settings: ExportSettings) -> Take:
    """The take with the joints, cycles, frames, rest pose, root and joints' names that the settings ask for.

    Raises HopdiffError, naming the setting, for what this motion does not allow.
    """
    if take.frames == 0:
        raise HopdiffError(f"cannot write {take.name}: it has no frames.")
    if settings.joints == "full" and is_model_body(take.clip.skeleton) and take.contact is not None:
        take = full_body(take)
    take = in_place_if(with_clip(take, settings), settings)
    if settings.rest is not None:
        take = with_rest_pose(take, settings.rest)
    if settings.names is not None:
        skeleton = renamed(take.clip.skeleton, settings.names)
        called = dict(zip(take.clip.skeleton.names, skeleton.names, strict=True))
        parts = take.parts and {part: called[joint] for part, joint in take.parts.items()}
        take = replace(take, clip=replace(take.clip, skeleton=skeleton), parts=parts)
    return with_ground_root(take, settings.ground_name) if settings.ground else take


def with_clip(take: Take, settings: ClipSettings) -> Take:
    """The take mirrored, cut to a stride, laid end to end, and at the frames that the settings ask for; it travels.
    It carries its events: the times of contacts do not hang on the frames that are asked for.

    Raises HopdiffError, naming the setting, for what this motion does not allow.
    """
    if settings.mirrored:
        take = mirrored(take)
    if settings.keys is not None:
        take = one_stride(take, settings.keys)
    take = with_events(take.repeated(settings.cycles))
    return take if settings.fps is None else take.resampled(settings.fps, settings.frames == "exact")


def in_place_if(take: Take, settings: ClipSettings, rest: Tensor | None = None) -> Take:
    """The take on the spot if the settings ask for that. rest: see `in_place`."""
    return in_place(take, rest) if settings.root == "in_place" else take


def named(takes: Sequence[Take], settings: ClipSettings) -> list[Take]:
    """The takes under the names of clips that the settings ask for.

    Raises HopdiffError, naming the setting, for two of one name, a number in a name that is not known of a take, or
    names for another count of takes.
    """
    wanted = settings.clip_names
    if len(wanted) > 1 and len(wanted) != len(takes):
        raise HopdiffError(f"clip has {len(wanted)} names for {len(takes)} motions.")
    found = []
    for k, take in enumerate(takes):
        name = take.name if not wanted else _filled(wanted[k % len(wanted)], take)
        found.append(replace(take, name=f"{name}-loop" if settings.loop_suffix and take.loop else name))
    names = [take.name for take in found]
    if wanted and (twice := next((name for name in names if names.count(name) > 1), None)) is not None:
        raise HopdiffError(f"clip={wanted[0]}: two motions are called {twice!r}: give a list, or set {{name}} in it.")
    return found


def _filled(name: str, take: Take) -> str:
    """A name with what stands in braces filled in; speeds are those of the run, whatever body it is on."""

    def value(match: re.Match[str]) -> str:
        # Runs without a turn go straight on.
        found = {"turn": 0.0, **take.numbers, "name": take.name}.get(match[1])
        if found is None:
            raise HopdiffError(f"clip={name}: {match[1]} of {take.name} is not known.")
        if match[1] == "speed" and isinstance(found, int | float):
            # On another body it goes with the legs; the clip is still that of the run.
            found = found / take.numbers.get("leg_ratio", 1.0)
        return f"{found:.3g}" if isinstance(found, float) else str(found)

    return re.sub(r"{(\w+)}", value, name)


def in_place(take: Take, rest: Tensor | None = None) -> Take:
    """The motion on the spot, heading along +z: without its steady way over the ground; sway and bounce stay.

    What is on the spot stays as it is. rest: (3, 3) rotation of the root joint with which the body faces +z in its rest
    pose; none if not given.
    """
    if take.way is not None:
        return take
    clip = take.clip
    facing = take
    if rest is not None:
        turned = torch.cat((clip.rotations[:, :1] @ rest.transpose(-1, -2), clip.rotations[:, 1:]), dim=1)
        facing = replace(take, clip=replace(clip, rotations=turned))
    path = ground_path(facing)
    turn, place = _undone(path)
    way = torch.cat((path.place, path.yaw[:, None]), dim=-1)
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]

    def here(points: Tensor | None) -> Tensor | None:
        if points is None:
            return None
        wide = points if points.ndim == 3 else points.unsqueeze(1)
        moved = (wide - place.unsqueeze(1)) @ turn.transpose(-1, -2)
        return moved.reshape(points.shape)

    events = None if take.events is None else _events_here(take.events, path, clip.frame_time)
    root = here(clip.root_position)
    assert root is not None
    clip = replace(clip, root_position=root, rotations=rotations)
    return replace(
        take, clip=clip, feet=here(take.feet), com=here(take.com), cop=here(take.cop), way=way, events=events
    )


def _events_here(events: Sequence[ContactEvent], path: RootPath, frame_time: float) -> tuple[ContactEvent, ...]:
    """Events of a motion where they are when its steady way is undone, each at its own time between two frames."""
    found, way = [], torch.cat((path.place, path.yaw[:, None]), dim=-1)
    for event in events:
        if event.position is not None:
            at = event.time / frame_time
            before = min(int(at), len(way) - 2)
            now = torch.lerp(way[before], way[before + 1], at - before).unsqueeze(0)
            turn, place = _undone(RootPath(now[:, :2], now[:, 2]))
            there = turn[0] @ (place.new_tensor(event.position) - place[0])
            event = replace(event, position=tuple(there.tolist()))
        found.append(event)
    return tuple(found)


def with_ground_root(take: Take, name: str) -> Take:
    """The motion with one more joint, on the ground below the body, that carries its steady way; game engines take
    root motion from it. Raises HopdiffError if the skeleton has a joint of that name."""
    clip, skeleton = take.clip, take.clip.skeleton
    if name in skeleton.names:
        raise HopdiffError(f"ground: {take.name} has a joint {name!r} already.")
    turn, place = _way(take)
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    local = (turn @ (clip.root_position - place).unsqueeze(-1)).squeeze(-1)
    rest = skeleton.offsets.clone()
    # In the rest pose the body stands on the ground; in the motion its old root moves against the new one.
    rest[0] = rest.new_tensor((0.0, root_height(skeleton), 0.0))
    body = skeleton.offsets.expand(take.frames, -1, -1) if clip.offsets is None else clip.offsets
    moving = torch.cat((place.unsqueeze(1), local.unsqueeze(1), body[:, 1:]), dim=1)
    whole = Skeleton(
        (name, *skeleton.names),
        (-1, *(parent + 1 for parent in skeleton.parents)),
        torch.cat((torch.zeros(1, 3).double(), rest)),
        skeleton.end_sites,
    )
    rotations = torch.cat((turn.transpose(-1, -2).unsqueeze(1), rotations), dim=1)
    return replace(take, clip=replace(clip, skeleton=whole, root_position=place, rotations=rotations, offsets=moving))


def with_way_on_root(take: Take, pelvis: int) -> Take:
    """The motion of a skeleton whose root joint is at rest on the ground, with the steady way on that root; the joint
    below it on the way to the pelvis moves against it. Joints are where they were but for the root, and for what else
    hangs on it."""
    clip, skeleton = take.clip, take.clip.skeleton
    child = next(joint for joint in (pelvis, *skeleton.above(pelvis)) if skeleton.parents[joint] == 0)
    turn, place = _way(take)
    positions, frames = clip.forward()
    rotations = clip.rotations.clone()
    rotations[:, 0], rotations[:, child] = turn.transpose(-1, -2), turn @ frames[:, child]
    offsets = (skeleton.offsets.expand(take.frames, -1, -1) if clip.offsets is None else clip.offsets).clone()
    offsets[:, child] = (turn @ (positions[:, child] - place).unsqueeze(-1)).squeeze(-1)
    return replace(take, clip=replace(clip, root_position=place, rotations=rotations, offsets=offsets))


def _way(take: Take) -> tuple[Tensor, Tensor]:
    """(T, 3, 3) turns that undo the heading of a take's steady way, and (T, 3) its places on the ground [m]."""
    return _undone(ground_path(take))


def _undone(path: RootPath) -> tuple[Tensor, Tensor]:
    zero = torch.zeros_like(path.yaw)
    place = torch.stack((path.place[:, 0], zero, path.place[:, 1]), dim=-1)
    return axis_rotation("Y", -path.yaw), place
