"""Landscapes whose basins, slopes and curvature are known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from hopdiff.search.base import Eval
from hopdiff.types import Status

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


class Valleys:
    """Two wells in x at .25 and .75, the right one .5 % dearer with a wall of .1 between; a bowl in y; z is free.

    Above y = .9 no run is possible, above .95 nothing can be computed. lie: added to the slope in y.
    """

    dimension, dtype, device = 3, torch.float64, torch.device("cpu")
    start, spread = torch.tensor([0.3, 0.5, 0.5], dtype=torch.float64), 0.05

    def __init__(self, lie: float = 0.0) -> None:
        self.lie = lie

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        x, y, _ = genes.detach().unbind(-1)
        wall = 0.1 * (16 * (x - 0.25) * (x - 0.75)) ** 2
        merit = 1.0 + wall + 0.01 * (x - 0.25) + 2.0 * (y - 0.4) ** 2
        slope = 0.2 * 16 * (x - 0.25) * (x - 0.75) * 16 * (2 * x - 1.0) + 0.01
        grad = torch.stack([slope, 4.0 * (y - 0.4) + self.lie, torch.zeros_like(x)], dim=-1)
        merit = merit.masked_fill(y > 0.95, math.inf)
        cost = merit.masked_fill(y > 0.9, math.inf)
        status = torch.where(cost.isfinite(), int(Status.OK), int(Status.NOT_FINITE))
        return Eval(cost, grad if with_grad else None, merit, {}, status)


def test_descents_end_in_both_wells_and_what_is_free_is_no_wall() -> None:
    from experiments.landscape.measure import basins, descents, distance, pairs

    ends = descents(Valleys(), 12, 200, 0)
    assert (np.diff(ends.cost) >= 0).all()
    assert ends.near.sum() == 12
    assert np.isfinite(ends.cost).sum() >= 20  # those from the dead end stay where they are
    good = ends.genes[np.isfinite(ends.cost)]
    wells = good[:, 0] > 0.5
    assert 0 < wells.sum() < len(wells)
    assert ends.cost[0] == pytest.approx(1.0, abs=1e-4)
    assert good[:, 1] == pytest.approx(0.4, abs=1e-3)
    # z apart, there are two groups
    flat = good.copy()
    flat[:, 2] = 0.5
    groups = basins(flat, 0.05)
    assert groups.max() == 1
    assert len(set(zip(groups.tolist(), wells.tolist(), strict=True))) == 2
    assert float(distance(flat[wells][0], flat[~wells][0])) == pytest.approx(0.5 / math.sqrt(3), abs=0.01)
    # within a tenth of a per cent all lie in one well, and only z differs: a real freedom
    near = pairs(Valleys(), ends, 0.001, 12)  # type: ignore[arg-type]
    assert len(near) > 3
    assert max(one.barrier for one in near) < 1e-4
    assert max(one.apart for one in near) > 0.1
    # of the pairs within a per cent those of different wells have the wall between them
    both = pairs(Valleys(), ends, 0.01, 40)  # type: ignore[arg-type]
    assert max(one.barrier for one in both) == pytest.approx(0.1, abs=0.01)
    assert len(both) > len(near)


def test_slopes_that_lie_are_seen() -> None:
    from experiments.landscape.measure import slopes

    points = np.random.default_rng(0).uniform(size=(200, 3))
    true = slopes(Valleys(), points)  # type: ignore[arg-type]
    assert true.lost == pytest.approx((points[:, 1] > 0.95).mean())
    assert true.impossible == pytest.approx((points[:, 1] > 0.9).mean())
    there = np.isfinite(true.cosine)
    assert there.mean() == pytest.approx(1 - true.lost, abs=0.01)
    assert (1 - true.cosine[there]).max() < 1e-6
    assert np.median(true.error[there]) < 1e-7
    wrong = slopes(Valleys(lie=-20.0), points)  # type: ignore[arg-type]
    assert (wrong.cosine[there] < 0).mean() > 0.5


def test_curvature_is_that_of_the_bowl_and_flat_directions_are_walked_to_the_wall() -> None:
    from experiments.landscape.measure import curvature

    best = np.array([0.25, 0.4, 0.3])
    found = curvature(Valleys(), best, 0.001)  # type: ignore[arg-type]
    assert found.free.tolist() == [0, 1, 2]
    # 2 * .1 * (16 * .5)^2 along x, 4 along y, none along z
    assert found.values == pytest.approx([12.8, 4.0, 0.0], abs=0.05)
    assert found.reach[1] == pytest.approx(2 * math.sqrt(0.002 / 4.0) / math.sqrt(3), rel=0.05)
    assert found.told[1] == pytest.approx(found.reach[1], rel=0.05)
    assert found.reach[2] == pytest.approx(1.0 / math.sqrt(3), rel=0.02)
    held = curvature(Valleys(), np.array([0.25, 0.4, 0.0]), 0.001)  # type: ignore[arg-type]
    assert held.free.tolist() == [0, 1]


def test_planes_and_lines_pass_through_their_points() -> None:
    from experiments.landscape.measure import lines, plane, priced

    three = np.array([[0.25, 0.4, 0.3], [0.75, 0.4, 0.3], [0.25, 0.85, 0.9]])
    found = plane(Valleys(), three, 41)  # type: ignore[arg-type]
    assert found.corners[:2] == pytest.approx(np.array([[0, 0], [0.5 / math.sqrt(3), 0]]))
    for corner, point in zip(found.corners, three, strict=True):
        at = np.abs(found.y - corner[1]).argmin(), np.abs(found.x - corner[0]).argmin()
        assert found.merit[at] == pytest.approx(priced(Valleys(), point[None])[1][0], abs=0.02)  # type: ignore[arg-type]
    at, costs = lines(Valleys(), three[0], 11)  # type: ignore[arg-type]
    assert at.shape == costs.shape == (3, 12)
    assert costs.min(1) == pytest.approx(np.full(3, priced(Valleys(), three[:1])[0][0]))  # type: ignore[arg-type]
    assert np.isinf(costs[1]).any()
    assert np.ptp(costs[2]) == 0.0


@pytest.mark.thorough
def test_the_page_is_made_and_made_again_from_what_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.landscape.__main__ import main

    arguments = ["--problems", "smooth", "--descents", "3", "--iterations", "40", "--samples", "3", "--points", "9"]
    main([*arguments, "--keep", str(tmp_path / "keep"), "--out", str(tmp_path)])
    assert capsys.readouterr().out.count("smooth_smooth_human_v5_b0.5: ") == 9
    text = (tmp_path / "results.md").read_text()
    assert "| about the start | 0% | 0% | 0% |" in text
    assert "| about the best run | 0% | 0% | 0% |" in text
    assert "6 descents, best cost" in text
    assert str(tmp_path) not in text
    for name in ("ends", "planes", "slopes", "curvature", "lines_smooth"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
        assert f"({name}.png)" in text
    main([*arguments, "--keep", str(tmp_path / "keep"), "--out", str(tmp_path)])
    assert "smooth_smooth_human_v5_b0.5: " not in capsys.readouterr().out
    assert (tmp_path / "results.md").read_text() == text
