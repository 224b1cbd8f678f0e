from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from hopdiff.export.contact_events import contact_events, root_motion
from hopdiff.export.full_body import full_body
from hopdiff.export.prepare import in_place
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
