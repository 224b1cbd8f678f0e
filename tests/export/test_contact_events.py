from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import torch

from hopdiff.export.anatomy import parts_of
from hopdiff.export.contact_events import contact_events, root_motion
from hopdiff.export.full_body import full_body
from hopdiff.export.ground import ground_path
from hopdiff.export.one_stride import one_stride
from hopdiff.export.pose import mirrored
from hopdiff.export.prepare import in_place, in_place_if, with_clip
from hopdiff.export.retarget import retargeted, target_of
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.write import write_exports
from tests.builders import make_problem, valid_genes
from tests.export.gltf import Gltf
from tests.export.takes import own, walked
from tests.export.test_write import preset


def at(fps: float) -> Take:
    """The run of `own` at other frames."""
    problem = make_problem("speed=3", "beta=0.2")
    return Take.of_motion("run", problem.motion(valid_genes(problem, 1, seed=2)[0], fps), {"pelvis": 75.0}, {})


def test_a_stride_has_four_contacts_in_their_order() -> None:
    events = contact_events(own())
    assert [event.name for event in events] == ["LeftDown", "LeftUp", "RightDown", "RightUp"]
    assert [event.phase for event in events] == sorted(event.phase or 0.0 for event in events)
    assert (events[0].time, events[0].phase) == (0.0, pytest.approx(0.0))
    # A run without a limp: the right foot does half a stride later what the left one does.
    assert events[2].phase == pytest.approx(0.5, abs=0.01)
    assert (events[3].phase or 0.0) - (events[1].phase or 0.0) == pytest.approx(0.5, abs=0.01)


def test_times_lie_between_frames_where_forces_are_known() -> None:
    """Against the same run at a thousand frames a second."""
    fine = {event.name: event.time for event in contact_events(replace(at(1000.0), leg_force=None))}
    for fps, force, bound in ((60.0, True, 0.3), (30.0, True, 0.3), (60.0, False, 1.0)):
        take = at(fps) if force else replace(at(fps), leg_force=None)
        for event in contact_events(take):
            assert abs(event.time - fine[event.name]) < bound * take.clip.frame_time + 1e-3, (fps, force, event)


def test_a_contact_is_where_the_foot_stands_and_its_foot_does_not_move_until_it_leaves() -> None:
    take = own()
    assert take.feet is not None
    events = contact_events(take)
    for side, (down, up) in enumerate((events[:2], events[2:])):
        assert down.position is not None
        assert up.position is not None
        assert down.position == pytest.approx(up.position, abs=0.01)
        frame = round(down.time / take.clip.frame_time + 0.5)
        assert take.feet[frame, side].tolist() == pytest.approx(down.position, abs=0.01)


def test_cycles_have_the_contacts_of_each_one_and_none_twice() -> None:
    once, thrice = contact_events(own()), contact_events(own().repeated(3))
    assert len(thrice) == 3 * len(once)
    for k, event in enumerate(thrice):
        alike = once[k % len(once)]
        assert (event.name, event.phase) == (alike.name, pytest.approx(alike.phase))
        assert event.time == pytest.approx(alike.time + k // len(once) * own().clip.duration)


def test_a_walk_that_was_captured_has_alternating_contacts() -> None:
    take = walked()
    events = contact_events(take)
    assert len(events) > 6
    for foot in ("left", "right"):
        own_events = [event for event in events if event.foot == foot]
        assert all(a.down != b.down for a, b in pairwise(own_events))
    assert all(0.0 <= event.time <= take.clip.duration for event in events)
    landings = [event.phase for event in events if event.name == "LeftDown"]
    assert landings == pytest.approx([0.0] * len(landings), abs=1e-6)
    assert contact_events(Take("still", take.clip, False)) == []


OTHER_FRAMES = ({"fps": 30.0}, {"fps": 30.0, "cycles": 4}, {"fps": 60.0, "frames": "exact", "cycles": 4})


@pytest.mark.parametrize("root", ["travelling", "in_place"])
@pytest.mark.parametrize("asked", OTHER_FRAMES)
def test_events_do_not_hang_on_the_frames_that_are_asked_for(asked: dict[str, Any], root: str) -> None:
    """Against those of one stride at the frames that the run was made of."""
    take = replace(own(), numbers={"stride_time": own().clip.duration})
    settings = ExportSettings("events", root=root, **asked)
    once, travel = contact_events(take), 3.0 * take.clip.duration
    here = contact_events(in_place(with_clip(take, ExportSettings("events"))))
    found = contact_events(in_place_if(with_clip(take, settings), settings))
    assert len(found) == settings.cycles * len(once)
    start = ground_path(take).place[0, 1]
    for k, event in enumerate(found):
        alike, cycle = once[k % len(once)], k // len(once)
        assert (event.name, event.phase) == (alike.name, pytest.approx(alike.phase, abs=1e-6))
        assert event.time == pytest.approx(alike.time + cycle * take.clip.duration, abs=1e-6)
        assert event.position is not None
        assert alike.position is not None
        x, y, z = alike.position
        if root == "travelling":
            assert event.position == pytest.approx((x, y, z + cycle * travel), abs=1e-3)
            continue
        assert event.position == pytest.approx(here[k % len(once)].position, abs=4e-3)
        # The world goes by below the body at its speed.
        assert event.position[2] == pytest.approx(z - float(start) - 3.0 * alike.time, abs=1e-2)


def test_another_body_has_the_times_of_the_run_and_places_of_its_own_feet() -> None:
    take = own()
    body = full_body(take).clip.skeleton
    small = replace(
        body, offsets=0.5 * body.offsets, end_sites={name: 0.5 * end for name, end in body.end_sites.items()}
    )
    settings = ExportSettings("events", fps=30.0)
    moved = retargeted(with_clip(take, settings), target_of("small", small, parts_of(small)))
    assert moved.feet is not None
    once, found = contact_events(take), contact_events(moved)
    assert [(event.name, event.time) for event in found] == [
        (event.name, pytest.approx(event.time, abs=1e-6)) for event in once
    ]
    for event, alike in zip(found, once, strict=True):
        assert event.position is not None
        assert alike.position is not None
        side = ("left", "right").index(event.foot)
        gone = (moved.feet[:, side] - moved.feet.new_tensor(event.position)).norm(dim=-1)
        at = event.time / moved.clip.frame_time
        assert abs(int(gone.argmin()) - at) <= 1.0
        assert float(gone.min()) < 1e-6
        # Half as long legs, half as far; where a foot stands on its ball it is ahead of where it comes down.
        assert event.position[2] == pytest.approx(0.5 * alike.position[2], abs=0.15)
    twice = contact_events(moved.repeated(2))
    assert [event.time for event in twice[len(once) :]] == pytest.approx(
        [event.time + take.clip.duration for event in once], abs=1e-6
    )


def test_events_go_where_the_time_of_a_take_goes() -> None:
    """Carried ones are those that are found anew at the frames of the run."""
    take = with_clip(own(), ExportSettings("events"))
    for carried, anew in (
        (take.repeated(3), own().repeated(3)),
        (mirrored(take), mirrored(own())),
        (one_stride(take, 40), one_stride(own(), 40)),
        (take.at(torch.arange(9).double(), 0.02), own().at(torch.arange(9).double(), 0.02)),
    ):
        found, expected = contact_events(carried), contact_events(anew)
        assert [event.name for event in found] == [event.name for event in expected]
        for event, alike in zip(found, expected, strict=True):
            assert (event.time, event.phase) == (pytest.approx(alike.time), pytest.approx(alike.phase))
            assert event.position == pytest.approx(alike.position, abs=1e-9)


def test_root_motion_is_the_way_also_of_what_runs_on_the_spot() -> None:
    take = full_body(own())
    for found in (root_motion(take), root_motion(in_place(take)), root_motion(in_place(take).repeated(2))):
        assert float(found.speed.mean()) == pytest.approx(3.0, rel=0.01)
        assert float(found.yaw.abs().max()) < 1e-3
        assert bool((found.distance.diff() > 0.0).all())
        torch.testing.assert_close(found.place[:, 1], found.distance, atol=1e-2, rtol=0)
    assert float(root_motion(in_place(take).repeated(2)).distance[-1]) == pytest.approx(
        6.0 * take.clip.duration, rel=0.01
    )


def test_files_hold_them(tmp_path: Path) -> None:
    exports = {name: preset(name, "root=in_place", "cycles=2", "clip=Run") for name in ("glb", "events")}
    glb, beside = (path for path, _ in write_exports([own()], exports, tmp_path))
    [clip] = json.loads(beside.read_text())["clips"]
    assert beside.name == "motion_events.json"
    assert (clip["name"], clip["keys"], clip["loop"]) == ("Run", 2 * (own().frames - 1) + 1, True)
    assert [event["name"] for event in clip["events"]] == 2 * ["LeftDown", "LeftUp", "RightDown", "RightUp"]
    assert [event["event"] for event in clip["events"]] == 4 * ["touchdown", "takeoff"]
    assert {len(curve) for curve in clip["root_motion"].values()} == {clip["keys"]}
    assert clip["root_motion"]["distance"][-1] == pytest.approx(3.0 * clip["duration"], rel=0.01)
    extras = Gltf.of(glb.read_bytes()).animation("Run")["extras"]
    assert (extras["events"], extras["root_motion"]) == (clip["events"], clip["root_motion"])


@pytest.mark.parametrize("name", ["LeftDown", "LeftUp", "RightDown", "RightUp"])
@pytest.mark.parametrize("force", [True, False])
def test_what_falls_on_the_seam_of_a_loop_is_where_the_loop_begins(name: str, force: bool) -> None:
    """The run of `own` begun anew at each of its contacts: the first one is where it was in the whole run."""
    whole = own() if force else replace(own(), leg_force=None)
    event = next(event for event in contact_events(whole) if event.name == name)
    twice, step = whole.repeated(2), whole.clip.frame_time
    cut = twice.at(event.time / step + torch.arange(whole.frames, dtype=torch.float64), step)
    assert cut.contact is not None
    # Touchdowns belong to the contact, take-offs do not.
    contact = cut.contact.clone()
    contact[[0, -1], ("left", "right").index(event.foot)] = event.down
    cut = replace(cut, contact=contact, leg_force=None)
    [found] = [one for one in contact_events(cut) if one.name == name]
    assert event.position is not None
    assert (found.time, found.position) == (0.0, pytest.approx(event.position, abs=0.15))
