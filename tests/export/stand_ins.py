"""Characters of nobody: bodies with a skin on the skeletons that programs write, as GLB files, and what files may do.

A body is a few tubes and boxes, 1.7 m high in T pose, facing +z, soles on the ground. Each limb's skin is joined to
what it hangs on, so that a limb that stays behind tears it.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.export.gltf_packing import packed
from tests.export.rig_families import FAMILIES, Family

SIDES = {"left": 1.0, "right": -1.0}
Floats = NDArray[np.float64]
MIDDLE = {
    "pelvis": (0.0, 0.95, 0.0),
    "waist": (0.0, 1.05, 0.0),
    "chest": (0.0, 1.17, 0.0),
    "upper_chest": (0.0, 1.29, 0.0),
    "neck": (0.0, 1.45, 0.0),
    "head": (0.0, 1.53, 0.01),
}
LIMBS = {
    "collar": (0.03, 1.4, 0.0),
    "shoulder": (0.17, 1.4, 0.0),
    "elbow": (0.44, 1.4, -0.01),
    "wrist": (0.69, 1.4, 0.0),
    "hip": (0.09, 0.92, 0.0),
    "knee": (0.09, 0.5, 0.01),
    "ankle": (0.09, 0.09, -0.02),
    "toe": (0.1, 0.03, 0.11),
}
HANDS, CROWN = 0.85, 1.72  # m from the middle to the finger tips, and up to the top of the head
# What a part's skin is on where a skeleton lacks the part.
INSTEAD = {
    "waist": "pelvis",
    "chest": "waist",
    "upper_chest": "chest",
    "neck": "upper_chest",
    "head": "neck",
    "collar": "upper_chest",
    "toe": "ankle",
    "wrist": "elbow",
}
RING = 6  # vertices around a limb


@dataclass
class Rig:
    """places: (J, 3) [m]. hangs: (J) what each joint moves with; parents: what it hangs on in the file. vertices: (V,
    3) with weights (V, J). frames: (J, 3, 3) of the joints. pose: (J, 4, 4) what moves each joint's skin from there to
    where nodes stand. top: (4, 4) above all joints. size: (J, 3) of the joints' frames."""

    names: list[str]
    parts: dict[str, int]
    places: Floats
    hangs: list[int]
    parents: list[int]
    vertices: Floats
    weights: Floats
    faces: NDArray[np.int64]
    frames: Floats
    size: Floats
    pose: Floats
    top: Floats = field(default_factory=lambda: np.eye(4))
    packing: dict[str, bool] = field(default_factory=dict)


def stand_in(family: str, *properties: str) -> bytes:
    """The GLB file of a body on a skeleton of FAMILIES with properties of PROPERTIES."""
    shape = {name: True for name in properties if name in SHAPES}
    rig = _rig(FAMILIES[family], seed=zlib.crc32(family.encode()), **shape)
    for name in properties:
        if name not in SHAPES:
            PROPERTIES[name](rig)
    return packed(rig)


def _rig(given: Family, seed: int, stocky: bool = False, shoes: bool = False) -> Rig:
    places_of = _places(stocky, shoes)
    names = [bone.name for bone in given.bones]
    parents = [-1 if bone.parent is None else names.index(bone.parent) for bone in given.bones]
    places = np.zeros((len(names), 3))
    for k, bone in enumerate(given.bones):
        over = places[parents[k]] if parents[k] >= 0 else np.zeros(3)
        # The second half of a limb is as short as the limb.
        offset = np.array(bone.offset) * (0.4 if stocky and bone.offset[1] < -0.1 else 1.0)
        places[k] = over + offset if bone.part is None else places_of[bone.part]
    parts = {bone.part: k for k, bone in enumerate(given.bones) if bone.part is not None}
    vertices, weights, faces = _skin(parts, parents, places_of, len(names), 0.06 if shoes else 0.0)
    count = len(names)
    return Rig(
        names,
        parts,
        places,
        list(parents),
        parents,
        vertices,
        weights,
        faces,
        Rotation.random(count, random_state=seed % 2**31).as_matrix(),
        np.ones((count, 3)),
        np.tile(np.eye(4), (count, 1, 1)),
    )


def _places(stocky: bool, shoes: bool) -> dict[str, Floats]:
    """Part -> (3,). stocky: short legs, ankles high over the sole. shoes: with soles of 6 cm below the bones."""
    found = {part: np.array(place) for part, place in MIDDLE.items()}
    for side, sign in SIDES.items():
        found |= {f"{side}_{part}": np.array(place) * (sign, 1.0, 1.0) for part, place in LIMBS.items()}
    if stocky:
        for part, place in found.items():
            low = part.rpartition("_")[2]
            heights = {"hip": 0.5, "knee": 0.33, "ankle": 0.16, "toe": 0.05}
            place[1] = heights[low] if low in heights else place[1] - 0.42
    for place in found.values():
        place[1] += 0.06 if shoes else 0.0
    return found


def _skin(
    parts: Mapping[str, int], parents: Sequence[int], places: Mapping[str, Floats], count: int, sole: float
) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Vertices (V, 3), weights (V, count) and faces (F, 3). sole: how thick shoes are below the bones [m]."""
    vertices: list[Floats] = []
    weights: list[Floats] = []
    faces: list[tuple[int, int, int]] = []

    def on(part: str) -> str:
        side, _, name = part.rpartition("_")
        while part not in parts:
            instead = INSTEAD[name if side in SIDES else part]
            part = f"{side}_{instead}" if side in SIDES and instead in LIMBS else instead
            side, _, name = part.rpartition("_")
        return part

    def held(part: str, other: str, share: float, late: bool = False) -> Floats:
        """Weights of a vertex on a part and, by a share, on another. late: in the second half of the part's bone."""
        found = np.zeros(count)
        own = parts[on(part)]
        if late:
            # Limbs of several pieces: the last before what comes next.
            line, joint = list[int](), parts[on(other)]
            while joint >= 0 and joint != own:
                line.append(joint)
                joint = parents[joint]
            own = line[1] if joint == own and len(line) > 1 else own
        found[own] += 1.0 - share
        found[parts[on(other)]] += share
        return found

    def ring(middle: Floats, across: Floats, ahead: Floats, weight: Floats) -> int:
        first = len(vertices)
        for angle in np.linspace(0.0, 2.0 * np.pi, RING, endpoint=False):
            vertices.append(middle + np.cos(angle) * across + np.sin(angle) * ahead)
            weights.append(weight)
        return first

    def tube(one: int, other: int) -> None:
        for k in range(RING):
            nxt = (k + 1) % RING
            faces.append((one + k, other + k, one + nxt))
            faces.append((one + nxt, other + k, other + nxt))

    def limb(chain: Sequence[tuple[str, Floats, float]], base: str, axes: Floats, start: int | None) -> int:
        """Rings along parts and their places; joined to ring `start`. Returns the last ring."""
        before, last = base, start
        for k, (part, place, radius) in enumerate(chain):
            far = chain[k + 1] if k + 1 < len(chain) else None
            rings = [(0.0, held(part, before, 0.5))]
            if far is not None:
                rings += [(0.25, held(part, before, 0.0)), (0.75, held(part, far[0], 0.0, late=True))]
            for share, weight in rings:
                middle = place if far is None else place + share * (far[1] - place)
                new = ring(middle, radius * axes[0], radius * axes[1], weight)
                if last is not None:
                    tube(last, new)
                last = new
            before = part
        assert last is not None
        return last

    level = np.array(((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    trunk = [
        (part, places[part], width) for part, width in zip(MIDDLE, (0.15, 0.13, 0.14, 0.15, 0.05, 0.08), strict=True)
    ]
    top = np.array((0.0, places["head"][1] + CROWN - MIDDLE["head"][1], 0.01))
    low = ring(places["pelvis"] - (0.0, 0.05, 0.0), 0.15 * level[0], 0.1 * level[1], held("pelvis", "pelvis", 0.0))
    neck = limb(trunk, "pelvis", level * ((1.0,), (0.75,)), low)
    crown = ring(top, 0.06 * level[0], 0.06 * level[1], held("head", "head", 0.0))
    tube(neck, crown)
    vertices.append(places["head"] + (0.0, 0.06, 0.13))  # a nose
    weights.append(held("head", "head", 0.0))
    faces.append((len(vertices) - 1, neck + 1, crown + 1))
    faces.append((len(vertices) - 1, neck + 2, crown + 2))
    chest = low + 3 * RING * 3 + RING  # the ring of the shoulders
    for side, sign in SIDES.items():
        upright = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
        arm = [
            (f"{side}_{part}", places[f"{side}_{part}"], r)
            for part, r in (("shoulder", 0.05), ("elbow", 0.04), ("wrist", 0.03))
        ]
        first = len(vertices)
        last = limb(arm, f"{side}_collar", upright, None)
        hand = ring(
            np.array((sign * HANDS, arm[2][1][1], 0.0)),
            0.02 * upright[0],
            0.03 * upright[1],
            held(f"{side}_wrist", f"{side}_wrist", 0.0),
        )
        tube(last, hand)
        tube(chest, first)
        leg = [
            (f"{side}_{part}", places[f"{side}_{part}"], r)
            for part, r in (("hip", 0.08), ("knee", 0.055), ("ankle", 0.045))
        ]
        first = len(vertices)
        shin = limb(leg, "pelvis", level, None)
        tube(low, first)
        ankle, toe = f"{side}_ankle", f"{side}_toe"
        shares = ((-0.07, 0.1, ankle, 0.0), (0.0, 0.1, ankle, 0.0), (0.12, 0.06, toe, 0.5), (0.19, 0.04, toe, 0.0))
        rear = None
        for z, height, part, share in shares:
            # Half a ring along the sole, half of it above.
            section = len(vertices)
            outline = ((0.04, 0.0), (-0.04, 0.0), (-0.035, 1.0), (0.0, 1.0), (0.035, 1.0), (0.045, 0.5))
            for x, share_up in outline:
                y = share_up * height
                vertices.append(np.array((places[ankle][0] + x, y + (sole + 0.02 if y else 0.0), z)))
                weights.append(held(part, ankle, share))
            if rear is not None:
                tube(rear, section)
            elif not rear:
                tube(shin, section)
            rear = section
    return np.array(vertices), np.array(weights), np.array(faces, dtype=np.int64)


def _add_joint(rig: Rig, name: str, parent: int, place: Floats) -> None:
    rig.names.append(name)
    rig.parents.append(parent)
    rig.hangs.append(parent)
    rig.places = np.concatenate((rig.places, place[None]))
    rig.weights = np.concatenate((rig.weights, np.zeros((len(rig.weights), 1))), axis=1)
    rig.frames = np.concatenate((rig.frames, np.eye(3)[None]))
    rig.size = np.concatenate((rig.size, np.ones((1, 3))))
    rig.pose = np.concatenate((rig.pose, np.eye(4)[None]))


def _ik_feet(rig: Rig) -> None:
    """Feet hang on the root, and leaves that hold nothing end the shanks, as rigs for inverse kinematics have it."""
    if rig.parents[rig.parts["pelvis"]] < 0:
        first = len(rig.names)
        _add_joint(rig, "Rig_Root", -1, np.zeros(3))
        rig.parents[rig.parts["pelvis"]] = first
        rig.hangs[rig.parts["pelvis"]] = first
    root = next(k for k, parent in enumerate(rig.parents) if parent < 0)
    for side in SIDES:
        ankle, knee = rig.parts[f"{side}_ankle"], rig.parts[f"{side}_knee"]
        rig.parents[ankle] = root
        _add_joint(rig, rig.names[knee] + "_end", knee, rig.places[ankle])


def _posed(rig: Rig) -> None:
    """Nodes stand in the middle of a run; the skin was made in a T pose."""
    angles = {
        "pelvis": (8.0, 5.0, 0.0),
        "head": (0.0, 42.0, 0.0),
        "left_hip": (-45.0, 0.0, 0.0),
        "left_knee": (75.0, 0.0, 0.0),
        "right_hip": (25.0, 0.0, 0.0),
        "right_knee": (30.0, 0.0, 0.0),
        "left_shoulder": (0.0, 20.0, -70.0),
        "right_shoulder": (0.0, 20.0, 70.0),
        "left_elbow": (0.0, -80.0, 0.0),
        "right_elbow": (0.0, 80.0, 0.0),
        "left_ankle": (20.0, 0.0, 0.0),
    }
    own = {rig.parts[part]: turn for part, turn in angles.items() if part in rig.parts}
    for joint in sorted(range(len(rig.names)), key=lambda k: len(_line(rig.hangs, k))):
        over = rig.pose[rig.hangs[joint]] if rig.hangs[joint] >= 0 else np.eye(4)
        about = np.eye(4)
        turn = Rotation.from_euler("xyz", own.get(joint, (0.0, 0.0, 0.0)), degrees=True).as_matrix()
        about[:3, :3], about[:3, 3] = turn, rig.places[joint] - turn @ rig.places[joint]
        rig.pose[joint] = over @ about


def _line(parents: Sequence[int], joint: int) -> list[int]:
    found = [joint]
    while (joint := parents[joint]) >= 0:
        found.append(joint)
    return found


def _top(scale: Sequence[float], turn: Rotation) -> Callable[[Rig], None]:
    def change(rig: Rig) -> None:
        own = np.eye(4)
        own[:3, :3] = turn.as_matrix() * np.array(scale)
        rig.top = own @ rig.top

    return change


def _uneven(rig: Rig) -> None:
    """The head is scaled unevenly, and nothing else."""
    rig.size[rig.parts["head"]] = (1.1, 0.9, 1.05)


def _marked(name: str) -> Callable[[Rig], None]:
    return lambda rig: rig.packing.update({name: True})


SHAPES = ("stocky", "shoes")
NONE = Rotation.identity()
PROPERTIES: Mapping[str, Callable[[Rig], None]] = {
    "ik_feet": _ik_feet,
    "posed": _posed,
    "uneven": _uneven,
    "mirrored": _top((-1.0, 1.0, 1.0), NONE),
    "backwards": _top((1.0, 1.0, 1.0), Rotation.from_euler("y", 180.0, degrees=True)),
    **{
        name: _marked(name)
        for name in ("centimetres", "fallback", "quantised", "sparse", "morphs", "skins", "matrices")
    },
}
ALL = (*SHAPES, *PROPERTIES)
