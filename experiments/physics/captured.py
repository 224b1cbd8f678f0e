"""A captured clip as a recording: a grown man's masses on its joints, contacts guessed, motion smoothed. All rough.

Masses, centres of mass and radii of gyration: de Leva (1996), table 4, male; of the two transverse radii the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_closing, binary_opening
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

from experiments.physics.bvh import Bvh, read_bvh, unit_of
from experiments.physics.recording import SIDES, Array, Recording, UnfitError, world

MASS = 70.0  # kg
CUTOFF = 12.0  # Hz
MARGIN = 2  # frames; what touchdown does is smeared over more by the filter
LOW, SLOW = 0.05, 1.2  # m above the lowest place of the joint in the clip, m/s over the ground: a foot that stands
RUNS = 1.8  # m/s over the ground, mean, from which on a clip is looked at
SHORTEST = 0.05  # s of a contact or of a flight; shorter ones are noise
NAVEL = 0.283  # of the way from the middle of the hips to that of the shoulders


@dataclass(frozen=True)
class Part:
    """A segment of a body. mass: share of the whole. centre: share of its length, from the joint that carries it.

    across, along: radii of gyration about the centre, shares of its length.
    """

    mass: float
    centre: float
    across: float
    along: float


PELVIS = Part(0.1117, 0.3885, 0.583, 0.587)
TRUNK = Part(0.3229, 0.61, 0.40, 0.264)  # middle and upper trunk together, by the parallel axis theorem
HEAD = Part(0.0694, 0.4998, 0.309, 0.261)
LIMBS = {  # carried by the first joint, as far as the second
    ("arm", "forearm"): Part(0.0271, 0.5772, 0.277, 0.158),
    ("forearm", "hand"): Part(0.0162, 0.4574, 0.2705, 0.121),
    ("upleg", "leg"): Part(0.1416, 0.4095, 0.329, 0.149),
    ("leg", "foot"): Part(0.0433, 0.4395, 0.2485, 0.102),
}
HAND = Part(0.0061, 0.068, 0.049, 0.035)  # at the wrist, lengths in metres: clips say little of hands
FOOT = Part(0.0137, 0.5, 0.251, 0.124)  # the centre is taken half-way from the ankle to the toes


def read_clip(path: Path) -> Recording:
    """The recording of a BVH file. Raises UnfitError where joints are not found or the body never leaves the ground."""
    clip = read_bvh(path)
    index = {name.lower().rpartition(":")[2]: joint for joint, name in enumerate(clip.names)}
    index |= {name.replace("toes", "toebase"): joint for name, joint in index.items() if name.endswith("toes")}
    wanted = [f"{side}{part}" for side in SIDES for pair in LIMBS for part in pair] + [f"{s}toebase" for s in SIDES]
    if missing := [name for name in dict.fromkeys((*wanted, "hips", "head")) if name not in index]:
        raise UnfitError(f"{path.name} has no {', '.join(missing)}")
    unit = unit_of(float(np.linalg.norm(clip.offsets[[index["leftleg"], index["leftfoot"]]], axis=-1).sum()))
    root, rotations = smooth(unit * clip.root, clip.rotations, clip.frame_time)
    pace = np.linalg.norm(np.diff(root[:, [0, 2]], axis=0), axis=-1).mean() / clip.frame_time
    if pace < RUNS:
        raise UnfitError(f"{path.name} is no run: {pace:.1f} m/s")
    segments, masses, centres, inertias = _body(clip, index, unit)
    plain = Recording(
        name=path.stem,
        names=clip.names,
        parents=clip.parents,
        offsets=unit * clip.offsets,
        ends={name: unit * end for name, end in clip.ends.items()},
        frame_time=clip.frame_time,
        loop=False,
        root=root,
        rotations=rotations,
        contact=np.zeros((len(root), 2), dtype=bool),
        segments=segments,
        masses=masses,
        centres=centres,
        inertias=inertias,
        margin=MARGIN,
    )
    places, _ = world(plain)
    plain.contact[:] = contacts(places[:, [[index[f"{s}foot"], index[f"{s}toebase"]] for s in SIDES]], clip.frame_time)
    if plain.contact.any(axis=1).all():
        raise UnfitError(f"{path.name} never leaves the ground")
    return plain


def smooth(root: Array, rotations: Array, frame_time: float) -> tuple[Array, Array]:
    """Places (T, 3) and rotations (T, J, 3, 3) after a Butterworth filter of fourth order without delay, at 12 Hz.

    What the filter makes of the ends is cut off.
    """
    b, a = butter(2, CUTOFF, fs=1.0 / frame_time)  # twice, forth and back: of fourth order
    turns = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat().reshape(*rotations.shape[:2], 4)
    flips = np.sign((turns[1:] * turns[:-1]).sum(axis=-1))
    turns[1:] *= np.cumprod(np.where(flips < 0, -1.0, 1.0), axis=0)[..., None]
    turns = filtfilt(b, a, turns, axis=0)
    smoothed = Rotation.from_quat(turns.reshape(-1, 4)).as_matrix().reshape(rotations.shape)
    cut = round(1.0 / (CUTOFF * frame_time))
    return filtfilt(b, a, root, axis=0)[cut:-cut], smoothed[cut:-cut]


def contacts(points: Array, frame_time: float) -> np.ndarray:
    """(T, 2) feet that stand: ankle or toes (T, 2, 2, 3) are near their lowest place in the clip, and slow."""
    level = np.gradient(points[..., [0, 2]], frame_time, axis=0)
    low = points[..., 1] < points[..., 1].min(axis=0) + LOW
    standing = (low & (np.linalg.norm(level, axis=-1) < SLOW)).any(axis=-1)
    width = np.ones((max(1, round(SHORTEST / frame_time)), 1), dtype=bool)
    edge = len(width)
    wide = np.pad(standing, ((edge, edge), (0, 0)), mode="edge")
    return binary_opening(binary_closing(wide, width), width)[edge:-edge]


def _body(clip: Bvh, index: dict[str, int], unit: float) -> tuple[tuple[str, ...], Array, Array, Array]:
    """Segments: their joints, masses (S,) [kg], centres (S, 3) [m] and inertias (S, 3, 3) [kg m^2] in joint frames.

    All as in the clip's rest pose, in which the frames of all joints are parallel.
    """
    rest = np.zeros_like(clip.offsets)
    for joint, parent in enumerate(clip.parents):
        rest[joint] = rest[parent] + unit * clip.offsets[joint] if parent >= 0 else 0.0
    hips, shoulders = (np.mean([rest[index[f"{s}{part}"]] for s in SIDES], axis=0) for part in ("upleg", "arm"))
    navel = hips + NAVEL * (shoulders - hips)
    head, neck = index["head"], index.get("neck", index["head"])
    crown = rest[head] + unit * clip.ends.get(clip.names[head], np.zeros(3))
    found = [
        (index["hips"], PELVIS, hips, navel),
        (_fork(clip, index["leftarm"], index["rightarm"]), TRUNK, navel, shoulders),
        (neck, HEAD, rest[neck], crown),
    ]
    for side in SIDES:
        for (near, far), part in LIMBS.items():
            joint = index[f"{side}{near}"]
            found.append((joint, part, rest[joint], rest[index[f"{side}{far}"]]))
        wrist, ankle = index[f"{side}hand"], index[f"{side}foot"]
        reach = rest[wrist] - rest[index[f"{side}forearm"]]
        found.append((wrist, HAND, rest[wrist], rest[wrist] + reach / np.linalg.norm(reach)))
        toes = index[f"{side}toebase"]
        found.append((ankle, FOOT, rest[ankle], rest[toes] + unit * clip.ends.get(clip.names[toes], np.zeros(3))))
    centres = np.stack([start + part.centre * (end - start) - rest[joint] for joint, part, start, end in found])
    inertias = np.stack([_inertia(part, end - start) for _, part, start, end in found])
    masses = MASS * np.array([part.mass for _, part, _, _ in found])
    return tuple(clip.names[joint] for joint, *_ in found), masses, centres, inertias


def _inertia(part: Part, axis: Array) -> Array:
    """(3, 3) about the centre of a part that lies along an axis (3,) [m]."""
    length = np.linalg.norm(axis)
    along = np.outer(axis, axis) / length**2
    across = np.eye(3) - along
    return MASS * part.mass * length**2 * (part.along**2 * along + part.across**2 * across)


def _fork(clip: Bvh, left: int, right: int) -> int:
    """The joint at which the ways from two joints to the root meet."""

    def way(joint: int) -> list[int]:
        found = [joint]
        while clip.parents[found[-1]] >= 0:
            found.append(clip.parents[found[-1]])
        return found

    others = set(way(right))
    return next(joint for joint in way(left) if joint in others)
