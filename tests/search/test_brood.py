"""Individuals, those that descend, and what either way of progress pays."""

import math

import pytest
import torch

from hopdiff.search.box import Box
from hopdiff.search.brood import MOST, Brood, Pay, Settled, gain_of, share_of, spread
from tests.search import problems

INF = math.inf


def brood_of(costs, merits):
    """One individual a pair, its gene its number."""
    empty = Brood.empty(Box.of(problems.sphere(1)))
    genes = torch.arange(len(costs), dtype=torch.float64)[:, None]
    cost, merit = (torch.tensor(values, dtype=torch.float64) for values in (costs, merits))
    return empty.joined(genes, cost, merit, int(cost.isfinite().sum()))


def who(genes):
    return genes[:, 0].int().tolist()


def test_possible_individuals_come_first_and_they_alone_breed():
    brood = brood_of([INF, 3.0, INF, 1.0], [0.1, 3.0, INF, 1.5])
    assert who(brood.genes) == [3, 1, 0, 2]
    assert brood.possible == 2
    assert who(brood.parents()) == [3, 1]
    assert who(brood.best(3).genes) == [3, 1, 0]
    assert brood.best(1).possible == 1


def test_impossible_individuals_breed_where_there_are_no_two_others():
    brood = brood_of([INF, 3.0, INF], [0.1, 3.0, 0.2])
    assert who(brood.parents()) == [1, 0, 2]


def test_individuals_taken_out_leave_the_others_in_order():
    brood = brood_of([4.0, 3.0, INF, 1.0], [4.0, 3.0, 2.0, 1.0])
    assert who(brood.without([0, 3]).genes) == [1, 0]
    assert brood.without([0, 3]).possible == 2
    assert brood.taken([3, 1]).possible == 1
    assert who(brood.taken([3, 1]).genes) == [2, 1]


def test_who_comes_to_where_one_has_ended_must_be_better_to_go_on():
    ends = torch.tensor([[0.2, 0.2], [0.8, 0.8]], dtype=torch.float64)
    settled = Settled(ends, torch.tensor([-10.0, INF], dtype=torch.float64))
    x = torch.tensor([[0.25, 0.2], [0.25, 0.2], [0.25, 0.2], [0.4, 0.2], [0.8, 0.8]], dtype=torch.float64)
    merit = torch.tensor([-9.0, -10.5, -12.0, 5.0, 5.0], dtype=torch.float64)
    assert settled.meet(x, merit, 0.1, 0.1).tolist() == [True, True, False, False, False]
    assert Settled(ends[:0], ends[:0, 0]).meet(x, merit, 0.1, 0.1).tolist() == [False] * 5


def test_generations_get_the_share_that_they_have_earned():
    good, bad, none = Pay(10.0, 1.0), Pay(10.0, 0.25), Pay()
    assert share_of(bad, good, 0.05) == pytest.approx(0.2)
    assert share_of(none, good, 0.05) == 0.05
    assert share_of(none, none, 0.05) == 0.05
    assert share_of(good, bad, 0.05) == MOST


def test_what_was_paid_long_ago_fades():
    pay = Pay().after(10.0, 1.0)
    rates = [pay.rate]
    for _ in range(20):
        pay = pay.after(10.0, 0.0)
        rates.append(pay.rate)
    assert rates[0] == pytest.approx(0.1)
    assert rates == sorted(rates, reverse=True)
    assert 0 < rates[-1] < 1e-3


@pytest.mark.parametrize(
    ("before", "after", "gain"),
    [
        (INF, 5.0, 1.0),
        (5.0, INF, 0.0),
        (5.0, 5.0, 0.0),
        (5.0, 4.0, 0.25),
        (5.0, 1.0, 1.0),
        (1.0, 0.0, 1.0),
        (-4, -5, 0.2),
    ],
)
def test_a_gain_is_a_share_of_what_is_left(before, after, gain):
    assert gain_of(before, after) == pytest.approx(gain)


def test_spread_picks_the_first_of_each_neighbourhood():
    genes = torch.tensor([[0.1, 0.1], [0.11, 0.1], [0.5, 0.5], [0.9, 0.9], [0.52, 0.5]], dtype=torch.float64)

    def chosen(others, count, apart):
        distance = torch.cdist(genes, torch.cat((genes, others)))
        return spread(distance.tolist(), count, apart * 2**0.5)

    nobody = genes[:0]
    assert chosen(nobody, 3, 0.05) == [0, 2, 3]
    assert chosen(nobody, 2, 0.05) == [0, 2]
    assert chosen(genes[3:4] + 0.01, 5, 0.05) == [0, 2]
    assert chosen(nobody, 5, 0.0) == [0, 1, 2, 3, 4]
    assert spread([], 5, 0.1) == []
