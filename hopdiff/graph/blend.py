"""A way through a motion graph as one clip: pieces moved to where they go on, blended where they meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.quaternion import slerp
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.graph.graph import Complexes, Floats, Ints, MotionGraph
from hopdiff.types import HopdiffError


@dataclass(frozen=True)
class Piece:
    """The frames start to stop - 1 of a graph, of one clip. A point p on the ground of that clip, z + i x, lies at
    exp(i turn) p + shift [m]."""

    start: int
    stop: int
    turn: float
    shift: complex

    @property
    def frames(self) -> int:
        return self.stop - self.start

    @property
    def ends(self) -> Ints:
        """First and last frame."""
        return np.array([self.start, self.stop - 1])


def eased(share: Floats) -> Floats:
    """Weights that rise from 0 to 1 with a share from 0 to 1, and start and end without slope."""
    return share * share * (3.0 - 2.0 * share)


def assemble(graph: MotionGraph, pieces: Sequence[Piece]) -> Clip:
    """One clip of pieces, each of which overlaps the next by the graph's window of frames.

    Along an overlap the root's place and all rotations (on the shorter arc, Shoemake 1985) go from the one to the
    other; its first frame is that of the piece that ends, its last frame that of the piece that begins.
    Raises HopdiffError for no piece, or one that leaves its clip or is too short for its overlaps.
    """
    first, second, owners, others, weight = _schedule(graph, pieces)
    turn, shift = np.array([piece.turn for piece in pieces]), np.array([piece.shift for piece in pieces])
    here = _placed(graph, first, turn[owners], shift[owners])
    mixed = np.flatnonzero(weight > 0)
    there = _placed(graph, second[mixed], turn[others[mixed]], shift[others[mixed]])
    share = torch.from_numpy(weight[mixed])
    root, rotations = here.root_position.clone(), here.rotations.clone()
    root[mixed] = torch.lerp(root[mixed], there.root_position, share[:, None])
    rotations[mixed] = slerp(rotations[mixed], there.rotations, share[:, None])
    offsets = here.offsets
    if offsets is not None and there.offsets is not None:
        offsets = offsets.clone()
        offsets[mixed] = torch.lerp(offsets[mixed], there.offsets, share[:, None, None])
    return replace(here, root_position=root, rotations=rotations, offsets=offsets)


def _schedule(graph: MotionGraph, pieces: Sequence[Piece]) -> tuple[Ints, Ints, Ints, Ints, Floats]:
    """For every frame of the result (T,): the frame shown, the frame it is mixed with, the pieces that both belong to,
    and the weight of the second one."""
    if not pieces:
        raise HopdiffError("a way through a motion graph needs at least one piece.")
    window, last = graph.window, len(pieces) - 1
    rows = []
    for k, piece in enumerate(pieces):
        before, after = (window - 1) * (k > 0), window * (k < last)
        if not 0 <= piece.start < piece.stop <= graph.frames or len(set(graph.clip_of(piece.ends).tolist())) > 1:
            raise HopdiffError(f"piece {k + 1}: frames {piece.start} to {piece.stop - 1} are not frames of one clip.")
        if piece.frames < max(1, before + after):
            raise HopdiffError(
                f"piece {k + 1} has {piece.frames} frames, but its blends of {window} frames need {before + after}."
            )
        alone = np.arange(piece.start + before, piece.stop - after)
        rows.append((alone, alone, np.full(len(alone), k), np.full(len(alone), k), np.zeros(len(alone))))
        if k < last:
            # The last frame of the blend is the next piece's own.
            step = np.arange(window - 1)
            mix = (piece.stop - window + step, pieces[k + 1].start + step)
            rows.append((*mix, np.full(len(step), k), np.full(len(step), k + 1), eased(step / (window - 1))))
    first, second, owners, others, weight = (np.concatenate(column) for column in zip(*rows, strict=True))
    return first, second, owners, others, weight


def _placed(graph: MotionGraph, frames: Ints, turn: Floats, shift: Complexes) -> Clip:
    """Frames (T,) of the graph as a clip, each moved over the ground by its turn (T,) and shift (T,) complex."""
    owner, model = graph.clip_of(frames), graph.clips[0]
    root = torch.empty(len(frames), 3, dtype=torch.float64)
    rotations = torch.empty(len(frames), *model.rotations.shape[1:], dtype=torch.float64)
    offsets = None if model.offsets is None else torch.empty(len(frames), *model.offsets.shape[1:], dtype=torch.float64)
    for k, clip in enumerate(graph.clips):
        mine = np.flatnonzero(owner == k)
        local = frames[mine] - graph.first[k]
        root[mine] = clip.root_position.detach().double()[local]
        rotations[mine] = clip.rotations.detach().double()[local]
        if offsets is not None and clip.offsets is not None:
            offsets[mine] = clip.offsets.detach().double()[local]
    turned = axis_rotation("Y", torch.from_numpy(turn))
    root = (turned @ root[..., None])[..., 0] + torch.from_numpy(np.stack((shift.imag, 0 * turn, shift.real), axis=-1))
    rotations[:, 0] = turned @ rotations[:, 0]
    return replace(model, root_position=root, rotations=rotations, offsets=offsets)
