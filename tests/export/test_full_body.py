from __future__ import annotations

import pytest
import torch

from hopdiff.export.full_body import full_body, is_model_body
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS, full_skeleton
from tests.builders import make_character
from tests.export.takes import own, walked


def test_the_model_stays_where_it_is_but_for_the_legs_that_reach_for_their_feet() -> None:
    take = own()
    whole = full_body(take)
    assert whole.clip.skeleton.names == JOINTS
    assert len(JOINTS) == 22
    kept = [JOINTS.index(name) for name in take.clip.skeleton.names]
    moved = (whole.clip.joint_positions()[:, kept] - take.clip.joint_positions()).norm(dim=-1).amax(dim=0)
    for name, most in zip(take.clip.skeleton.names, moved.tolist(), strict=True):
        assert most < (0.06 if "knee" in name else 1e-12), name


def test_balls_stay_where_they_stand_and_nothing_sinks() -> None:
    take = own()
    whole = full_body(take)
    places, frames = whole.clip.forward()
    ends = whole.clip.skeleton.end_positions(places, frames)
    assert take.contact is not None
    for k, side in enumerate(("left", "right")):
        ankle, toe = JOINTS.index(f"{side}_ankle"), JOINTS.index(f"{side}_toe")
        ball, stands = places[:, toe], take.contact[:, k]
        both = stands[1:] & stands[:-1]
        assert int(both.sum()) > 5
        assert float(ball.diff(dim=0)[both].norm(dim=-1).max()) < 1e-6
        assert float(ball[stands, 1].abs().max()) < 1e-6
        # The heel rises at the ends of the stance and nothing goes below the ground.
        assert float(frames[stands, ankle, 1, 1].min()) > 0.95
        assert float(ball[:, 1].min()) > -1e-6
        assert float(ends[f"{side}_toe"][:, 1].min()) > -1e-6
        # Toes lie on the ground while the foot stands.
        assert float(ends[f"{side}_toe"][stands, 1].max()) < 1e-6
        # In mid-swing toes hang: the foot is pitched.
        assert float(frames[:, ankle, 1, 1].min()) < 0.9


def test_legs_move_without_jumps_through_the_loop() -> None:
    take = own()
    whole = full_body(take)
    for side in ("left", "right"):
        for part in ("hip", "knee", "ankle"):
            turns = whole.clip.rotations[:, JOINTS.index(f"{side}_{part}")]
            torch.testing.assert_close(turns[-1], turns[0], atol=1e-7, rtol=0)
            speeds = torch.linalg.matrix_norm(torch.cat((turns, turns[1:2])).diff(dim=0))
            # The seam is as smooth as what is around it.
            assert float(speeds[-1] - speeds[0]) == pytest.approx(0.0, abs=1e-6)
            assert float(speeds.max()) < 0.8


@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_bodies_of_any_shape_get_the_joints(name: str) -> None:
    skeleton = make_character(name).skeleton
    whole = full_skeleton(skeleton)
    straight = torch.eye(3, dtype=torch.float64).expand(1, 22, 3, 3)
    places = whole.forward(torch.zeros(1, 3).double(), straight)[0][0]
    assert is_model_body(skeleton)
    assert not is_model_body(whole)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        toe, ankle = places[JOINTS.index(f"{side}_toe")], places[JOINTS.index(f"{side}_ankle")]
        assert float(toe[2] - ankle[2]) > 0.0
        assert float(toe[1]) < float(ankle[1])
        assert sign * float(places[JOINTS.index(f"{side}_collar"), 0]) > 0.0


def test_other_bodies_are_refused() -> None:
    with pytest.raises(HopdiffError, match="joints=full"):
        full_body(walked())
