"""The body around its root: where its joints and end sites are over the ground, and whether they fit between walls."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
import torch
from numpy.typing import NDArray

from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.geometry.clip import Clip
from hopdiff.graph.distance import as_complex
from hopdiff.graph.graph import Complexes, Floats, Ints, MotionGraph
from hopdiff.graph.space import FreeSpace

DIRECTIONS = 8  # around the body, in each of which the outermost joint counts while a way is searched
DEPTH = 0.01  # m; what of a body may be inside a wall, so deep at most, as hands brush along one
ROUNDING = 1e-3  # m of that for what feet that are put right and numbers in a file change


@dataclass(frozen=True, eq=False)
class Body:
    """parts: (T, P) complex, forward + i left of joints and end sites seen from the root in every frame [m]. names:
    of the P."""

    parts: Complexes
    names: tuple[str, ...]

    @cached_property
    def outline(self) -> Complexes:
        """(T, D) the outermost parts in D directions around."""
        around = np.exp(2j * np.pi * np.arange(DIRECTIONS) / DIRECTIONS)
        ahead = (self.parts[:, :, None] * around.conj()).real
        found: Complexes = np.take_along_axis(self.parts, ahead.argmax(axis=1), axis=1)
        return found

    @cached_property
    def reach(self) -> Floats:
        """(T,) distance of the outermost part from the root [m]."""
        found: Floats = np.abs(self.parts).max(axis=1)
        return found

    def placed(self, path: RootPath) -> Complexes:
        """(T, P) z + i x of all parts with the root on a path of T frames [m]."""
        root = as_complex(path.place.detach()).numpy()
        found: Complexes = root[:, None] + np.exp(1j * path.yaw.detach().numpy())[:, None] * self.parts
        return found

    def depth_at(self, space: FreeSpace, place: tuple[float, float], heading: float) -> Floats:
        """(T,) how deep the deepest part of every pose is in a wall or furniture with the root at a place [m]."""
        there = complex(place[1], place[0]) + np.exp(1j * heading) * self.parts
        found: Floats = depths(space, there).max(axis=1)
        return found


def body_of(clip: Clip) -> Body:
    """The body of every frame of a clip."""
    path = root_path(clip)
    positions, orientations = clip.forward()
    ends = clip.skeleton.end_positions(positions, orientations)
    everything = torch.cat([positions, *(end[:, None] for end in ends.values())], dim=1).detach().double()
    ground = as_complex(everything[..., [0, 2]]).numpy()
    root = as_complex(path.place.detach()).numpy()
    parts = np.exp(-1j * path.yaw.detach().numpy())[:, None] * (ground - root[:, None])
    return Body(parts, (*clip.skeleton.names, *(f"the end of {name}" for name in ends)))


def bodies_of(graph: MotionGraph) -> Body:
    """The body of every frame of a graph."""
    bodies = [body_of(clip) for clip in graph.clips]
    return Body(np.concatenate([body.parts for body in bodies]), bodies[0].names)


def depths(space: FreeSpace, points: Complexes) -> Floats:
    """How deep points z + i x of any shape are in what is no free floor, 0 on it [m]."""
    return np.abs(space.way_out(points))


def hits(space: FreeSpace, root: Complexes, parts: Complexes) -> Complexes:
    """(T,) the push that brings a body back where it fits, as a complex number z + i x [m]; 0 where it fits.

    root: (T,) must be half a width off everything. parts: (T, P) may be inside by less than a centimetre.
    """
    out = space.way_out(parts)
    deepest = np.take_along_axis(out, np.abs(out).argmax(axis=1)[:, None], axis=1)[:, 0]
    push = np.where(np.abs(deepest) > DEPTH - ROUNDING, deepest, 0.0)
    near = np.flatnonzero(space.depth(np.stack((root.imag, root.real), axis=-1)) < space.half_width)
    for frame in near.tolist():
        x, z = space.nearest((float(root[frame].imag), float(root[frame].real)))
        more = complex(z, x) - root[frame]
        # Nearly parallel pushes are one; what the body asks for more counts.
        push[frame] = more if abs(more) >= abs(push[frame]) else push[frame]
    return push


@dataclass(frozen=True)
class Inside:
    """Where a body is deepest in a wall or furniture. depth: [m], 0 if it is in none; then the rest says nothing. part:
    a joint, or the end of one. thing: what it is in, in words."""

    depth: float
    frame: int
    part: str
    thing: str


def deepest(clip: Clip, space: FreeSpace, frames: slice = slice(None)) -> Inside:
    """Of all joints and end sites in some frames of a clip."""
    taken = range(clip.frames)[frames]
    if not taken:
        return Inside(0.0, 0, "", "")
    own = clip.part(frames)
    body = body_of(own)
    placed = body.placed(root_path(own))
    deep = depths(space, placed)
    frame, part = divmod(int(deep.argmax()), deep.shape[1])
    return Inside(float(deep.max()), taken[frame], body.names[part], thing_at(space, complex(placed[frame, part])))


def groups(frames: Ints, gap: int) -> list[NDArray[np.int64]]:
    """Frames in rising order, cut where more than a gap lies between two."""
    if not len(frames):
        return []
    return np.split(frames, np.flatnonzero(np.diff(frames) > gap) + 1)


def said_depth(body: Body, space: FreeSpace, place: tuple[float, float], heading: float) -> str:
    """Which part of the pose that fits best is how deep inside, in words."""
    there = complex(place[1], place[0]) + np.exp(1j * heading) * body.parts
    depth = depths(space, there)
    frame = int(depth.max(axis=1).argmin())
    part = int(depth[frame].argmax())
    return f"{body.names[part]} is {100.0 * depth[frame, part]:.1f} cm inside {thing_at(space, there[frame, part])}"


def thing_at(space: FreeSpace, point: complex) -> str:
    """What is at a point that is no free floor."""
    spot = shapely.Point(point.imag, point.real)
    for (section, name), shape in space.scene.obstacles().items():
        if shape.covers(spot):
            return f"{'wall' if section == 'walls' else 'furniture'} {name!r}"
    return "a wall"
