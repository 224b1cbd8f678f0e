"""A written GLB file looked at once more: does the skin follow the motion in it?

Nodes, animation and skins are read from the bytes, as a program that plays the file reads them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hopdiff.export.skin import HELD, Skin
from hopdiff.export.skinning import skinned
from hopdiff.export.take import Take
from hopdiff.export.target import Target
from hopdiff.feet.contacts import spans
from hopdiff.io.glb_accessors import Accessors
from hopdiff.io.glb_file import GlbFile
from hopdiff.io.glb_mesh import skinned_meshes
from hopdiff.io.glb_parse import Matrix, ParsedGlb, parse_glb

LOOKS = 16  # frames of a motion that are looked at, those in contact among them
STRETCHED = 2.0  # times its length at rest that an edge may have
TORN = 3.0  # and from which on a skin is torn where the edge is as long as that, too:
GROWN = 0.25  # of the leg's length by which it has grown
SEEN = 0.06  # of the leg's length from which on people see it
SHORT = 0.02  # of the leg's length by which every edge may grow
OFF = 0.01  # m that a sole may be off the ground
BEHIND = 1.3  # of the farthest from the pelvis at rest


@dataclass(frozen=True)
class SkinCheck:
    """stretch: the largest ratio of an edge to its length at rest, of those that grew by more than a little; grown:
    by how much that one did [m]; between: the joints that hold its ends most. sole: farthest that the lowest point of a
    standing foot is from the ground [m]. behind: joints whose skin stays behind. frames: how many were looked at. leg:
    length of the legs [m]."""

    stretch: float
    grown: float
    between: tuple[str, str]
    sole: float | None
    behind: tuple[str, ...]
    frames: int
    leg: float

    @property
    def torn(self) -> bool:
        """Whether a part of the skin is not where the rest of it goes."""
        return bool(self.behind) or (self.stretch > TORN and self.grown > GROWN * self.leg)

    @property
    def where(self) -> str:
        """The joints of the worst edge, for people."""
        return " and ".join(repr(joint) for joint in dict.fromkeys(self.between))

    def sentence(self) -> str:
        """How the skin follows, for people; edges that grow too little to be seen aside."""
        text = f"edges at most {self.stretch:.1f} x as long as at rest"
        return text if self.sole is None else f"{text}, soles within {100 * self.sole:.1f} cm of the ground"

    def warnings(self, name: str) -> list[str]:
        """What is not as it should be. name: of the body."""
        found = []
        if self.stretch > STRETCHED and self.grown > SEEN * self.leg:
            found.append(
                f"{name}: its skin stretches at {self.where}, one edge to"
                f" {self.stretch:.1f} times its length ({100 * self.grown:.0f} cm longer); look there."
            )
        if self.sole is not None and self.sole > OFF:
            found.append(f"{name}: its soles are up to {100 * self.sole:.1f} cm off the ground while they stand.")
        return found

    def numbers(self) -> dict[str, Any]:
        """For programs."""
        return {
            "edge_stretch": self.stretch,
            "edge_grown": self.grown,
            "edge_between": list(self.between),
            "sole_error": self.sole,
            "left_behind": list(self.behind),
            "frames": self.frames,
        }


def worst_of(checks: Sequence[SkinCheck]) -> SkinCheck | None:
    """Several as one: the worst edge, the worst sole, and all that is left behind."""
    if not checks:
        return None
    soles = [check.sole for check in checks if check.sole is not None]
    return replace(
        max(checks, key=lambda check: check.stretch),
        sole=max(soles, default=None),
        behind=tuple(dict.fromkeys(joint for check in checks for joint in check.behind)),
        frames=sum(check.frames for check in checks),
    )


def check_skin(data: bytes, takes: Sequence[Take], target: Target) -> list[SkinCheck]:
    """The skin in a written file at some frames of its last animations, one for each take; none where the file has no
    skin that can be read. target: the body that the takes were put on."""
    if target.skin is None:
        return []
    file = GlbFile(*parse_glb(data, target.name))
    pelvis = file.names.index(target.skeleton.names[target.parts["pelvis"]])
    meshes, found = skinned_meshes(file).meshes, []
    for take, animation in zip(takes, file.content["animations"][-len(takes) :], strict=True):
        frames = _looked_at(take)
        times = (frames * float(take.clip.frame_time)).astype(np.float64)
        worlds = _worlds(file, animation, times)
        places = [skinned(mesh.vertices, mesh.joints, mesh.weights, worlds @ mesh.inverse) for mesh in meshes]
        found.append(
            _check(np.concatenate(places, axis=1), worlds[:, pelvis, :3, 3], frames, take, target, target.skin)
        )
    return found


def _check(
    places: Matrix, pelvis: Matrix, frames: NDArray[np.int64], take: Take, target: Target, skin: Skin
) -> SkinCheck:
    """places: (T, V, 3) of the vertices at some frames, pelvis: (T, 3) of that joint."""
    edges, most = skin.edges, skin.holder
    names, leg = target.skeleton.names, target.standing()
    before = np.linalg.norm(skin.vertices[edges[:, 0]] - skin.vertices[edges[:, 1]], axis=1)
    after = np.linalg.norm(places[:, edges[:, 0]] - places[:, edges[:, 1]], axis=2).max(axis=0)
    ratio = np.where(after - before > SHORT * leg, after / np.maximum(before, 1e-9), 1.0)
    worst = int(ratio.argmax()) if len(ratio) else None
    middle = target.places[target.parts["pelvis"]].numpy()
    reach = BEHIND * max(float(np.linalg.norm(skin.vertices - middle, axis=1).max()), leg)
    far = np.linalg.norm(places - pelvis[:, None], axis=2).max(axis=0) > reach
    return SkinCheck(
        1.0 if worst is None else float(ratio[worst]),
        0.0 if worst is None else float(after[worst] - before[worst]),
        ("", "") if worst is None else (names[most[edges[worst, 0]]], names[most[edges[worst, 1]]]),
        _sole_error(places, frames, take, target, skin),
        tuple(names[joint] for joint in np.unique(most[far])),
        len(frames),
        leg,
    )


def _looked_at(take: Take) -> NDArray[np.int64]:
    """Frames over the whole motion, and the middles of its first contacts."""
    found = set(np.linspace(0, take.frames - 1, LOOKS).round().astype(int).tolist())
    if take.contact is not None:
        for k in range(take.contact.shape[1]):
            found |= {(first + last) // 2 for first, last in list(spans(take.contact[:, k]))[:2]}
    return np.array(sorted(found), dtype=np.int64)


def _worlds(file: ParsedGlb, animation: Mapping[str, Any], times: Matrix) -> Matrix:
    """(T, J, 4, 4) of the joints in the world while an animation plays, at times (T,) [s]."""
    accessors = Accessors(file.content, file.chunks)
    keys: dict[tuple[int, str], tuple[Matrix, Matrix]] = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        at, values = accessors.values(sampler["input"]), accessors.values(sampler["output"])
        assert at is not None
        assert values is not None
        keys[channel["target"]["node"], channel["target"]["path"]] = at[:, 0], values
    found = np.empty((len(times), len(file.nodes), 4, 4))
    for k, (node, parent) in enumerate(zip(file.nodes, file.parents, strict=True)):
        over = file.above if parent < 0 else found[:, parent]
        found[:, k] = over @ _locals(file.content["nodes"][node], node, keys, times)
    return found


def _locals(node: dict[str, Any], at: int, keys: dict[tuple[int, str], tuple[Matrix, Matrix]], times: Matrix) -> Matrix:
    """(T, 4, 4) of a node in its parent's frame."""
    found = np.tile(np.eye(4), (len(times), 1, 1))
    if "matrix" in node:
        return found @ np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    parts = {}
    for path, still in (
        ("translation", (0.0, 0.0, 0.0)),
        ("rotation", (0.0, 0.0, 0.0, 1.0)),
        ("scale", (1.0, 1.0, 1.0)),
    ):
        own, values = keys.get((at, path), (np.zeros(1), np.array([node.get(path, still)], dtype=np.float64)))
        # Between two keys a quaternion drawn straight and made a unit again is off a slerp by less than these frames.
        parts[path] = np.stack([np.interp(times, own, column) for column in values.T], axis=1)
    found[:, :3, :3] = Rotation.from_quat(parts["rotation"]).as_matrix() * parts["scale"][:, None]
    found[:, :3, 3] = parts["translation"]
    return found


def _sole_error(places: Matrix, frames: NDArray[np.int64], take: Take, target: Target, skin: Skin) -> float | None:
    """Farthest that the lowest vertex of a standing foot is from y = 0 [m]; None without contacts or feet."""
    if take.contact is None:
        return None
    found = []
    for k, leg in enumerate(target.legs):
        if target.sole(leg) is None:
            continue
        foot = leg.knee if leg.ankle is None else leg.ankle
        held = skin.held_by(target.skeleton.below(foot)) >= HELD
        stands = take.contact[torch.from_numpy(frames), k].numpy()
        if held.any() and stands.any():
            found.append(float(np.abs(places[stands][:, held, 1].min(axis=1)).max()))
    return max(found) if found else None
