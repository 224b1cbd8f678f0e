"""Motion graphs (Kovar et al. 2002): clips, and where one can go over into another or into itself.

A transition leaves at the first frame of a window and lays the window that it goes to over it; along the window the
one is blended into the other, so that it arrives at that window's last frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.graph.distance import alignment, as_complex, local_minima, windows_of
from hopdiff.types import HopdiffError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]

WINDOW = 1.0 / 3.0  # s
THRESHOLD = 0.06  # m
SAME_BONE = 1e-4  # m


@dataclass(frozen=True, eq=False)
class MotionGraph:
    """Frames are numbered through all clips: clip k has the frames first[k] to first[k + 1] - 1.

    window: frames of a transition. first: (K + 1,). ground: (N,) complex z + i x of the root [m]. yaw: (N,) of the
    root, without jumps within a clip [rad]. sources, targets: (M,) first frames of the windows that the transitions
    leave and reach, in rising order of sources. turns: (M,) [rad] and shifts: (M,) complex [m]: a point p of the
    target's clip lies at exp(i turn) p + shift in the source's. distances: (M,) [m]. kept: (N,) whether a frame is in
    the largest part in which every frame can be reached from every other one; all transitions stay inside it.
    """

    clips: tuple[Clip, ...]
    window: int
    first: Ints
    ground: Complexes
    yaw: Floats
    sources: Ints
    targets: Ints
    turns: Floats
    shifts: Complexes
    distances: Floats
    kept: NDArray[np.bool_]

    @property
    def frames(self) -> int:
        return len(self.yaw)

    @property
    def frame_time(self) -> float:
        return self.clips[0].frame_time

    def clip_of(self, frame: int | Ints) -> Ints:
        """The clips that frames belong to."""
        return np.searchsorted(self.first, frame, side="right") - 1

    def arrivals(self) -> Ints:
        """(M,) frames that the transitions arrive at."""
        return self.targets + self.window - 1

    def numbers(self) -> dict[str, float]:
        """For metrics.json: frames, transitions, share of the frames kept, median distance of the transitions [m]."""
        return {
            "graph_clips": len(self.clips),
            "graph_frames": self.frames,
            "graph_transitions": len(self.sources),
            "graph_kept": float(self.kept.mean()),
            "graph_distance": float(np.median(self.distances)) if len(self.distances) else math.nan,
        }


def build_graph(
    clips: Sequence[Clip],
    threshold: float = THRESHOLD,
    window: float = WINDOW,
    weights: Sequence[float] | Tensor | None = None,
) -> MotionGraph:
    """The motion graph of clips of one skeleton and one frame time.

    threshold: largest distance of a transition, root mean square over joints and window [m]. window: [s]. weights:
    (J,) of the joints in the distance, None for equal ones. Raises HopdiffError, naming the clip, for clips that do
    not fit together or are shorter than a window, and for a bad threshold or window.
    """
    if not (math.isfinite(threshold) and threshold > 0):
        raise HopdiffError(f"graph.threshold must be a number of metres above 0, not {threshold:g}.")
    if not (math.isfinite(window) and window > 0):
        raise HopdiffError(f"graph.window must be a number of seconds above 0, not {window:g}.")
    _check(clips)
    size = max(2, round(window / clips[0].frame_time))
    for k, clip in enumerate(clips):
        if clip.frames < size:
            raise HopdiffError(
                f"clip {k + 1} has {clip.frames} frames, fewer than a window of {size}: choose a smaller graph.window."
            )
    rows = [windows_of(clip, size, weights) for clip in clips]
    first = np.cumsum([0, *(clip.frames for clip in clips)])
    parts: list[tuple[Tensor, ...]] = []
    for a in range(len(clips)):
        for b in range(a, len(clips)):
            like = local_minima(rows[a], rows[b], threshold, apart=size)
            turn, shift = alignment(rows[a], like.first, rows[b], like.second)
            i, j = like.first + int(first[a]), like.second + int(first[b])
            back = -torch.polar(torch.ones_like(turn), -turn) * shift
            parts += [(i, j, turn, shift, like.distance), (j, i, -turn, back, like.distance)]
    sources, targets, turns, shifts, distance = (torch.cat(column).numpy() for column in zip(*parts, strict=True))
    paths = [root_path(clip) for clip in clips]
    ground = torch.cat([as_complex(path.place.detach()) for path in paths]).numpy()
    yaw = torch.cat([path.yaw.detach() for path in paths]).numpy()
    kept = _largest_part(first, sources, targets + size - 1)
    inside = np.flatnonzero(kept[sources] & kept[targets + size - 1])
    inside = inside[np.lexsort((targets[inside], sources[inside]))]
    return MotionGraph(
        tuple(clips),
        size,
        first,
        ground,
        yaw,
        sources[inside],
        targets[inside],
        turns[inside],
        shifts[inside],
        distance[inside],
        kept,
    )


def _largest_part(first: Ints, leave: Ints, arrive: Ints) -> NDArray[np.bool_]:
    """(N,) the frames of the largest strongly connected part; without transitions none."""
    count = int(first[-1])
    here = np.setdiff1d(np.arange(count), first[1:] - 1)
    start, end = np.concatenate((here, leave)), np.concatenate((here + 1, arrive))
    edges = coo_array((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    number, label = connected_components(edges, directed=True, connection="strong")
    sizes = np.bincount(label, minlength=number)
    if sizes.max() < 2:
        return np.zeros(count, dtype=bool)
    found: NDArray[np.bool_] = label == int(sizes.argmax())
    return found


def _check(clips: Sequence[Clip]) -> None:
    if not clips:
        raise HopdiffError("a motion graph needs at least one clip.")
    model = clips[0]
    for k, clip in enumerate(clips, start=1):
        if not all(bool(torch.isfinite(part).all()) for part in (clip.root_position, clip.rotations)):
            raise HopdiffError(f"clip {k} holds a number that is not finite.")
        if (clip.skeleton.names, clip.skeleton.parents) != (model.skeleton.names, model.skeleton.parents):
            raise HopdiffError(f"clip {k} has other joints than clip 1: a motion graph needs clips of one skeleton.")
        # The root's offset is no bone.
        bones = (clip.skeleton.offsets - model.skeleton.offsets)[1:].abs()
        if bones.numel() and float(bones.max()) > SAME_BONE:
            name = clip.skeleton.names[1 + int(bones.amax(-1).argmax())]
            raise HopdiffError(f"clip {k} has another bone at joint {name!r} than clip 1.")
        if abs(clip.frame_time - model.frame_time) > 1e-3 * model.frame_time:
            raise HopdiffError(f"clip {k} has {clip.frame_time:g} s a frame, but clip 1 {model.frame_time:g} s.")
        if (clip.offsets is None) != (model.offsets is None):
            raise HopdiffError(f"clip {k} and clip 1 differ in whether joints move against their parents.")
