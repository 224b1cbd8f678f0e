"""Contacts between which a foot has no time to get from one to the next."""

from __future__ import annotations

import math

import torch

from hopdiff.feet.prints import QUICK, SPIN, FootPrint, GroundMove, unhurried

FRAME = 1.0 / 30.0
COUNT = 90


def still(turn: float = 0.0, x: float = 0.0) -> GroundMove:
    return GroundMove(torch.tensor(turn, dtype=torch.float64), torch.tensor([x, 0.0], dtype=torch.float64))


def shortened(prints: list[FootPrint], others: torch.Tensor) -> list[tuple[int, int]]:
    """First and last frames of prints of a foot that itself stays at the origin."""
    edit = GroundMove(torch.zeros(COUNT, dtype=torch.float64), torch.zeros(COUNT, 2, dtype=torch.float64))
    foot = torch.zeros(COUNT, 3, dtype=torch.float64)
    return [(one.first, one.last) for one in unhurried(edit, prints, foot, others, FRAME)]


def test_contacts_with_time_between_them_stay() -> None:
    prints = [FootPrint(0, 30, still(), True), FootPrint(50, 89, still(x=0.3), True)]
    assert shortened(prints, torch.ones(COUNT, dtype=torch.bool)) == [(0, 30), (50, 89)]


def test_a_foot_leaves_sooner_and_lands_later_where_it_has_far_to_go_or_to_turn() -> None:
    for move, need in ((still(x=0.6), 0.6 / QUICK), (still(turn=math.pi), math.pi / SPIN)):
        prints = [FootPrint(0, 40, still(), True), FootPrint(43, 89, move, True)]
        (_, last), (first, _) = shortened(prints, torch.ones(COUNT, dtype=torch.bool))
        assert first - last == math.ceil(need / FRAME)
        assert last < 40
        assert first > 43


def test_it_does_so_only_while_another_foot_stands() -> None:
    prints = [FootPrint(0, 40, still(), True), FootPrint(43, 89, still(x=0.9), True)]
    others = torch.zeros(COUNT, dtype=torch.bool)
    assert shortened(prints, others) == [(0, 40), (43, 89)]
    others[43:60] = True
    (_, last), (first, _) = shortened(prints, others)
    assert last == 40
    assert 60 >= first > 43


def test_a_foot_in_the_air_at_the_end_has_time_to_get_there() -> None:
    edit = GroundMove(torch.zeros(COUNT, dtype=torch.float64), torch.zeros(COUNT, 2, dtype=torch.float64))
    prints = [FootPrint(20, 84, still(x=0.5), False)]
    foot = torch.zeros(COUNT, 3, dtype=torch.float64)
    (one,) = unhurried(edit, prints, foot, torch.ones(COUNT, dtype=torch.bool), FRAME)
    assert COUNT - 1 - one.last == math.ceil(0.5 / QUICK / FRAME)
    # From the first frame on too.
    (one,) = unhurried(edit, [FootPrint(5, 60, still(x=0.5), False)], foot, torch.ones(COUNT, dtype=torch.bool), FRAME)
    assert one.first == math.ceil(0.5 / QUICK / FRAME)
