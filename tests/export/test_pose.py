from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from hopdiff.export.full_body import full_body
from hopdiff.export.pose import mirrored, with_rest_pose
from hopdiff.export.take import Take
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rigs import without
from tests.export.takes import WALKS, own, walked

HEIGHTS = {"t": 0.0, "a": -(0.5**0.5), "straight": -1.0}  # of a bone of length 1 that points along the arm


@pytest.mark.parametrize("pose", HEIGHTS)
@pytest.mark.parametrize("body", ["own", "full", "moving", *WALKS])
def test_joints_stay_where_they_are_in_every_rest_pose(body: str, pose: str) -> None:
    ours = {"own": own, "full": lambda: full_body(own()), "moving": stretched}
    take = ours.get(body, lambda: walked(body))()
    posed = with_rest_pose(take, pose)
    torch.testing.assert_close(posed.clip.joint_positions(), take.clip.joint_positions(), atol=1e-9, rtol=0)
    ends, before = posed.clip.end_positions(), take.clip.end_positions()
    for name in before:
        torch.testing.assert_close(ends[name], before[name], atol=1e-9, rtol=0)


def stretched() -> Take:
    """Bones that grow and shrink."""
    take = full_body(own())
    swing = 1.0 + 0.05 * torch.sin(torch.arange(take.frames).double())[:, None, None]
    return replace(take, clip=replace(take.clip, offsets=swing * take.clip.skeleton.offsets))


@pytest.mark.parametrize("pose", HEIGHTS)
def test_arms_point_where_the_pose_says(pose: str) -> None:
    skeleton = with_rest_pose(full_body(own()), pose).clip.skeleton
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for joint in ("elbow", "wrist"):
            bone = skeleton.offsets[JOINTS.index(f"{side}_{joint}")]
            assert float(bone[1] / bone.norm()) == pytest.approx(HEIGHTS[pose], abs=1e-9)
            assert sign * float(bone[0]) >= -1e-9


def nameless(uneven: float = 1.0) -> Take:
    """uneven: by how much its left arm is longer than the right one."""
    take = full_body(own())
    skeleton = take.clip.skeleton
    offsets = skeleton.offsets.clone()
    offsets[JOINTS.index("left_elbow")] *= uneven
    names = tuple(f"j{k}" for k in range(22))
    return replace(
        take, clip=replace(take.clip, skeleton=replace(skeleton, names=names, offsets=offsets, end_sites={}))
    )


def test_arms_without_names_are_found_by_their_shape() -> None:
    posed = with_rest_pose(nameless(), "t").clip.skeleton
    known = with_rest_pose(full_body(own()), "t").clip.skeleton
    torch.testing.assert_close(posed.offsets, known.offsets)


def test_arms_that_cannot_be_told_are_told_so() -> None:
    with pytest.raises(HopdiffError, match="arms of this skeleton"):
        with_rest_pose(nameless(uneven=2.0), "t")


def test_a_body_without_arms_stays_as_it_is() -> None:
    take = full_body(own())
    skeleton = take.clip.skeleton
    body = without(skeleton, "left_collar", "right_collar")
    kept = [skeleton.index(name) for name in body.names]
    bare = replace(take, clip=replace(take.clip, skeleton=body, rotations=take.clip.rotations[:, kept]))
    assert torch.equal(with_rest_pose(bare, "t").clip.skeleton.offsets, body.offsets)


@pytest.mark.parametrize("whole", [False, True])
def test_the_mirror_image_is_one(whole: bool) -> None:
    take = full_body(own()) if whole else own()
    image = mirrored(take)
    names = take.clip.skeleton.names
    twin = [names.index(swapped(name)) for name in names]
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(
        image.clip.joint_positions(), take.clip.joint_positions()[:, twin] * flip, atol=1e-12, rtol=0
    )
    assert take.feet is not None
    assert image.feet is not None
    torch.testing.assert_close(image.feet, take.feet.flip(1) * flip)
    assert take.contact is not None
    assert image.contact is not None
    assert bool((image.contact == take.contact.flip(1)).all())
    torch.testing.assert_close(mirrored(image).clip.rotations, take.clip.rotations, atol=1e-12, rtol=0)


def test_uneven_bodies_have_no_mirror_image() -> None:
    take = own()
    skeleton = take.clip.skeleton
    offsets = skeleton.offsets.clone()
    offsets[skeleton.index("left_knee")] *= 1.3
    uneven: Take = replace(take, clip=replace(take.clip, skeleton=replace(skeleton, offsets=offsets)))
    with pytest.raises(HopdiffError, match=r"no mirror image, its bones at '\w+_knee'"):
        mirrored(uneven)


def swapped(name: str) -> str:
    if name.startswith("left_"):
        return name.replace("left_", "right_")
    return name.replace("right_", "left_")
