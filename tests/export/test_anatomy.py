from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.export.anatomy import SCHEMES, parts_of, renamed
from hopdiff.export.full_body import full_body
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.takes import WALKS, own, walked


@pytest.mark.parametrize("scheme", SCHEMES)
def test_names_of_other_programs_are_told_again(scheme: str) -> None:
    skeleton = renamed(full_body(own()).clip.skeleton, scheme)
    assert set(SCHEMES[scheme].values()) == set(skeleton.names)
    assert parts_of(skeleton) == {part: k for k, part in enumerate(JOINTS)}
    assert set(skeleton.end_sites) <= set(skeleton.names)


def test_eleven_joints_are_renamed_as_far_as_they_go() -> None:
    names = renamed(own().clip.skeleton, "mixamo").names
    assert names[0] == "mixamorig:Hips"
    assert "mixamorig:LeftUpLeg" in names
    assert "mixamorig:LeftFoot" not in names


@pytest.mark.parametrize("name", WALKS)
def test_parts_of_people_are_where_they_should_be(name: str) -> None:
    skeleton = walked(name).clip.skeleton
    parts = parts_of(skeleton)
    limbs = [f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "shoulder", "elbow")]
    assert {"pelvis", "waist", *limbs} <= set(parts)
    for side in ("left", "right"):
        for upper, lower in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow")):
            assert parts[f"{side}_{upper}"] in skeleton.above(parts[f"{side}_{lower}"])
    assert len(set(parts.values())) == len(parts)


def test_joints_without_known_names_cannot_be_renamed() -> None:
    chain = Skeleton(("a", "b"), (-1, 0), torch.zeros(2, 3).double(), {})
    with pytest.raises(HopdiffError, match="names=mixamo: no part"):
        renamed(chain, "mixamo")


def test_two_joints_of_one_name_are_refused() -> None:
    skeleton = full_body(own()).clip.skeleton
    names = tuple("mixamorig:Hips" if name == "left_toe" else name for name in skeleton.names)
    with pytest.raises(HopdiffError, match="would be called 'mixamorig:Hips'"):
        renamed(replace(skeleton, names=names, end_sites={}), "mixamo")
