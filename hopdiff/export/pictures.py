"""Pictures of figures in motion on a transparent ground: from any side, of one scale, with the ground where it was."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdiff.export.body.loft import Surface, joined
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.colours import linear
from hopdiff.export.raster import drawn
from hopdiff.export.skinning import joint_matrices, skinned, skinned_normals
from hopdiff.export.take import Take
from hopdiff.export.views import View
from hopdiff.types import HopdiffError

Floats = NDArray[np.float64]
Picture = NDArray[np.uint8]  # (height, width, 4)

MARGIN = 2  # transparent pixels around the figure
MOST = 8192  # pixels along a side that programs for pictures and graphics cards take
AT_ONCE = 64  # frames whose vertices are in memory


def shown(take: Take) -> int:
    """How many of a take's frames are pictures: the last frame of a loop is its first."""
    return take.frames - 1 if take.loop and take.frames > 1 else take.frames


def durations(take: Take) -> list[int]:
    """Of the pictures [ms], whole ones, rounded so that they add up to the take's duration."""
    ends = [round(1000.0 * take.clip.frame_time * frame) for frame in range(shown(take) + 1)]
    return [after - before for before, after in itertools.pairwise(ends)]


@dataclass(frozen=True, eq=False)
class Figure:
    """A take with its skinned body. colours: (V, 3) linear. height: of the standing body [m]."""

    take: Take
    body: Surface
    colours: Floats
    height: float

    @classmethod
    def of(cls, take: Take) -> Figure:
        """Raises HopdiffError for a take that holds no body, or a number that is not finite."""
        surfaces = body_mesh(take.clip.skeleton, take.masses, take.parts)
        if not surfaces:
            raise HopdiffError(f"cannot draw {take.name}: its skeleton has no bones.")
        if not all(bool(values.isfinite().all()) for values in (take.clip.root_position, take.clip.rotations)):
            raise HopdiffError(f"cannot draw {take.name}: the motion holds a number that is not finite.")
        body = joined(list(surfaces.values()))
        colours = [np.tile(linear(side), (len(one.vertices), 1)) for side, one in surfaces.items()]
        size = np.ptp(body.vertices, axis=0)
        # Some files have a rest pose that lies down.
        return cls(take, body, np.concatenate(colours), max(float(size[1]), 0.5 * float(size.max())))

    def moved(self) -> Iterator[tuple[Floats, Floats]]:
        """Vertices (V, 3) [m] and their normals, of one picture after the other."""
        matrices, bound = joint_matrices(self.take.clip)[: shown(self.take)], (self.body.joints, self.body.weights)
        for first in range(0, len(matrices), AT_ONCE):
            part = matrices[first : first + AT_ONCE]
            yield from zip(
                skinned(self.body.vertices, *bound, part),
                skinned_normals(self.body.normals, *bound, part),
                strict=True,
            )


@dataclass(frozen=True, eq=False)
class Stage:
    """How figures are put into pictures of one size.

    scale: pixels in a metre. width, height: of every picture [pixels]. pivot: column and row [pixels] of the point on
    the ground below the figure, that is of the world's origin, the same in all pictures and on whole pixels.
    """

    figures: tuple[Figure, ...]
    views: tuple[View, ...]
    scale: float
    width: int
    height: int
    pivot: tuple[int, int]

    @classmethod
    def of(cls, takes: Sequence[Take], views: Sequence[View], size: int, centred: bool) -> Stage:
        """Just room for all figures in all views. size: pixels that the tallest of them is high when it stands.

        centred: whether the origin is in the middle column, so that a mirrored picture fits in its place. Raises
        HopdiffError if there is no take, or pictures would be larger than MOST.
        """
        if not takes:
            raise HopdiffError("cannot draw pictures without a motion.")
        figures = tuple(Figure.of(take) for take in takes)
        scale = size / max(figure.height for figure in figures)
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for figure in figures:
            for points, _ in figure.moved():
                for view in views:
                    place = scale * points @ view.axes[:2].T
                    low, high = np.minimum(low, place.min(axis=0)), np.maximum(high, place.max(axis=0))
        left, right = MARGIN + math.ceil(-low[0]), MARGIN + math.ceil(high[0])
        if centred:
            left = right = max(left, right)
        above, below = MARGIN + math.ceil(high[1]), MARGIN + math.ceil(-low[1])
        if max(left + right, above + below) > MOST:
            raise HopdiffError(
                f"pictures would be {left + right} x {above + below} pixels, more than {MOST}: set a smaller size, or"
                " root=in_place."
            )
        return cls(figures, tuple(views), scale, left + right, above + below, (left, above))

    def pictures(self, figure: Figure) -> Iterator[list[Picture]]:
        """Of each frame its pictures from all sides, in the order of the views."""
        offset = np.array([*self.pivot, 0.0])
        for points, normals in figure.moved():
            yield [
                drawn(
                    self.scale * points @ view.axes.T * [1.0, -1.0, 1.0] + offset,
                    normals @ view.axes.T,
                    figure.body.faces,
                    figure.colours,
                    self.width,
                    self.height,
                )
                for view in self.views
            ]
