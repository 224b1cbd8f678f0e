"""The skin of a body from a file: its vertices in the pose in which the body stands, and which of them are soles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff.export.skinning import skinned
from hopdiff.geometry.body_parts import rest_positions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.glb_mesh import SkinnedMesh

FEW = 4  # vertices of a foot below which they tell no sole
CARRIED = 0.05  # weight on any vertex above which a joint carries the skin
HELD = 0.5  # weight from which on a foot's joints hold a vertex
DEEPEST = 0.8  # of a leg's length that a sole may be below the ankle
STUMP, SHANK = 0.05, 0.6  # of a body's height, and of the bone above, from which on what is below a last joint is a
# shank and no foot
NEAR_GROUND = 0.03  # of a body's height up to which a last joint's skin stands on the ground
PITCHES = np.deg2rad(np.arange(-135.0, 136.0, 15.0))  # of the ground against a sole, tip down below 0
ROLLS = np.deg2rad((-20.0, 0.0, 20.0))


@dataclass(frozen=True, eq=False)
class Skin:
    """vertices: (V, 3) at rest in the world [m]. joints: (V, K) that hold each of them, by weights (V, K) that add up
    to 1. edges: (E, 2)."""

    vertices: NDArray[np.float64]
    joints: NDArray[np.int64]
    weights: NDArray[np.float64]
    edges: NDArray[np.int64]

    @classmethod
    def of(cls, meshes: Sequence[SkinnedMesh], matrices: NDArray[np.float64]) -> Skin | None:
        """matrices: (J, 4, 4) of the joints at rest in the world. None without a vertex."""
        if not meshes:
            return None
        places = [skinned(one.vertices, one.joints, one.weights, (matrices @ one.inverse)[None])[0] for one in meshes]
        wide = max(one.joints.shape[1] for one in meshes)
        firsts = np.cumsum([0, *(len(one.vertices) for one in meshes)])
        joints, weights = (
            np.concatenate([np.pad(part, ((0, 0), (0, wide - part.shape[1]))) for part in parts])
            for parts in ([one.joints for one in meshes], [one.weights for one in meshes])
        )
        edges = np.concatenate([one.edges + first for one, first in zip(meshes, firsts, strict=False)])
        return cls(np.concatenate(places), joints, weights, edges)

    @cached_property
    def holder(self) -> NDArray[np.int64]:
        """(V,) the joint that holds each vertex most."""
        found: NDArray[np.int64] = self.joints[np.arange(len(self.joints)), self.weights.argmax(axis=1)]
        return found

    @cached_property
    def _load(self) -> NDArray[np.float64]:
        """Of how many vertices' worth each joint holds the skin, up to the last that holds any."""
        return np.bincount(self.joints.ravel(), self.weights.ravel()).astype(np.float64)

    def everything(self, joint: int) -> float:
        """Of how many vertices' worth a joint holds the skin."""
        return float(self._load[joint]) if joint < len(self._load) else 0.0

    def carriers(self) -> frozenset[int]:
        """The joints that hold more of some vertex than blending brings about."""
        return frozenset(np.unique(self.joints[self.weights > CARRIED]).tolist())

    def held_by(self, joints: Sequence[int]) -> NDArray[np.float64]:
        """(V,) the weight that joints have on every vertex."""
        table = np.zeros(int(self.joints.max()) + 1, dtype=bool)
        table[[joint for joint in joints if joint < len(table)]] = True
        found: NDArray[np.float64] = (self.weights * table[self.joints]).sum(axis=1)
        return found

    def shared(self, joint: int, count: int) -> NDArray[np.float64]:
        """(count,) how much of what a joint holds others of so many hold, too, or lies on the same edges."""
        own = self.held_by([joint])
        across = np.zeros_like(own)
        for one, other in ((0, 1), (1, 0)):
            np.maximum.at(across, self.edges[:, one], own[self.edges[:, other]])
        each = np.maximum(own, across)[:, None] * self.weights
        found: NDArray[np.float64] = np.bincount(self.joints.ravel(), each.ravel(), count).astype(np.float64)
        found[joint] = 0.0
        return found

    def reordered(self, order: Sequence[int]) -> Skin:
        """The same of joints in another order. order: (J) their old numbers."""
        return replace(self, joints=np.argsort(order)[self.joints])


@dataclass(frozen=True, eq=False)
class SkinSole:
    """The outermost vertices of a foot, from the ankle, and of its toes, from the toe joint, in the rest pose [m]; of a
    leg without a foot those of the shank, from its end.

    foot: (K, 3), toe: (M, 3), those that are lowest in some posture of the foot. depth: how far the lowest is below the
    ankle. heel, tip: how far back and ahead of the ankle the sole goes, along `ahead` (3,), level.
    """

    foot: Tensor
    toe: Tensor
    depth: float
    ahead: Tensor
    heel: float
    tip: float


def with_stumps(skeleton: Skeleton, skin: Skin | None) -> Skeleton:
    """The skeleton with an end straight below each shank that nothing hangs on, where its skin meets the ground."""
    if skin is None:
        return skeleton
    places = rest_positions(skeleton) + skeleton.offsets[0]
    ground, height = float(skin.vertices[:, 1].min()), float(np.ptp(skin.vertices[:, 1]))
    ends = dict(skeleton.end_sites)
    for joint, name in enumerate(skeleton.names):
        if name in ends or skeleton.children(joint) or skin.everything(joint) < HELD:
            continue
        held = skin.held_by([joint]) >= HELD
        if not held.any():
            continue
        drop = float(places[joint, 1]) - float(skin.vertices[held, 1].min())
        bone = float(skeleton.offsets[joint].norm())
        if drop > max(STUMP * height, SHANK * bone) and float(places[joint, 1]) - drop - ground < NEAR_GROUND * height:
            ends[name] = torch.tensor((0.0, -drop, 0.0), dtype=torch.float64)
    return replace(skeleton, end_sites=ends)


def stump_sole(skin: Skin, knee: int, end: Tensor) -> SkinSole | None:
    """What a shank without a foot stands on. end: (3,) of the shank at rest [m]. None without a skin there."""
    points = skin.vertices[skin.held_by([knee]) >= HELD] - end.numpy()
    if len(points) == 0:
        return None
    ahead = np.array((0.0, 0.0, 1.0))
    low, none = torch.from_numpy(_outermost(points, ahead)), torch.zeros(0, 3, dtype=torch.float64)
    return SkinSole(low, none, max(-float(points[:, 1].min()), 0.0), torch.from_numpy(ahead), 0.0, 0.0)


def skin_sole(
    skin: Skin, skeleton: Skeleton, places: Tensor, ankle: int, toe: int | None, leg: float
) -> SkinSole | None:
    """The sole of a foot with its shoe. places: (J, 3) of the joints at rest. leg: its length [m].

    None if the skin on these joints is none of a foot.
    """

    at, below = places.numpy(), skeleton.below(ankle)
    own, front = skin.held_by(below), skin.held_by([] if toe is None else skeleton.below(toe))
    here = own >= HELD
    if here.sum() < 2 * FEW:
        # Of boxes few vertices are the foot's alone.
        here = here | np.isin(skin.holder, below)
    if here.sum() < FEW:
        return None
    points = skin.vertices[here] - at[ankle]
    depth = -float(points[:, 1].min())
    if not 0.0 < depth < DEEPEST * leg:
        return None
    low = points[points[:, 1] < -0.5 * depth]
    flat = low[:, [0, 2]]
    line = at[toe] - at[ankle] if toe is not None else None
    ahead = flat.mean(axis=0) if line is None else line[[0, 2]]
    # A box around its joint has no front.
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 1e-6 else np.array((0.0, 1.0))
    along = flat @ ahead
    on_toe = front[here] > 0.5 * own[here]
    facing = np.array((ahead[0], 0.0, ahead[1]))
    foot = _outermost(points[~on_toe], facing)
    tips = points[on_toe] - (at[toe] - at[ankle] if toe is not None else 0.0)
    return SkinSole(
        torch.from_numpy(foot),
        torch.from_numpy(_outermost(tips, facing)),
        depth,
        torch.from_numpy(facing),
        -float(along.min()),
        float(along.max()),
    )


def _outermost(points: NDArray[np.float64], ahead: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) of points (V, 3) those that are lowest for some pitch and roll of the ground."""
    if len(points) == 0:
        return points
    across, up = np.cross((0.0, 1.0, 0.0), ahead), np.array((0.0, 1.0, 0.0))
    normals = [
        np.cos(roll) * (np.cos(pitch) * up + np.sin(pitch) * ahead) + np.sin(roll) * across
        for pitch in PITCHES
        for roll in ROLLS
    ]
    found: NDArray[np.float64] = points[np.unique((points @ np.stack(normals).T).argmin(axis=0))]
    return found
