"""An edit of a walk between two clips: which part of it is taken, where that is bound, and what comes out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from hopdiff.editing.root_path import RootPath
from hopdiff.editing.targets import Constraint
from hopdiff.feet.contacts import Contacts
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh_file import BvhFile
from hopdiff.joins.files import Neighbours, read_neighbour
from hopdiff.joins.seams import Seam, placed, seams
from hopdiff.tasks.edit_request import Request

FREE = 0.5  # s next to a seam in which a path that is followed binds no frame


def read_neighbours(before: str | None, after: str | None, walk: BvhFile, name: str) -> Neighbours | None:
    """None if there are none. Raises HopdiffError, naming the file, see `read_neighbour`."""
    if before is None and after is None:
        return None
    found = [None if one is None else read_neighbour(one, walk, name) for one in (before, after)]
    return Neighbours(*found)


@dataclass(frozen=True, eq=False)
class Begun:
    """The part of a walk that is taken, moved as one to where it begins, and what its edit shall do. guess: a path near
    the solution, if one is known."""

    clip: Clip
    path: RootPath
    contacts: Contacts | None
    guess: RootPath | None
    constraints: list[Constraint]


def begun(clip: Clip, path: RootPath, contacts: Contacts | None, request: Request, neighbours: Neighbours) -> Begun:
    """Choose the part of a walk that goes between its neighbours, and bind its ends.

    path: of the clip. The walk is laid to the clip before it, or, if that is missing and nothing else is bound, to the
    one after. Raises HopdiffError, naming the frame, for one that is bound too near to a seam.
    """
    wished = request.constraints(path, clip.frame_time)[1] if request.wishes else []
    bound = [one.frame for one in wished]
    begin, end = seams(clip, *neighbours.two, bound)
    first, last = 0 if begin is None else begin.frame, clip.frames - 1 if end is None else end.frame
    ends = [_end(path, seam, first) for seam in (begin, end) if seam is not None]
    laid = begin or (None if wished or request.curve is not None else end)
    if laid is not None:
        clip, path = placed(clip, laid.move), laid.move.path(path)
    part = slice(first, last + 1)
    own, guess = RootPath(path.place[part], path.yaw[part]), None
    if request.curve is not None:
        guess, wished = request.constraints(own, clip.frame_time)
        # A path leads from one clip to the other: next to these it does not bind.
        room, stop = FREE / clip.frame_time, last - first
        wished = [one for one in wished if not (begin and one.frame < room) and not (end and stop - one.frame < room)]
    elif wished:
        wished = [replace(one, frame=one.frame - first) for one in request.constraints(path, clip.frame_time)[1]]
    if contacts is not None:
        contacts = replace(contacts, touching=contacts.touching[part], level=contacts.level[part])
    return Begun(clip.part(part), own, contacts, guess, [*ends, *wished])


def _end(path: RootPath, seam: Seam, first: int) -> Constraint:
    there = seam.move.path(path)
    x, z = there.place[seam.frame].tolist()
    return Constraint(seam.frame - first, (x, z), float(there.yaw[seam.frame]))


def seam_rows(m: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the table at the end of an edit or a way says of its seams."""
    if "seam_frames" not in m:
        return []
    frames = " and ".join(str(frame) for frame in m["seam_frames"])
    ratios = f"speed x {m['seam_speed_ratio']:.2f}, acceleration x {m['seam_acceleration_ratio']:.2f}"
    return [("seams", f"frame {frames}: {ratios} of the clips' largest")]
