"""Runs on the skeletons and in the files that programs write, looked at as a program that plays them does."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from hopdiff.export.retarget import read_target, retargeted, write_retargeted
from hopdiff.types import HopdiffError
from tests.export.rig_families import FAMILIES
from tests.export.skins import Played
from tests.export.stand_ins import ALL, stand_in
from tests.export.takes import own

WIDELY_USED = (
    *("mixamo", "vroid", "character_creator", "daz_genesis_8", "rigify", "unreal_4", "unreal_5", "biped", "mmd"),
    *("smpl", "quaternius", "makehuman", "numbered"),
)
AGAINST = {"mirrored": {"backwards"}}  # what is one thing twice
# Names that tell nothing, feet that hang elsewhere, and no skin that knows the ends of the shanks: refused.
UNKNOWN = ("numbered", {"ik_feet", "skins"})
PAIRS = [pair for pair in combinations(ALL, 2) if pair[1] not in AGAINST.get(pair[0], ())]
LOOKS = 12


@cache
def parts_of(family: str) -> dict[str, str]:
    return FAMILIES[family].parts


def look(path: Path, family: str, properties: tuple[str, ...]) -> None:
    """Put a run on a stand-in and see that it runs as a person does."""
    path.write_bytes(stand_in(family, *properties))
    if (family, set(properties)) == UNKNOWN:
        with pytest.raises(HopdiffError, match=r"names do not tell them: see retarget\.names"):
            read_target(path)
        return
    target = read_target(path)
    take = retargeted(own(), target)
    checks = write_retargeted(path.with_name("out.glb"), [take], target)
    assert checks[0].sole is not None
    parts = parts_of(family)
    mirrored = "mirrored" in properties
    swapped = {"left": "right", "right": "left"} if mirrored else {"left": "left", "right": "right"}
    found = {part: target.skeleton.names[joint] for part, joint in target.parts.items()}
    for part, joint in parts.items():
        side, _, name = part.rpartition("_")
        assert found.get(f"{swapped[side]}_{name}" if side in swapped else part) == joint, part
    played = Played.of(path.with_name("out.glb"))
    nodes = {part: played.node(joint) for part, joint in found.items()}
    lying = "centimetres" in properties
    ahead, up = ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)) if lying else ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
    scale = None
    assert take.contact is not None
    for frame in np.linspace(0, take.frames - 1, LOOKS).round().astype(int).tolist():
        worlds = played.worlds(take.name, frame * take.clip.frame_time)
        shapes = played.shape(worlds)
        pairs = [(now[edges], at[edges]) for now, (at, edges, *_) in zip(shapes, played.skinned, strict=True)]
        now, before = (np.concatenate([_lengths(pair[k]) for pair in pairs]) for k in (0, 1))
        scale = float(np.median(now / before)) if scale is None else scale
        # Short edges of a joint's crease stretch further than people see.
        grown = now - scale * before
        assert (now[grown > 0.03] / (scale * before[grown > 0.03])).max(initial=1.0) < 2.0
        lowest = min(float(shape[:, 1].min()) for shape in shapes)
        stands = take.contact[frame].numpy()
        assert lowest > -0.01
        if stands.any():
            assert lowest < 0.01
        for k, side in enumerate(("left", "right")):
            hip, knee, ankle = (worlds[nodes[f"{side}_{part}"]][:3, 3] for part in ("hip", "knee", "ankle"))
            line = ankle - hip
            off = (knee - hip) - line * float((knee - hip) @ line) / float(line @ line)
            assert off[2] > -0.01
            if stands[k] and not stands[1 - k]:
                low = np.concatenate(shapes)[np.concatenate([shape[:, 1] for shape in shapes]).argmin()]
                assert np.linalg.norm(low - ankle) < 0.35
        assert worlds[nodes["left_hip"]][0, 3] > worlds[nodes["right_hip"]][0, 3]
        head = nodes["head" if "head" in nodes else "pelvis"]
        moved = next(worlds[head] @ inverse[of.index(head)] for *_, inverse, of in played.skinned if head in of)
        assert _unit(moved[:3, :3] @ ahead)[2] > 0.8
        assert _unit(moved[:3, :3] @ up)[1] > 0.8


def _lengths(ends: np.ndarray) -> np.ndarray:
    """(E,) of edges (E, 2, 3)."""
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)


def _unit(line: np.ndarray) -> np.ndarray:
    return line / np.linalg.norm(line)


@pytest.mark.parametrize("family", FAMILIES)
def test_every_skeleton_carries_a_run(tmp_path: Path, family: str) -> None:
    look(tmp_path / "in.glb", family, ())


@pytest.mark.parametrize("family", WIDELY_USED)
@pytest.mark.parametrize("name", ALL)
@pytest.mark.few(3)
def test_one_property(tmp_path: Path, family: str, name: str) -> None:
    look(tmp_path / "in.glb", family, (name,))


@pytest.mark.parametrize("family", WIDELY_USED)
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.few(25)
def test_two_properties(tmp_path: Path, family: str, pair: tuple[str, str]) -> None:
    look(tmp_path / "in.glb", family, pair)
