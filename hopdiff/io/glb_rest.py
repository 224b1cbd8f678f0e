"""The pose that a GLB file's mesh was made in: its joints by the inverse bind matrices of its skins.

Khronos Group, glTF 2.0 specification (2021), section 3.7.3. The matrices tell the joints against the mesh and not
against the world: what takes the mesh into the world is the same for all joints, and to be guessed where nodes stand
otherwise.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np
from numpy.typing import NDArray

from hopdiff.io.glb_parse import GlbSkin, Matrix, ParsedGlb

SAME = 1e-3  # of the body's size by which a joint may be off its bind pose and still stand in it
TURNED = 2e-3  # and its axes, of their length


def rest_poses(file: ParsedGlb, holding: Collection[int] = ()) -> Iterator[Matrix]:
    """Joints (J, 4, 4) in the world as they may have been when the mesh was bound to them, the likeliest first; then
    as the nodes stand in the file. holding: joints that hold some of the mesh, as far as that is known: programs write
    anything for the others."""
    size = float(np.ptp(file.matrices[:, :3, 3], axis=0).max())
    main = next((skin for skin in file.skins if skin.inverse is not None and np.ptp(skin.inverse, axis=0).any()), None)
    found: list[Matrix] = []
    if main is not None and main.inverse is not None:
        sound = _sound(main, holding)
        joints, bound = np.array(main.joints)[sound], inverted(main.inverse[sound])
        world = file.matrices[joints]
        each = world @ main.inverse[sound]
        if not len(joints):
            yield file.matrices
            return
        length = _lengths(file, joints, world) / np.maximum(_lengths(file, joints, bound), 1e-12)
        kept = length[np.isfinite(length) & (length > 0.0)]
        scale = float(np.median(kept)) if len(kept) else 1.0
        # That of most joints; of those high up, which poses leave alone; of what they hang on; none.
        guesses = [_sized(one, scale, bound[0], world[0]) for one in (file.above, np.eye(4))]
        candidates = [*each, *guesses]
        agreeing = [_agreeing(world, one @ bound, size) for one in candidates]
        for at in sorted(range(len(candidates)), key=lambda k: -agreeing[k])[: len(each)]:
            if any(_agreeing(candidates[at] @ bound, other[joints], size) == len(joints) for other in found):
                continue
            found.append(_whole(file, candidates[at] @ bound, joints, size, holding))
            yield found[-1]
            if agreeing[at] == len(joints):
                return
            if len(found) == 4:
                break
        for guess in guesses:
            found.append(_whole(file, guess @ bound, joints, size, holding))
            yield found[-1]
    yield file.matrices


def _sound(skin: GlbSkin, holding: Collection[int]) -> NDArray[np.bool_]:
    """(N,) whose matrices tell where a joint of a skin was."""
    assert skin.inverse is not None
    used = np.array([not holding or joint in holding for joint in skin.joints])
    found: NDArray[np.bool_] = used & (skin.inverse[:, 3, 3] != 0.0)
    return found


def _whole(file: ParsedGlb, bound: Matrix, joints: Matrix, size: float, holding: Collection[int] = ()) -> Matrix:
    """(J, 4, 4) of all joints, those of the first skin as bound (N, 4, 4). Nodes that stand in that pose already keep
    their own digits, and those of no skin stand against their parents as in the file."""
    known: dict[int, Matrix] = dict(zip(joints.tolist(), bound, strict=True))
    for skin in file.skins[1:]:
        if skin.inverse is None:
            continue
        own = np.flatnonzero(_sound(skin, holding)).tolist()
        shared = [k for k in own if skin.joints[k] in known]
        if not shared:
            continue
        place = known[skin.joints[shared[0]]] @ skin.inverse[shared[0]]
        for k in own:
            known.setdefault(skin.joints[k], place @ inverted(skin.inverse[k]))
    found = np.empty_like(file.matrices)
    for k, parent in enumerate(file.parents):
        over, under = (file.above, file.above) if parent < 0 else (file.matrices[parent], found[parent])
        # A parent that flattens what it holds has no inverse.
        local = np.linalg.pinv(over) @ file.matrices[k]
        stays = under @ local
        found[k] = known[k] if k in known and _agreeing(stays[None], known[k][None], size) == 0 else stays
    return found


def _lengths(file: ParsedGlb, joints: Matrix, matrices: Matrix) -> Matrix:
    """(N) of the bones from each joint's parent to it; nan where the parent is not among the joints."""
    at = {joint: k for k, joint in enumerate(joints.tolist())}
    over = [at.get(file.parents[joint], -1) for joint in joints.tolist()]
    far: Matrix = np.linalg.norm(matrices[:, :3, 3] - matrices[over, :3, 3], axis=1)
    return np.where(np.array(over) < 0, np.nan, far)


def _sized(place: Matrix, scale: float, bound: Matrix, world: Matrix) -> Matrix:
    """(4, 4) turned as a matrix is, of the scale that bones have, such that the first joint is where its node is."""
    found = np.eye(4)
    found[:3, :3] = scale * turn_of(place)
    found[:3, 3] = world[:3, 3] - found[:3, :3] @ bound[:3, 3]
    return found


def _agreeing(ours: Matrix, theirs: Matrix, size: float) -> int:
    """How many of two lots of matrices (N, 4, 4) are the same."""
    far = np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=1) < SAME * max(size, 1e-9)
    length = np.maximum(np.linalg.norm(theirs[:, :3, :3], axis=(1, 2)), 1e-12)
    turned = np.linalg.norm(ours[:, :3, :3] - theirs[:, :3, :3], axis=(1, 2)) < TURNED * length
    return int((far & turned).sum())


def inverted(matrices: Matrix) -> Matrix:
    """(..., 4, 4)"""
    found: Matrix = np.linalg.inv(matrices).astype(np.float64)
    return found


def turn_of(matrix: Matrix) -> Matrix:
    """(3, 3) the turn in a matrix (4, 4), mirrored where that mirrors."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    found: Matrix = left @ right
    return found
