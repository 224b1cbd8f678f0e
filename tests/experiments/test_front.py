"""The front of energy, smoothness and peak force: what is minimised, how fronts are measured, a tiny one from end to
end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

ROOT = Path(__file__).resolve().parents[2]

pytest.importorskip("pymoo")


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def test_the_cost_is_the_weighted_objectives_and_the_limits() -> None:
    from experiments.front.objectives import NAMES, Counted, build, objectives_of

    job, objectives = build("human", 3.5)
    counted = Counted(job, objectives)
    generator = torch.Generator().manual_seed(0)
    points = (job.problem.start + 0.02 * torch.randn(3, job.problem.dimension, generator=generator)).clamp(0.01, 0.99)  # type: ignore[union-attr]
    plain = counted.evaluate(points.numpy(), None)
    values = objectives_of(plain)
    assert plain.grad is None
    assert set(plain.terms) - {"energy"} == {*NAMES, "scalar_less_sum", "penalty"}
    assert plain.merit.numpy() == pytest.approx(values.sum(1) + plain.terms["penalty"].numpy())
    assert ((values[:, 2] > 1.5) & (values[:, 2] < 5.0)).all()  # body weights, on one foot
    objectives.ideal, objectives.span = (
        torch.tensor([0.2, 50.0, 1.5]).double(),
        torch.tensor([1.0, 300.0, 1.0]).double(),
    )
    weights = np.array([[1.0, 0.02, 0.02], [0.02, 1.0, 0.02], [0.02, 0.02, 1.0]])
    found = counted.evaluate(points.numpy(), weights)
    assert objectives_of(found) == pytest.approx(values)
    scaled = (values - objectives.ideal.numpy()) / objectives.span.numpy()
    told = (found.merit - found.terms["penalty"]).numpy()
    largest = (weights * scaled).max(1)
    assert (told >= largest - 1e-9).all()
    assert told == pytest.approx(largest, abs=0.03)
    # down the gradient of the last one, its peak force falls by as much as the slope says
    assert found.grad is not None
    way = found.grad[2] / found.grad[2].norm()
    step = 1e-4
    near = torch.stack([points[2] - step * way, points[2] + step * way])
    sides = counted.evaluate(near.numpy(), np.repeat(weights[2:], 2, axis=0)).merit
    assert float((sides[1] - sides[0]) / (2 * step)) == pytest.approx(float(found.grad[2].norm()), rel=0.02)
    assert (counted.evaluations, counted.gradient_evaluations) == (8, 5)


def test_fronts_are_measured_by_what_lies_behind_them() -> None:
    from experiments.front.objectives import Batch
    from experiments.front.population import MARGIN, best_of, course, hypervolume

    values = np.array([[0.0, 1.0, 0.5], [1.0, 0.0, 0.5], [1.0, 1.0, 0.6], [0.5, 0.5, 0.0]])
    assert sorted(best_of(values).tolist()) == [0, 1, 3]
    ideal, nadir = np.zeros(3), np.ones(3)
    assert hypervolume(np.zeros((1, 3)), ideal, nadir) == pytest.approx(1.0)
    assert hypervolume(values[3:], ideal, nadir) == pytest.approx(0.6 * 0.6 * 1.1 / MARGIN**3)
    assert hypervolume(2 * values[3:], 2 * ideal, 2 * nadir) == pytest.approx(0.6 * 0.6 * 1.1 / MARGIN**3)
    assert hypervolume(values[:0], ideal, nadir) == hypervolume(values + 2.0, ideal, nadir) == 0.0
    genes = np.zeros((1, 2))
    batches = [Batch(10 * (at + 1), 0, float(at), values[at : at + 1], genes) for at in range(4)]
    rows = course(batches, ideal, nadir)
    assert [row[0] for row in rows] == [10, 20, 30, 40]
    assert (np.diff([row[3] for row in rows]) >= 0).all()
    assert rows[-1][3] == pytest.approx(hypervolume(values, ideal, nadir))
    assert rows[1][3] == rows[2][3]  # the third is behind both


def test_weights_lie_evenly_and_five_runs_are_told_apart() -> None:
    from experiments.front.__main__ import five
    from experiments.front.sweep import simplex

    weights = simplex(18)
    assert len(weights) == 190
    assert weights.sum(1) == pytest.approx(1.0)
    assert (weights >= 0).all()
    assert len(np.unique(weights, axis=0)) == 190
    chosen = five(simplex(6), np.zeros(3), np.ones(3))
    assert list(chosen) == ["least_muscle_work", "least_torque_rates", "least_peak_force", "middle", "between"]
    assert len(set(chosen.values())) == 5
    assert simplex(6)[chosen["middle"]] == pytest.approx(np.full(3, 1 / 3))


@pytest.mark.thorough
def test_a_small_front_is_made_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.front.__main__ import Kept, main, parser
    from experiments.front.objectives import Batch

    small = "--divisions 2 --iterations 3 --starts 1 --anchor-iterations 25 --population 12 --repeats 1 --keep"
    arguments = [*small.split(), str(tmp_path / "keep"), "--out", str(tmp_path)]
    main(arguments)
    said = capsys.readouterr().out
    assert [said.count(f"{name}: ") > 0 for name in ("anchors", "gradients", "nsga2", "nsga2_seeded")] == [True] * 4
    text = (tmp_path / "results.md").read_text()
    rows = {line.split("|")[1].strip(): line.split("|")[2:] for line in text.splitlines() if line.startswith("| ")}
    spent = [float(rows[name][2]) for name in ("gradients", "NSGA-II", "NSGA-II from the front's ends")]
    assert max(spent) < 1.1 * min(spent)
    assert int(rows["NSGA-II"][1]) == 0
    # every method is charged for what it builds on
    assert int(rows["NSGA-II from the front's ends"][1]) > 0
    assert all(float(rows[name][6]) > 0 for name in ("gradients", "NSGA-II", "NSGA-II from the front's ends"))
    assert str(tmp_path) not in text
    assert (tmp_path / "fronts.png").stat().st_size > 20_000
    data = (tmp_path / "front.glb").read_bytes()
    content = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])  # the first chunk of a GLB file
    clips = [animation["name"] for animation in content["animations"]]
    assert clips == ["least_muscle_work", "least_torque_rates", "least_peak_force", "middle", "between"]
    # what was found is there for the same command, and for no other

    def never() -> tuple[list[Batch], np.ndarray]:
        raise LookupError

    batches, ends = Kept(parser().parse_args(arguments))("gradients", never)
    assert batches[-1].evaluations == int(rows["gradients"][0])
    assert all(len(batch.values) == len(batch.genes) for batch in batches)
    assert len(ends) == 6
    with pytest.raises(LookupError):
        Kept(parser().parse_args([*arguments, "--seed", "1"]))("gradients", never)
