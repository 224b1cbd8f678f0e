"""The experiments that repeat figures of the thesis."""

from __future__ import annotations

import math

import pytest
import torch
from omegaconf import OmegaConf

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.doors import config_folder
from hopdiff.job import Run, search_run

FOLDER = config_folder() / "experiment" / "kang1999"
# Figure: speed, beta, search, and whether all gains are 5.
FIGURES = {
    "fig_3_11": (1.0, 0.2, "ordinary", True),
    "fig_3_12": (5.0, 0.2, "ordinary", True),
    "fig_3_14": (2.0, 0.2, "ordinary", True),
    "fig_5_1": (2.0, 0.0, "ga_thesis", True),
    "fig_5_2": (5.0, 0.0, "ga_thesis", True),
    "fig_5_3": (7.0, 0.0, "ga_thesis", True),
    "fig_5_4": (10.0, 0.2, "ga_thesis", False),
    "fig_5_5": (10.0, 0.7, "ga_thesis", False),
    "fig_5_7": (5.0, 0.5, "ga_thesis", False),
}


def run(name: str, *words: str) -> Run:
    return search_run(build_job(compose([f"+experiment=kang1999/{name}", *words])))


@pytest.mark.few(3)
@pytest.mark.few(4)
@pytest.mark.parametrize("name", FIGURES)
def test_figures_run_with_the_numbers_of_the_thesis(name: str) -> None:
    speed, beta, search, eta_is_5 = FIGURES[name]
    done = run(name, "budget.evaluations=150")
    metrics = done.metrics
    assert metrics["speed"] == pytest.approx(speed, rel=1e-9)
    assert (metrics["beta"], metrics["search"], metrics["model"]) == (beta, search, "thesis")
    assert math.isfinite(metrics["cost"])
    assert done.genes.get("eta") == (5.0 if eta_is_5 else None)
    assert metrics["evaluations"] == (1 if search == "ordinary" else 150)


def test_the_searches_of_chapter_5_have_a_hundred_generations_of_a_hundred() -> None:
    for name in [name for name in FIGURES if name.startswith("fig_5")]:
        job = build_job(compose([f"+experiment=kang1999/{name}"]))
        assert (job.settings["search"]["population"], job.budget.evaluations) == (100, 10_000)


@pytest.mark.parametrize("name", ["fig_5_7", "eta"])
def test_sweeps_end_in_their_comparison(name: str) -> None:
    hydra = OmegaConf.load(FOLDER / f"{name}.yaml").hydra
    assert hydra.mode == "MULTIRUN"
    assert hydra.callbacks.sweep.compare is True


@pytest.mark.thorough
def test_a_slow_run_moves_the_trunk_more_than_a_fast_one_at_the_same_eta() -> None:
    """What figures 3.11 and 3.12 show."""
    slow, fast = (_sway(run(name)) for name in ("fig_3_11", "fig_3_12"))
    assert slow[0] > 3.0 * fast[0]
    assert slow[1] > 3.0 * fast[1]


def _sway(done: Run) -> tuple[float, float]:
    """Range of the lean of the trunk forward and to the side over a stride [rad]."""
    clip = done.clip
    trunk = clip.rotations[:, 0] @ clip.rotations[:, clip.skeleton.index("waist")]
    up = trunk[..., 1]
    lean, side = torch.atan2(up[:, 2], up[:, 1]), torch.atan2(up[:, 0], up[:, 1])
    return float(lean.max() - lean.min()), float(side.max() - side.min())
