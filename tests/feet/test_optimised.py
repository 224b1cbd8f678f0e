"""Feet found over the whole clip at once: what they do in contacts, and that nothing costs less."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import sparse
from torch import Tensor

from hopdiff.editing.root_path import root_path, with_root_path
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import slide_numbers
from hopdiff.feet.optimised import EASE, Sliding, Stand, _Rows, _Unknowns, optimised_ways
from hopdiff.feet.planting import LOWEST, clean_feet
from hopdiff.feet.quality import BARS, quality_of
from hopdiff.feet.track import leg_tracks
from hopdiff.feet.way import FootWay
from hopdiff.geometry.clip import Clip
from tests.feet.test_footing import rising
from tests.feet.test_planting import CLIPS, TURNS, contacts_of, difference, edited, source

FRAME = 1.0 / 60.0


@pytest.mark.parametrize("name", CLIPS)
def test_without_an_edit_nothing_is_changed(name: str) -> None:
    clip = source(name)
    assert difference(clean_feet(clip, clip, contacts_of(clip), by="optimised").clip, clip) < 1e-6


@pytest.mark.parametrize(("where", "turn"), TURNS)
@pytest.mark.parametrize("name", ["own", "walk", "walk sideways", "walk_straight_cmu_16_15"])
def test_feet_stand_as_still_as_in_the_source_and_nothing_jerks(name: str, where: str, turn: float | None) -> None:
    clip = source(name)
    contacts = contacts_of(clip)
    planted = clean_feet(clip, edited(clip, where, turn), contacts, by="optimised")
    own, after = (slide_numbers(c, contacts) for c in (clip, planted.clip))
    assert after["slide_speed"] < own["slide_speed"] + 0.02
    assert after["drift"] < own["drift"] + 0.01
    numbers = quality_of(clip, planted, contacts).numbers
    assert {bar: value for bar, value in numbers.items() if value > BARS[bar]} == {}


def test_it_is_another_motion_than_that_of_contact_by_contact() -> None:
    """Both stand in the same prints, but the ways between them differ."""
    clip = source("walk")
    contacts = contacts_of(clip)
    moved = edited(clip, "aside", 90.0)
    fast, all_at_once = (clean_feet(clip, moved, contacts, by=by).clip for by in ("fast", "optimised"))
    assert difference(fast, all_at_once) > 0.01


def longer(clip: Clip, share: float) -> Clip:
    """On a way that is so much longer in the same time."""
    path = root_path(clip)
    far = path.place[0] + share * (path.place[-1] - path.place[0])
    bound = Constraint(clip.frames - 1, (float(far[0]), float(far[1])), keep=True)
    return with_root_path(clip, path, edit_path(path, [bound], clip.frame_time).path)


def test_legs_that_are_too_short_lower_the_root_and_only_where_they_are() -> None:
    clip = source("walk")
    contacts = contacts_of(clip)
    planted = clean_feet(clip, longer(clip, 1.3), contacts, by="optimised")
    assert 0.005 < float(planted.lowered.max()) <= LOWEST
    assert float(planted.lowered[0].abs()) == float(planted.lowered[-1].abs()) == 0.0
    assert float(clean_feet(clip, longer(clip, 1.7), contacts, by="optimised").lowered.max()) <= LOWEST
    unlowered = clean_feet(clip, longer(clip, 1.02), contacts, by="optimised")
    assert float(unlowered.lowered.max()) < 0.5 * float(planted.lowered.max())


def test_on_a_slope_feet_stand_on_it() -> None:
    clip = source("walk")
    contacts = contacts_of(clip)
    slope = rising(clip, "slope", angle=8.0, length=100.0)
    planted = clean_feet(clip, clip, contacts, slope, by="optimised")
    numbers = quality_of(clip, planted, contacts, slope).numbers
    assert numbers["foot_float"] < 0.01
    assert numbers["foot_sink"] < 0.01


def sliding(stands: list[Stand], count: int) -> Sliding:
    """A foot with a long enough leg, led along z at 1 m/s."""
    whole = source("walk")
    track = leg_tracks(whole.part(slice(0, count)), contacts_of(whole).legs)[0]
    ankle = torch.zeros(count, 3, dtype=torch.float64)
    ankle[:, 2] = FRAME * torch.arange(count)
    flags = torch.zeros(count, dtype=torch.bool)

    def way(ankle: Tensor, yaw: Tensor) -> FootWay:
        hip, frame = ankle.clone(), torch.eye(3, dtype=torch.float64).expand(count, 3, 3)
        return FootWay(track, hip, ankle, frame, flags, flags.double(), flags.double(), FRAME)

    return Sliding(ankle, torch.zeros(count, dtype=torch.float64), stands, way)


def stand(first: int, last: int, x: float, z: float, turn: float = 0.0, free: bool = False) -> Stand:
    count = last + 1 - first
    ankle = torch.tensor([[x, 0.0, z]], dtype=torch.float64).expand(count, 3)
    return Stand(slice(first, last + 1), ankle, torch.full((count,), turn, dtype=torch.float64), free)


def test_the_way_between_contacts_costs_least() -> None:
    """Where nothing else pulls, c^6 times the sixth difference of what is added is that itself: Euler's equation."""
    foot = sliding([stand(20, 40, 0.2, 0.5, turn=0.3), stand(70, 90, -0.1, 1.3)], 120)
    (way,), lowered = optimised_ways([foot], FRAME, LOWEST, (0, 119))
    assert float(lowered.abs().max()) < 1e-12
    added = way.ankle - foot.ankle
    torch.testing.assert_close(way.ankle[20:41], foot.stands[0].ankle, rtol=0.0, atol=1e-12)
    torch.testing.assert_close(way.ankle[70:91], foot.stands[1].ankle, rtol=0.0, atol=1e-12)
    assert float(added[[0, -1]].abs().max()) == 0.0
    for frames in (slice(1, 20), slice(41, 70), slice(91, 119)):
        at = torch.arange(120)[frames]
        at = at[(at >= 6) & (at < 114)]
        sixth = added.diff(n=6, dim=0)[at - 3]
        torch.testing.assert_close((EASE / FRAME) ** 6 * sixth, added[at], rtol=1e-5, atol=1e-6)


def test_a_contact_that_may_be_elsewhere_is_where_it_costs_least() -> None:
    """Beside the way that the foot is led by it has no reason to stay; a bound one stays."""
    free, bound = (
        optimised_ways([sliding([stand(40, 60, 0.2, 50 * FRAME, free=one)], 100)], FRAME, LOWEST, (0, 99))[0][0].ankle
        for one in (True, False)
    )
    assert float(bound[40:61, 0].min()) == pytest.approx(0.2)
    assert float(free[40:61, 0].abs().max()) < 1e-6
    assert float(free[40:61].diff(dim=0).abs().max()) < 1e-9


def test_frames_that_are_kept_stay_as_they_are_led() -> None:
    foot = sliding([stand(40, 60, 0.2, 50 * FRAME, turn=0.2)], 120)
    (way,), _ = optimised_ways([foot], FRAME, LOWEST, (25, 70))
    added = (way.ankle - foot.ankle).abs().amax(dim=-1)
    assert float(added[:26].max()) == float(added[70:].max()) == 0.0
    assert float(added[26:70].min()) > 0.0


def test_feet_turn_from_print_to_print() -> None:
    foot = sliding([stand(20, 40, 0.2, 0.5, turn=0.3), stand(70, 90, -0.1, 1.3)], 120)
    turns: list[Tensor] = []

    def way(ankle: Tensor, yaw: Tensor) -> FootWay:
        turns.append(yaw)
        return foot.way(ankle, yaw)

    optimised_ways([Sliding(foot.ankle, foot.turn, foot.stands, way)], FRAME, LOWEST, (0, 119))
    turn = turns[-1]
    assert float((turn[20:41] - 0.3).abs().max()) < 1e-12
    assert float(turn[70:91].abs().max()) < 1e-12
    assert float(turn[40:71].diff().max()) < 0.01


def test_limits_count_only_where_they_are_exceeded() -> None:
    """At the least the gradient vanishes, of a random problem and of one without limits."""
    generator = np.random.default_rng(0)
    for limits in (0, 30):
        unknowns = _Unknowns(np.ones(8, dtype=bool))
        unknowns.free(np.ones(8, dtype=bool))
        rows = _Rows(sparse.csr_matrix(generator.normal(size=(12, 8))), generator.normal(size=12))
        over = _Rows(sparse.csr_matrix(10.0 * generator.normal(size=(limits, 8))), generator.normal(size=limits))
        found = unknowns.least([rows], [over], np.zeros(8))
        gradient = rows.matrix.T @ rows.value(found) + over.matrix.T @ np.maximum(over.value(found), 0.0)
        assert np.abs(gradient).max() < 1e-9
        if limits:
            exceeded = over.value(found) > 0.0
            assert 0 < exceeded.sum() < limits


@pytest.mark.parametrize("frames", [3, 4, 6])
def test_the_shortest_clips_are_no_trouble(frames: int) -> None:
    clip = source("walk").part(slice(0, frames))
    contacts = contacts_of(clip)
    planted = clean_feet(clip, clip, contacts, by="optimised")
    assert difference(planted.clip, clip) < 1e-6
