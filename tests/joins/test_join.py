"""Three clips as one: what belongs to them stays, seams are smooth, feet that stand through a seam stay put."""

from __future__ import annotations

import pytest
import torch

from hopdiff.editing.leg_joints import find_legs
from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import find_contacts
from hopdiff.geometry.clip import Clip
from hopdiff.joins.join import Joined, joined
from hopdiff.joins.measure import rates, seam_numbers
from hopdiff.joins.seams import Seam, placed, seams
from tests.joins.neighbours import laid, lie, rise, walk


def put_together(source: Clip, before: Clip | None, after: Clip | None) -> Joined:
    """The walk cut, its path edited to its neighbours, and all put together."""
    legs = find_legs(source.skeleton)
    begin, end = seams(source, before, after)
    if begin is None and end is not None:
        source = placed(source, end.move)
        begin, end = seams(source, before, after)
    first, last = 0 if begin is None else begin.frame, source.frames - 1 if end is None else end.frame
    part = source.part(slice(first, last + 1))
    path = root_path(part)

    def bound(seam: Seam, frame: int) -> Constraint:
        there = root_path(placed(source, seam.move))
        x, z = there.place[seam.frame].tolist()
        return Constraint(frame, (x, z), float(there.yaw[seam.frame]))

    ends = [bound(one, one.frame - first) for one in (begin, end) if one is not None]
    moved = with_root_path(part, path, edit_path(path, ends, part.frame_time).path)
    return joined(part, moved, before, after, legs, find_contacts(part, legs))


@pytest.fixture
def neighbours() -> tuple[Clip, Clip]:
    return laid(rise(), 50.0, 1.0, 2.0), laid(lie(), 80.0, 4.8, 4.2)


@pytest.mark.parametrize("which", ["both", "before", "after"])
def test_clips_beside_a_walk_stay_as_they_are_and_seams_are_smooth(which: str, neighbours: tuple[Clip, Clip]) -> None:
    before = None if which == "after" else neighbours[0]
    after = None if which == "before" else neighbours[1]
    source = walk()
    whole = put_together(source, before, after)
    planted = whole.planted()
    assert planted is not None
    made = planted.clip
    for clip, here in ((before, slice(0, whole.head + 1)), (after, slice(whole.tail, None))):
        if clip is not None:
            assert torch.equal(made.root_position[here], clip.root_position)
            assert torch.equal(made.rotations[here], clip.rotations)
    clips = [source, *(one for one in (before, after) if one is not None)]
    numbers, said = seam_numbers(made, whole, clips, before, after)
    assert said == []
    assert numbers["seam_pose_error"] == 0.0
    ratio = numbers["seam_acceleration_ratio"]
    assert isinstance(ratio, float)
    assert 0.0 < ratio < 1.2
    assert numbers["seam_frames"] == [
        frame for frame, clip in ((whole.head, before), (whole.tail, after)) if clip is not None
    ]


def test_a_foot_that_stands_in_both_clips_stays_where_it_was(neighbours: tuple[Clip, Clip]) -> None:
    whole = put_together(walk(), *neighbours)
    planted = whole.planted()
    assert planted is not None
    assert whole.contacts is not None
    through = 0
    for frame, step in ((whole.head, 1), (whole.tail, -1)):
        for k, leg in enumerate(whole.contacts.legs):
            here = frame
            while bool(planted.touching[here, k]):
                here += step
            if abs(here - frame) < 2:
                continue
            through += 1
            joints = [joint for joint in (leg.ankle, leg.toe) if joint is not None]
            # Heels come up while a foot stands, or toes: one of them stays.
            still, loose = (
                one.joint_positions()[min(frame, here + 1) : max(frame + 1, here)][:, joints, ::2]
                for one in (planted.clip, whole.clip)
            )
            spread, slid = (float((one - one[:1]).norm(dim=-1).amax(0).min()) for one in (still, loose))
            assert spread < max(0.02, 0.5 * slid)
    assert through


def test_the_source_is_the_same_motion_on_the_way_that_it_had(neighbours: tuple[Clip, Clip]) -> None:
    source = walk()
    whole = put_together(source, *neighbours)
    seen = []
    for clip in (whole.clip, whole.source):
        places = clip.joint_positions() - clip.root_position[:, None]
        seen.append(places.norm(dim=-1))
    assert (seen[0] - seen[1]).abs().max() < 1e-9
    middle = slice(whole.head + 45, whole.tail - 45)
    steps = [one.joint_positions()[middle].diff(dim=0).norm(dim=-1).max() for one in (whole.source, source)]
    assert steps[0] <= steps[1] + 1e-9


def test_a_jump_at_a_seam_is_told(neighbours: tuple[Clip, Clip]) -> None:
    source, (before, after) = walk(), neighbours
    whole = put_together(source, before, after)
    root = whole.clip.root_position.clone()
    root[whole.head + 1 :, 0] += 0.3
    jumped = Clip(whole.clip.skeleton, root, whole.clip.rotations, whole.clip.frame_time)
    numbers, said = seam_numbers(jumped, whole, [source, before, after], before, after)
    assert len(said) == 3
    assert "times as fast" in said[0]
    assert "jerked" in said[1]
    assert "300.00 mm from where they were" in said[2]
    assert isinstance(numbers["seam_pose_error"], float)
    assert numbers["seam_pose_error"] == pytest.approx(0.3)


def test_rates_are_differences_of_neighbouring_frames() -> None:
    places = torch.zeros(5, 2, 3, dtype=torch.float64)
    places[:, 1, 0] = torch.tensor([0.0, 1.0, 4.0, 9.0, 16.0], dtype=torch.float64)
    assert rates(places, 1)[:, 1].tolist() == [1.0, 3.0, 5.0, 7.0]
    assert rates(places, 2)[:, 1].tolist() == [2.0, 2.0, 2.0]
