"""A way between two clips: where they have it begin and end, in which poses, and what all three become."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.graph.body import DEPTH, Inside
from hopdiff.graph.distance import distances
from hopdiff.graph.graph import MotionGraph
from hopdiff.graph.scene import Place
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.way import Way
from hopdiff.joins.files import Neighbours
from hopdiff.joins.join import joined
from hopdiff.joins.measure import seam_numbers
from hopdiff.joins.seams import moments
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

LIKEST = 0.1  # of the frames of the clips that a way to another clip may end in
LEFT = 1.0  # s of its clip that a way must have before it, where it begins


@dataclass(frozen=True, eq=False)
class Asked:
    """What the clips beside a way ask for. start, goal: as given where there is no such clip. ends_in: (N,) frames of
    the graph, None for those of the settings."""

    start: Place
    goal: Place
    settings: WaySettings
    ends_in: NDArray[np.bool_] | None


def asked(
    graph: MotionGraph, neighbours: Neighbours, start: Place, goal: Place, settings: WaySettings, ground: Ground
) -> Asked:
    """Place and facing of the ends of a way, and the frames of the graph that are likest to the clips beside it.

    Raises HopdiffError for ground that is not level.
    """
    if not ground.flat:
        raise HopdiffError("clips before and after are joined on level ground only: leave out ground.")
    before, after = neighbours.two
    ends_in = None
    if before is not None:
        start = _place(before, -1)
        if settings.start_frame is None and settings.start == "any":
            far = _far(graph, before, before.frames - 1)
            far[~graph.kept | (_left(graph) < LEFT)] += 1e6
            settings = replace(settings, start_frame=int(far.argmin()))
    if after is not None:
        goal = _place(after, 0)
        if settings.end == "any":
            far = _far(graph, after, 0)
            ends_in = far <= np.quantile(far[graph.kept], LIKEST)
    return Asked(start, goal, settings, ends_in)


def joined_way(way: Way, neighbours: Neighbours, source: Clip) -> tuple[Way, dict[str, float | list[int]], list[str]]:
    """A way with the clips before and after it in its clip, numbers of the seams, and sentences for the user."""
    legs = find_legs(way.graph_clip.skeleton)
    whole = joined(way.graph_clip, way.edited_clip, *neighbours.two, legs, way.contacts)
    planted = whole.planted(everywhere=True)
    clip = whole.clip if planted is None else planted.clip
    numbers, said = seam_numbers(clip, whole, [source, *neighbours.clips], *neighbours.two)
    path, before = root_path(clip), root_path(whole.source)
    made = replace(
        way,
        clip=clip,
        graph_clip=whole.source,
        graph_path=before,
        edited_clip=whole.clip,
        path=path,
        planted=planted,
        contacts=whole.contacts,
    )
    return made, numbers, [*neighbours.notes, *said]


def own_frames(way: Way, neighbours: Neighbours | None) -> slice:
    """The frames of a way's clip that are neither of the clip before it nor of the one after."""
    before, after = (None, None) if neighbours is None else neighbours.two
    frames = way.clip.frames
    return slice(0 if before is None else before.frames, frames if after is None else frames - after.frames)


def inside_said(inside: Inside) -> list[str]:
    """A sentence for the user if a walk is in a wall: its ends are blended with other clips after it was checked."""
    if inside.depth <= DEPTH:
        return []
    return [f"{inside.part} is {100.0 * inside.depth:.1f} cm inside {inside.thing} in frame {inside.frame}."]


def _place(clip: Clip, frame: int) -> Place:
    path = root_path(clip)
    x, z = path.place[frame].tolist()
    return Place((x, z), float(path.yaw[frame]))


def _far(graph: MotionGraph, clip: Clip, at: int) -> NDArray[np.float64]:
    """(N,) distances of all frames of a graph from one of a clip [m]."""
    target = moments(clip, torch.tensor([at]))
    return np.concatenate([distances(target, moments(one))[0].numpy() for one in graph.clips])


def _left(graph: MotionGraph) -> NDArray[np.float64]:
    """(N,) seconds from every frame of a graph to the end of its clip."""
    counts: Sequence[int] = [one.frames for one in graph.clips]
    return np.concatenate([np.arange(count)[::-1] for count in counts]) * graph.frame_time
