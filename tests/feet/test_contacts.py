"""When feet stand: a stiff body that is carried along by hand, so that its feet do what its root does."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from hopdiff.editing.leg_joints import find_legs
from hopdiff.feet.contacts import FLOOR, Contacts, contact_points, find_contacts, leg_length, slide_numbers
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton

FRAME = 0.01  # s
LOW = 0.04 * 0.81 / 0.9  # m, up to which a point of these legs may stand: 36 mm
RISE = 17  # frames of 2 mm that stay below it


def body(ankles: bool = True) -> Skeleton:
    """Legs of 81 cm, with ankles and toes or with end sites below the knees."""
    leg = [[0.1, 0.0, 0.0], [0.0, -0.4, 0.0], *([[0.0, -0.41, 0.0], [0.0, -0.05, 0.15]] if ankles else [])]
    count = len(leg)
    offsets = torch.tensor([[0.0, 0.0, 0.0], *leg, [-0.1, 0.0, 0.0], *leg[1:]], dtype=torch.float64)
    parents = (-1, 0, *range(1, count), 0, *range(count + 1, 2 * count))
    parts = ("hip", "knee", "ankle", "toe")[:count]
    names = ("root", *(f"{side}_{part}" for side in ("left", "right") for part in parts))
    down = torch.tensor([0.0, -0.41, 0.0], dtype=torch.float64)
    ends = {} if ankles else {"left_knee": down, "right_knee": down}
    return Skeleton(names, parents, offsets, end_sites=ends)


def carried(place: Tensor, ankles: bool = True) -> Clip:
    """A clip whose root is at (T, 3), nothing turned."""
    skeleton = body(ankles)
    straight = torch.eye(3, dtype=torch.float64).expand(len(place), len(skeleton.names), 3, 3)
    return Clip(skeleton, place, straight, FRAME)


def raised(height: list[float]) -> Clip:
    place = torch.zeros(len(height), 3, dtype=torch.float64)
    place[:, 1] = torch.tensor(height, dtype=torch.float64)
    return carried(place)


def contacts_of(clip: Clip) -> Contacts:
    return find_contacts(clip, find_legs(clip.skeleton))


def bump(frames: int, peak: int) -> list[float]:
    """Up by 2 mm a frame, too slow to count as moving, to `peak` frames above the height of contacts, and down."""
    half = [0.002 * k for k in range(1, RISE + 1)]
    top = [LOW + 1e-4] * peak
    return [*half, *top, *half[::-1], *([0.0] * frames)]


def standing(height: list[float]) -> list[tuple[int, int]]:
    return contacts_of(raised(height)).plants(0)


def test_points_are_ankle_and_toe_or_the_end_of_the_shank() -> None:
    place = torch.tensor([[1.0, 2.0, 3.0]], dtype=torch.float64).expand(4, 3)
    with_feet, without = carried(place), carried(place, ankles=False)
    assert contacts_of(with_feet).names == ("left heel", "left toe", "right heel", "right toe")
    points = contact_points(with_feet, contacts_of(with_feet))
    wanted = torch.tensor([[1.1, 1.19, 3.0], [1.1, 1.14, 3.15], [0.9, 1.19, 3.0], [0.9, 1.14, 3.15]])
    torch.testing.assert_close(points[2], wanted.double(), rtol=0.0, atol=1e-6)
    assert contacts_of(without).names == ("left foot", "right foot")
    torch.testing.assert_close(contact_points(without, contacts_of(without))[0], points[0, [0, 2]])
    for clip in (with_feet, without):
        assert leg_length(clip, find_legs(clip.skeleton)[1]) == pytest.approx(0.81)


def test_a_foot_stands_where_it_is_low_for_its_leg() -> None:
    height = [*([0.0] * 30), *bump(30, 20)]
    # 20 frames, .2 s, are too high.
    assert standing(height) == [(0, 29 + RISE), (30 + RISE + 20, len(height) - 1)]


@pytest.mark.parametrize(("frames", "filled"), [(4, True), (5, False)])
def test_a_contact_may_be_interrupted_for_less_than_50_ms(frames: int, filled: bool) -> None:
    height = [*([0.0] * 20), *bump(20, frames)]
    assert len(standing(height)) == (1 if filled else 2)


@pytest.mark.parametrize(("frames", "kept"), [(7, False), (8, True)])
def test_a_contact_lasts_at_least_80_ms(frames: int, kept: bool) -> None:
    top = [LOW + 1e-4] * 10
    low = [LOW - 1e-4] * frames
    rise, fall = bump(0, 1)[:RISE], bump(0, 1)[-RISE:]
    height = [*([0.0] * 20), *rise, *top, *low, *top, *fall, *([0.0] * 20)]
    assert len(standing(height)) == (3 if kept else 2)


def test_what_the_clip_cuts_off_may_be_shorter() -> None:
    beginning = [*([LOW - 1e-4] * 3), *([LOW + 1e-4] * 10), *bump(0, 1)[-RISE:], *([0.0] * 60)]
    assert standing(beginning)[0] == (0, 2)
    assert standing(beginning[::-1])[-1] == (len(beginning) - 3, len(beginning) - 1)


@pytest.mark.parametrize(("speed", "stands"), [(0.34, True), (0.36, False)])
def test_a_foot_that_moves_does_not_stand(speed: float, stands: bool) -> None:
    """In a clip of one who does not get far: back and forth, so that the body's own speed allows no more."""
    time = FRAME * torch.arange(200, dtype=torch.float64)
    place = torch.zeros(200, 3, dtype=torch.float64)
    place[:, 2] = speed * time
    contacts = contacts_of(carried(place))
    assert bool(contacts.touching.all()) == stands
    assert bool(contacts.touching.any()) == stands


def test_feet_of_a_fast_runner_may_move_by_a_share_of_its_speed() -> None:
    """Mean speed 4.5 m/s: 15 % are .675 m/s, for a foot that slows down to 0.6 m/s for 20 frames and to 0.7 for 20."""
    pace = torch.full((1000,), 4.7, dtype=torch.float64)
    pace[300:320], pace[600:620] = 0.6, 0.7
    pace *= (4.5 * 1000 - 26.0) / (pace.sum() - 26.0)
    pace[300:320], pace[600:620] = 0.6, 0.7
    place = torch.zeros(1001, 3, dtype=torch.float64)
    place[1:, 0] = FRAME * pace.cumsum(0)
    plants = contacts_of(carried(place)).plants(1)
    assert len(plants) == 1
    first, last = plants[0]
    # Speeds are measured over a thirtieth of a second, two frames to either side.
    assert (first, last) == (302, 318)


def test_slides_are_measured_along_the_ground_while_a_point_stands() -> None:
    time = FRAME * torch.arange(101, dtype=torch.float64)
    place = torch.stack((0.12 * time, 0.001 * torch.sin(20.0 * time), 0.16 * time), dim=-1)
    clip = carried(place)
    contacts = contacts_of(clip)
    assert bool(contacts.touching.all())
    floor = torch.quantile(contact_points(clip, contacts)[..., 1], FLOOR, dim=0)
    torch.testing.assert_close(contacts.floor, floor)
    found = slide_numbers(clip, contacts)
    assert found["slide_speed"] == pytest.approx(0.2)
    assert found["drift"] == pytest.approx(0.2)
    assert found["contact_share"] == 1.0
    assert found["foot_depth"] == pytest.approx(float((floor - contact_points(clip, contacts)[..., 1]).max()))
    lower = place - torch.tensor([0.0, 0.02, 0.0], dtype=torch.float64)
    assert slide_numbers(carried(lower), contacts)["foot_depth"] == pytest.approx(found["foot_depth"] + 0.02)
    higher = place + torch.tensor([0.0, 0.02, 0.0], dtype=torch.float64)
    assert slide_numbers(carried(higher), contacts)["foot_depth"] == 0.0


def test_only_standing_points_slide() -> None:
    place = torch.zeros(41, 3, dtype=torch.float64)
    place[20:, 2] = 0.3 * FRAME * torch.arange(21, dtype=torch.float64)
    clip = carried(place)
    whole = contacts_of(clip)
    touching = torch.zeros_like(whole.touching)
    touching[:11, 0] = touching[30:41, 3] = True
    found = slide_numbers(clip, Contacts(whole.legs, whole.points, whole.names, touching, whole.floor, whole.level))
    # 10 steps of the left heel stand still, 10 of the right toe go at .3 m/s.
    assert found["slide_speed"] == pytest.approx(0.15)
    assert found["drift"] == pytest.approx(0.03)
    assert found["contact_share"] == pytest.approx(22 / 41)
    nothing = Contacts(whole.legs, whole.points, whole.names, torch.zeros_like(touching), whole.floor, whole.level)
    assert slide_numbers(clip, nothing)["slide_speed"] == slide_numbers(clip, nothing)["drift"] == 0.0
