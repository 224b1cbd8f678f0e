"""One edit: a clip made ready, its path solved, its feet cleaned, and what came out measured."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from hopdiff.editing.leg_joints import Leg, facing, find_legs
from hopdiff.editing.loop import is_loop, repeated
from hopdiff.editing.measure import path_measures
from hopdiff.editing.paper import edit_path_as_paper
from hopdiff.editing.root_path import RootPath, raised, root_path, with_root_path
from hopdiff.editing.targets import FEWEST_FRAMES, Constraint, EditedPath, check_reach, edit_path
from hopdiff.feet.contacts import Contacts, find_contacts, known_contacts, slide_numbers
from hopdiff.feet.planting import Planted, clean_feet
from hopdiff.feet.quality import quality_of, standing_numbers
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import BvhFile
from hopdiff.joins.files import Neighbours
from hopdiff.joins.join import joined
from hopdiff.joins.measure import seam_numbers
from hopdiff.tasks.edit_join import begun
from hopdiff.tasks.edit_request import EditSettings, Request
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

FAR = 1.5  # stretch from which on a warning is given, and below its inverse


@dataclass(frozen=True)
class Source:
    """What is edited. name: for people. clip: as it is edited, loops laid end to end. file: what it was read from, None
    for a run of our own. legs: none if the skeleton has none that can be told. contacts: of the feet, None without;
    known: whether they were known and not found. rest: where the body faces when the root is not turned [rad]."""

    name: str
    clip: Clip
    file: BvhFile | None
    legs: tuple[Leg, ...]
    contacts: Contacts | None
    path: RootPath
    repeats: int
    known: bool = False
    rest: float = 0.0


@dataclass(frozen=True)
class Edit:
    """moved: the clip on its new path, with feet that slide. clip: with clean feet. planted: how they were cleaned,
    None if they were not. warnings: sentences for the user. metrics: what metrics.json holds.
    neighbours: the clips before and after, which are then part of clip, of moved, and of the source's.
    """

    source: Source
    constraints: list[Constraint]
    solved: EditedPath
    moved: Clip
    clip: Clip
    planted: Planted | None
    warnings: list[str]
    metrics: dict[str, Any]
    neighbours: Neighbours | None = None


def source_of(
    clip: Clip,
    name: str,
    settings: EditSettings,
    request: Request,
    file: BvhFile | None,
    stands: Tensor | None = None,
) -> Source:
    """A clip made ready: its legs found, and, if it is a loop, laid end to end as often as the way asks for.

    stands: (T, 2) when its left and right foot are on the ground, where that is known and need not be found.
    Raises HopdiffError for a joint map that does not fit, frames that the clip does not have, or a clip of which a
    repetition is asked that is no loop.
    """
    if settings.frames is not None:
        part = _part(clip, settings.frames)
        clip, stands = clip.part(part), None if stands is None else stands[part]
    legs = find_legs(clip.skeleton, settings.joints or None)
    rest_yaw = facing(clip.skeleton, legs)
    repeats = _repeats(clip, name, settings, request, own=file is None)
    if repeats > 1:
        clip = repeated(clip, repeats)
        stands = None if stands is None else torch.cat((stands[:1], *[stands[1:]] * repeats))
    if stands is not None and legs:
        contacts: Contacts | None = known_contacts(clip, legs, stands)
    else:
        contacts = find_contacts(clip, legs) if legs else None
    known = stands is not None and contacts is not None
    return Source(name, clip, file, legs, contacts, root_path(clip, rest_yaw), repeats, known, rest_yaw)


def _part(clip: Clip, frames: Sequence[int]) -> slice:
    """The frames from the first to the last that are asked for; negative ones count from the end."""
    first, last = (frame + clip.frames if frame < 0 else frame for frame in frames)
    if not 0 <= first <= last - FEWEST_FRAMES + 1 < clip.frames - FEWEST_FRAMES + 1:
        raise HopdiffError(
            f"edit.frames={list(frames)} must be {FEWEST_FRAMES} frames at least of the clip's, which are 0 to"
            f" {clip.frames - 1}."
        )
    return slice(first, last + 1)


def _repeats(clip: Clip, name: str, settings: EditSettings, request: Request, own: bool) -> int:
    if settings.repeat is not None:
        if settings.repeat > 1 and not is_loop(clip):
            raise HopdiffError(f"edit.repeat={settings.repeat}: {name} is no loop, it does not end as it began.")
        return settings.repeat
    if not is_loop(clip):
        return 1
    if request.curve is not None:
        way = float((clip.root_position[-1] - clip.root_position[0])[[0, 2]].norm())
        return max(1, round(request.curve.length / max(way, 1e-6)))
    return settings.strides if own else 1


def edit(
    source: Source,
    request: Request,
    settings: EditSettings,
    ground: Ground | None = None,
    neighbours: Neighbours | None = None,
) -> Edit:
    """Edit a clip. ground: what it shall walk on, None for a level one. neighbours: clips between which it shall go.
    Raises HopdiffError, naming the frame or the setting, for what cannot be."""
    started = time.perf_counter()
    if neighbours is None:
        guess, constraints = request.constraints(source.path, source.clip.frame_time)
    else:
        part = begun(source.clip, source.path, source.contacts, request, neighbours)
        source = replace(source, clip=part.clip, path=part.path, contacts=part.contacts)
        guess, constraints = part.guess, part.constraints
    clip, before = source.clip, source.path
    if ground is not None and ground.flat:
        ground = None
    if ground is not None and (source.contacts is None or not settings.feet):
        raise HopdiffError("ground needs legs that can be told and edit.feet=true: feet are what stands on it.")
    if ground is not None and neighbours is not None:
        raise HopdiffError("clips before and after are joined on level ground only: leave out ground.")
    if request.curve is None:
        check_reach(before, constraints, clip.frame_time)
    solved = _solved(before, clip.frame_time, constraints, guess, settings)
    after = solved.path
    moved = with_root_path(clip, before, after)
    if solved.rise is not None:
        moved = raised(moved, solved.rise)
    warnings = _warnings(source, solved, before)
    milliseconds = dict(solved.milliseconds)
    cleaned, start, planted = moved, time.perf_counter(), None
    seams: dict[str, float | list[int]] = {}
    if neighbours is not None:
        if solved.rise is not None:
            raise HopdiffError("clips before and after are joined on level ground only: leave out edit.rise.")
        whole = joined(clip, moved, *neighbours.two, source.legs, source.contacts)
        planted = whole.planted(by=settings.feet_by) if settings.feet else None
        moved, cleaned = whole.clip, whole.clip if planted is None else planted.clip
        seams, said = seam_numbers(cleaned, whole, [clip, *neighbours.clips], *neighbours.two)
        warnings += [*neighbours.notes, *said]
        milliseconds["feet"] = 1e3 * (time.perf_counter() - start)
        constraints = [replace(one, frame=one.frame + whole.head) for one in constraints]
        source = replace(source, clip=whole.source, contacts=whole.contacts, path=root_path(whole.source, source.rest))
        solved, clip = replace(solved, path=root_path(moved, source.rest)), whole.source
    elif settings.feet and source.contacts is not None:
        planted = clean_feet(clip, moved, source.contacts, ground, rise=solved.rise, by=settings.feet_by)
        cleaned = planted.clip
        milliseconds["feet"] = 1e3 * (time.perf_counter() - start)
    milliseconds["all"] = 1e3 * (time.perf_counter() - started)
    metrics: dict[str, Any] = {
        "clip": source.name,
        "frames": clip.frames,
        "frame_time": clip.frame_time,
        "unit": 1.0 if source.file is None else source.file.unit,
        "up": "y" if source.file is None else source.file.up,
        "repeats": source.repeats,
        "variant": settings.variant,
        "constraints": len(constraints),
        "rounds": solved.rounds,
        "converged": solved.converged,
        "error_place": solved.error_place,
        "error_yaw_deg": math.degrees(solved.error_yaw),
        "start_moved": float((after.place[0] - before.place[0]).norm()),
        **path_measures(before, after, clip.frame_time),
        **seams,
        **{f"ms_{name}": value for name, value in milliseconds.items()},
    }
    if source.contacts is not None:
        for stage, one in (("source", clip), ("edited", moved)):
            metrics |= {f"{name}_{stage}": value for name, value in slide_numbers(one, source.contacts).items()}
    if source.contacts is not None and planted is not None:
        metrics |= {f"{name}_cleaned": value for name, value in standing_numbers(planted, source.contacts).items()}
        quality = quality_of(clip, planted, source.contacts, ground)
        metrics |= quality.numbers
        warnings += quality.sentences
    return Edit(source, constraints, solved, moved, cleaned, planted, warnings, metrics, neighbours)


def _solved(
    path: RootPath, frame_time: float, constraints: list[Constraint], guess: RootPath | None, settings: EditSettings
) -> EditedPath:
    if settings.variant == "hopdiff":
        return edit_path(path, constraints, frame_time, settings.solver(), settings.turn, guess)
    last = constraints[0]
    if len(constraints) != 1 or last.frame != path.frames - 1 or last.place is None:
        raise HopdiffError("edit.variant=paper binds the last frame alone, and needs its position.")
    yaw = None if last.yaw is None else _nearest(last.yaw, float(path.yaw[-1]))
    return edit_path_as_paper(path, frame_time, last.place, yaw, settings.paper())


def _nearest(yaw: float, own: float) -> float:
    return own + math.remainder(yaw - own, math.tau)


def _warnings(source: Source, solved: EditedPath, before: RootPath) -> list[str]:
    found = [] if source.file is None else list(source.file.notes)
    if not solved.converged:
        found.append(
            f"the targets were not met: {solved.error_place:.3f} m and {math.degrees(solved.error_yaw):.1f} degrees are"
            " left."
        )
    stretch = path_measures(before, solved.path, source.clip.frame_time)["stretch"]
    if not 1.0 / FAR <= stretch <= FAR:
        found.append(f"the way became {stretch:.2f} times as long in the same time: steps of that length look wrong.")
    if not source.legs:
        found.append("no legs were found in the skeleton, so feet are not cleaned (edit.joints names the joints).")
    return found
