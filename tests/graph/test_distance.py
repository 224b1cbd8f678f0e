from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import minimum_filter
from scipy.optimize import minimize_scalar

from hopdiff.geometry.clip import Clip
from hopdiff.graph import distance
from hopdiff.graph.distance import alignment, distances, local_minima, windows_of
from hopdiff.types import HopdiffError
from tests.graph.walkers import moved, walker, wanderer

WEIGHTS = [1.0, 0.0, 3.0, 0.5, 2.0, 1.0]


def brute_force(first: Clip, i: int, second: Clip, j: int, window: int, weights: list[float]) -> tuple[float, float]:
    """Least distance over all turns, and the turn, with the best shift for each."""
    a = first.joint_positions()[i : i + window].numpy()
    b = second.joint_positions()[j : j + window].numpy()
    share = np.broadcast_to(weights, a.shape[:2]) / (sum(weights) * window)

    def apart(turn: float) -> float:
        c, s = math.cos(turn), math.sin(turn)
        x, z = c * b[..., 0] + s * b[..., 2], c * b[..., 2] - s * b[..., 0]
        dx, dz, dy = a[..., 0] - x, a[..., 2] - z, a[..., 1] - b[..., 1]
        dx, dz = dx - (share * dx).sum(), dz - (share * dz).sum()
        return float((share * (dx**2 + dy**2 + dz**2)).sum())

    grid = np.linspace(-math.pi, math.pi, 181)
    best = grid[int(np.argmin([apart(turn) for turn in grid]))]
    found = minimize_scalar(apart, bounds=(best - 0.05, best + 0.05), method="bounded", options={"xatol": 1e-9})
    return math.sqrt(found.fun), float(found.x)


@pytest.mark.parametrize("weights", [None, WEIGHTS], ids=["equal", "weighted"])
def test_the_products_give_the_least_distance_over_all_turns_and_shifts(weights: list[float] | None) -> None:
    first, second = wanderer(), walker([(1.0, 40.0), (2.0, -80.0)], speed=0.9, period=1.1)
    a, b = windows_of(first, 10, weights), windows_of(second, 10, weights)
    table = distances(a, b)
    assert table.shape == (first.frames - 9, second.frames - 9)
    for i, j in [(0, 0), (17, 60), (200, 31), (first.frames - 10, second.frames - 10)]:
        wanted, turn = brute_force(first, i, second, j, 10, weights or [1.0] * 6)
        assert float(table[i, j]) == pytest.approx(wanted, abs=1e-7)
        found, _ = alignment(a, torch.tensor([i]), b, torch.tensor([j]))
        assert math.remainder(float(found) - turn, math.tau) == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("turn", [-3.0, -0.4, 0.0, 1.7])
def test_a_clip_that_was_moved_and_turned_is_not_apart_and_laid_back_on_itself(turn: float) -> None:
    clip = walker([(2.0, 30.0)])
    other = moved(clip, 3.0, -7.0, turn)
    a, b = windows_of(clip, 10), windows_of(other, 10)
    assert float(distances(a, b).diagonal().max()) < 1e-6
    rows = torch.arange(a.count)
    found, shift = alignment(a, rows, b, rows)
    here = torch.complex(other.root_position[:, 2], other.root_position[:, 0])[: a.count]
    back = torch.polar(torch.ones_like(found), found) * here + shift
    torch.testing.assert_close(back.real, clip.root_position[: a.count, 2])
    torch.testing.assert_close(back.imag, clip.root_position[: a.count, 0])
    assert math.remainder(float(found[0]) + turn, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("chunk", [distance.CHUNK, 40_000])
@pytest.mark.parametrize("same", [True, False])
def test_minima_found_block_by_block_are_those_of_the_whole_table(
    same: bool, chunk: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(distance, "CHUNK", chunk)
    a = windows_of(wanderer(), 10)
    b = a if same else windows_of(walker([(3.0, 45.0), (3.0, -20.0)], speed=1.0), 10)
    threshold = 0.05
    found = local_minima(a, b, threshold, apart=10)
    table = distances(a, b).numpy()
    least = (table <= minimum_filter(table, 3, mode="nearest")) & (table < threshold)
    if same:
        rows, columns = np.indices(table.shape)
        least &= columns - rows >= 10
    wanted = {tuple(pair) for pair in np.argwhere(least).tolist()}
    pairs = list(zip(found.first.tolist(), found.second.tolist(), strict=True))
    assert len(wanted) > 20
    # Equal neighbours count once; rounding may tell others apart.
    assert len(set(pairs)) == len(pairs)
    assert len(set(pairs) ^ wanted) <= 0.02 * len(wanted)
    np.testing.assert_allclose(found.distance.numpy(), table[found.first, found.second], atol=1e-9)


def test_a_body_that_stands_still_makes_few_minima_and_not_all_pairs() -> None:
    still = windows_of(walker([(4.0, 0.0)], speed=0.0, period=1e9), 10)
    found = local_minima(still, still, 0.05, apart=10)
    assert len(found.first) < 3 * still.count


def test_long_windows_are_compared_at_ten_frames() -> None:
    clip = walker([(3.0, 20.0)], frame_time=FINE)
    windows = windows_of(clip, 40)
    assert windows.height.shape == (clip.frames - 39, 10 * 6)


FINE = 1.0 / 120.0


@pytest.mark.parametrize(
    ("frames", "window", "weights", "said"),
    [
        (9, 10, None, "a clip of 9 frames is shorter than the window of 10 frames"),
        (30, 1, None, "a window needs at least 2 frames, not 1"),
        (30, 10, [1.0, 1.0], "joint weights must be 6 numbers of 0 or more"),
        (30, 10, [0.0] * 6, "at least one above 0"),
        (30, 10, [math.nan] * 6, "joint weights must be"),
        (30, 10, [-1.0, 2.0, 1.0, 1.0, 1.0, 1.0], "joint weights must be"),
    ],
)
def test_what_cannot_be_compared_is_told(frames: int, window: int, weights: list[float] | None, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        windows_of(walker([(frames * 1.0 / 30.0, 0.0)]), window, weights)
