"""The outline of a body from its joint positions: shapes that any canvas can fill."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.joint_names import side_of
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.plots.joints import points_of
from hopdiff.plots.shapes import capsule, circle, ellipse, hull
from hopdiff.plots.shapes import foot as outline_of_foot
from hopdiff.plots.view import Array, Camera
from hopdiff.whole_body.skeleton import BALL, HEEL

# Half thickness along a limb or the trunk, in limb or trunk lengths, at 0, 1/2 and 1 of the way.
_THICKNESS = {"leg": (0.085, 0.055, 0.028), "arm": (0.078, 0.055, 0.036), "trunk": (0.19, 0.17, 0.16)}
_WAY = (0.0, 0.5, 1.0)
_HEAD_SHARE = 0.78  # of the way from the neck joint to the top of the head
_HEAD_WIDTH = 0.8  # of the head's height
# The trunk from any side, beyond its thickness.
_WAIST = 0.3  # how much wider than thick it is where no limbs grow from it
_RIBS = (0.5, 0.85)  # of the way from its spine to the root of a limb, and of its thickness there
_ROOT = 0.85  # of that way its outermost part, as thick as the limb
_SOLE = 0.72  # half its thickness, in that of the leg at the ball of the foot
_IN_LINE = 0.1  # sine of the angle between shank and foot, below which they lie in one line
_COLLAR = "_collar"
_SIGN = {"left": 1.0, "right": -1.0}
_DEPTH = {"far arm": 0, "far leg": 1, "middle trunk": 2, "middle head": 3, "near leg": 4, "near arm": 5}


@dataclass(frozen=True)
class Part:
    """A filled shape in the plane of view. side: "left", "right" or "middle"; outline: (K, 2) [m]."""

    side: str
    outline: Array


@dataclass(frozen=True)
class _Bone:
    start: int
    end: int
    side: str
    kind: str
    radii: tuple[float, float]


@dataclass(frozen=True)
class _Foot:
    """A foot by its nodes; hips: left and right. along, across: how far the heel is from the ankle along the line to
    the toe joint and, in the plane of shank and foot, across it [m]."""

    hips: tuple[int, int]
    knee: int
    ankle: int
    toe: int
    tip: int
    along: float
    across: float

    def left(self, points: Array) -> Array:
        """(3,) the unit step to the left of the foot in a pose."""
        shank, forward = points[self.knee] - points[self.ankle], self._forward(points)
        across = points[self.hips[0]] - points[self.hips[1]]
        left = np.cross(shank, forward)
        # Where shank and foot lie in one line they tell nothing; beyond it they would turn the foot over.
        if np.linalg.norm(left) < _IN_LINE * np.linalg.norm(shank):
            left = across - (across @ forward) * forward
        left = left if left @ across >= 0.0 else -left
        return np.asarray(left / max(float(np.linalg.norm(left)), 1e-9))

    def heel(self, points: Array) -> Array:
        """(3,) where the heel is in a pose [m]."""
        forward = self._forward(points)
        down = np.cross(self.left(points), forward)
        return np.asarray(points[self.ankle] + self.along * forward + self.across * down)

    def _forward(self, points: Array) -> Array:
        forward = points[self.toe] - points[self.ankle]
        return np.asarray(forward / max(float(np.linalg.norm(forward)), 1e-9))


@dataclass(frozen=True)
class _Girth:
    """The trunk around one of its nodes. radius: half its thickness [m]; roots: first node and radius of each limb."""

    node: int
    radius: float
    roots: tuple[tuple[int, float], ...]


class Body:
    """Turns points of a pose into parts, far ones first.

    Seen from the runner's right, forward is to the right and the left side is the far one; a camera sees the body
    from anywhere else. A joint belongs to a side if its name says so; the head is the end site of the joint "neck",
    or of a joint "head" on it, if there is one. Thickness goes with the length of limbs and trunk, so every body size
    looks right.
    """

    def __init__(self, skeleton: Skeleton) -> None:
        self.joint_names = skeleton.names
        self.end_names = tuple(name for name in skeleton.names if name in skeleton.end_sites)
        bones = _bones(skeleton, self.end_names)
        self._bones = sorted(bones, key=lambda bone: _DEPTH[f"{_layer(bone.side)} {bone.kind}"])
        self._sides = [side_of(name) for name in (*self.joint_names, *self.end_names)]
        self._girths = _girths(skeleton, bones)
        self._feet = _feet(skeleton)

    def points(self, clip: Clip) -> Array:
        """(T, J + E, 3) world positions of the joints and, after them, the end sites [m]."""
        return points_of(clip)

    def parts(self, points: Array, camera: Camera | None = None) -> list[Part]:
        """The shapes of one pose. points: (J + E, 3).

        Outlines have the world's z as first, y as second axis; with a camera, what is right and up in its picture.
        """
        if camera is not None:
            return self._seen(points, camera)
        parts = []
        for bone in self._bones:
            if bone.kind == "head":
                parts += _head(_from_the_right(points), bone)
            elif bone.start not in self._feet:
                parts.append(Part(bone.side, self._outline(points, bone, _from_the_right)))
        return parts

    def _outline(self, points: Array, bone: _Bone, flat: Callable[[Array], Array]) -> Array:
        """Of a bone with round ends, or of the whole foot where it is the bone that ends at the toes. flat: puts points
        (..., 3) into the picture (..., 2)."""
        if (foot := self._feet.get(bone.end)) is not None:
            left, heel = foot.left(points), foot.heel(points)
            corners = np.stack((points[foot.ankle], heel, points[foot.toe], points[foot.tip]))
            return outline_of_foot(corners, left, (bone.radii[0], _SOLE * bone.radii[1]), flat)
        start, end = points[bone.start], points[bone.end]
        if bone.end >= len(self.joint_names):
            # The round end of a limb ends where the limb does.
            way = start - end
            end = end + min(1.0, bone.radii[1] / max(float(np.linalg.norm(way)), 1e-9)) * way
        return capsule(flat(start), flat(end), *bone.radii)

    def _seen(self, points: Array, camera: Camera) -> list[Part]:
        flat, near = camera.project(points)[:, :2], camera.nearness(points)
        # The middle is one piece in one colour, so its own order does not matter.
        trunk = float(near[list(self._girths) or [0]].mean())
        found = [(trunk, part) for part in self._middle(points, flat, camera)]
        for bone in self._bones:
            if bone.side != "middle" and bone.start not in self._feet:
                outline = self._outline(points, bone, lambda place: camera.project(place)[..., :2])
                found.append((float(near[[bone.start, bone.end]].mean()), Part(bone.side, outline)))
        return [part for _, part in sorted(found, key=lambda item: item[0])]

    def _middle(self, points: Array, flat: Array, camera: Camera) -> list[Part]:
        """Head and trunk; the trunk is a hull around every two of its nodes: hips and waist, waist and shoulders."""
        wide = sum((_SIGN[self._sides[root]] * points[root] for root, _ in self._roots()), np.zeros(3))
        wide = camera.project(wide / max(float(np.linalg.norm(wide)), 1e-9))[:2]
        parts = []
        for bone in self._bones:
            if bone.kind == "trunk":
                rings = (_ring(self._girths[node], flat, wide) for node in (bone.start, bone.end))
                parts.append(Part("middle", hull(np.concatenate(list(rings)))))
            elif bone.kind == "head":
                parts += _head(flat, bone)
        return parts

    def _roots(self) -> list[tuple[int, float]]:
        return [root for girth in self._girths.values() for root in girth.roots]

    def lines(self, points: Array, side: str, arms: bool = True) -> list[Array]:
        """Centre lines (2, 2) of the bones of a side, for thin stick figures."""
        flat = _from_the_right(points)
        bones = [bone for bone in self._bones if bone.side == side and (arms or bone.kind != "arm")]
        found = [np.stack((flat[bone.start], flat[bone.end])) for bone in bones]
        for bone in bones:
            if (foot := self._feet.get(bone.end)) is not None:
                heel = _from_the_right(foot.heel(points))
                found += [np.stack((flat[node], heel)) for node in (bone.start, bone.end)]
        return found


def _from_the_right(points: Array) -> Array:
    """Points (..., 3) as someone to the right of the runner sees them (..., 2)."""
    return points[..., [2, 1]]


def _head(flat: Array, bone: _Bone) -> list[Part]:
    start, end = flat[bone.start], flat[bone.end]
    chin = end + _HEAD_SHARE * (start - end)
    return [Part("middle", capsule(start, chin, *bone.radii)), Part("middle", ellipse(chin, end, _HEAD_WIDTH))]


def _ring(girth: _Girth, flat: Array, wide: Array) -> Array:
    """Points (N, 2) in the picture around the trunk at one of its nodes. wide: (2,) unit step to the left in it."""
    spine = flat[girth.node]
    if not girth.roots:
        aside = _WAIST * girth.radius * wide
        return np.concatenate([circle(spine + sign * aside, girth.radius) for sign in (-1.0, 1.0)])
    circles = []
    for root, radius in girth.roots:
        way, thickness = _RIBS
        circles.append(circle(spine + _ROOT * (flat[root] - spine), radius))
        circles.append(circle(spine + way * (flat[root] - spine), thickness * girth.radius))
    return np.concatenate(circles)


def _feet(skeleton: Skeleton) -> dict[int, _Foot]:
    """The feet by their toe joint; none where the skeleton has no ankle, or toes without a tip."""
    found = {}
    ends = [name for name in skeleton.names if name in skeleton.end_sites]
    for side in _SIGN:
        names = ["left_hip", "right_hip", *(f"{side}_{part}" for part in ("knee", "ankle", "toe"))]
        if not all(name in skeleton.names for name in names) or names[-1] not in ends:
            continue
        left, right, knee, ankle, toe = (skeleton.index(name) for name in names)
        _, down, ahead = (float(x) for x in skeleton.offsets[toe])
        length = float(np.hypot(down, ahead))
        back = -HEEL / BALL * ahead
        if length > 0.0:
            along, across = (down * down + back * ahead) / length, (ahead * -down + back * down) / length
            found[toe] = _Foot(
                (left, right), knee, ankle, toe, len(skeleton.names) + ends.index(names[-1]), along, across
            )
    return found


def _layer(side: str) -> str:
    return {"left": "far", "right": "near"}.get(side, "middle")


def _bones(skeleton: Skeleton, end_names: tuple[str, ...]) -> list[_Bone]:
    """One bone from every joint's parent to it and from every end site's joint to the end site.

    Nodes are the joints and then the end sites, so a parent always comes first. A limb starts where the side changes;
    the hidden way from the trunk to a limb's first joint is left out, and so are collarbones.
    """
    count = len(skeleton.names)
    ends = [skeleton.end_sites[name] for name in end_names]
    lengths = [float(offset.norm()) for offset in (*skeleton.offsets, *ends)]
    parents = [*skeleton.parents, *(skeleton.index(name) for name in end_names)]
    names = (*skeleton.names, *end_names)
    sides = [side_of(name) for name in names]
    heads = {count + i: _neck(skeleton, name) for i, name in enumerate(end_names) if _neck(skeleton, name) is not None}
    hidden = {skeleton.index("head")} if "head" in end_names and heads else set()

    first = list(range(len(parents)))  # first node of the node's limb; 0 for the trunk
    before = [0.0] * len(parents)  # length of the limb up to the node
    after = [0.0] * len(parents)  # length of the limb beyond the node
    nodes = [node for node in range(1, len(parents)) if node not in heads and node not in hidden]
    for node in nodes:
        if sides[node] == sides[parents[node]] and not names[parents[node]].endswith(_COLLAR):
            first[node] = first[parents[node]]
            before[node] = before[parents[node]] + lengths[node]
    for node in reversed(nodes):
        if first[node] != node:
            after[parents[node]] = max(after[parents[node]], lengths[node] + after[node])

    bones = []
    for node, neck in heads.items():
        assert neck is not None
        size = lengths[node] + (lengths[parents[node]] if parents[node] != neck else 0.0)
        bones.append(_Bone(neck, node, "middle", "head", (0.16 * size,) * 2))
    for node in nodes:
        if first[node] == node:
            continue
        kind = "trunk" if sides[node] == "middle" else "leg" if parents[first[node]] == 0 else "arm"
        total = before[node] + after[node]
        way = [(before[node] - lengths[node]) / total, before[node] / total] if total > 0 else [0.0, 1.0]
        start, end = np.interp(way, _WAY, _THICKNESS[kind]) * total
        bones.append(_Bone(parents[node], node, sides[node], kind, (float(start), float(end))))
    return bones


def _neck(skeleton: Skeleton, end: str) -> int | None:
    """The joint that a head begins at whose top is the end site of a joint, or None if that is no head."""
    if end == "neck":
        return skeleton.index(end)
    if end == "head" and (parent := skeleton.parents[skeleton.index(end)]) >= 0 and skeleton.names[parent] == "neck":
        return parent
    return None


def _girths(skeleton: Skeleton, bones: list[_Bone]) -> dict[int, _Girth]:
    """The trunk's nodes with the limbs that grow nearest to them while the body stands."""
    identity = torch.eye(3, dtype=skeleton.offsets.dtype).expand(len(skeleton.names), 3, 3)
    rest, _ = skeleton.forward(skeleton.offsets[0].cpu(), identity)
    radii: dict[int, float] = {}
    for bone in bones:
        if bone.kind == "trunk":
            radii.setdefault(bone.start, bone.radii[0])
            radii[bone.end] = bone.radii[1]
    roots: dict[int, list[tuple[int, float]]] = {node: [] for node in radii}
    ends = {bone.end for bone in bones}
    for bone in bones:
        if bone.kind in ("arm", "leg") and bone.start not in ends and radii:
            nearest = min(radii, key=lambda node: float((rest[node] - rest[bone.start]).norm()))
            roots[nearest].append((bone.start, bone.radii[0]))
    return {node: _Girth(node, radius, tuple(roots[node])) for node, radius in radii.items()}
