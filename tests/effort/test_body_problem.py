"""The whole-body run as a search sees it: gradients, failures, neighbours, similarity, and the run of least cost."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort import problem as module
from hopdiff.effort.problem import BodyProblem
from hopdiff.effort.terms import energy_ratio, muscle_power, muscle_pull
from hopdiff.objective import residuals_of
from hopdiff.search.gradient import Gradient
from hopdiff.search.loop import Budget, run_search
from hopdiff.types import HopdiffError, Status
from tests.effort.runs import EXACT, ORDINARY, priced, unit_genes
from tests.whole_body.bodies import DTYPE, body_problem

LEAST = ("costs.least.external_work=0.11", "costs.least.contact_time=0.22")
BRISK = ("speed=3.5", "beta=0.7", *LEAST)


@pytest.mark.few(2)
@pytest.mark.parametrize("settings", [ORDINARY, BRISK])
def test_gradients_agree_with_central_differences(settings: tuple[str, ...]) -> None:
    """Of the merit by every gene, at two runs; measured: to 1e-5 of the largest entry."""
    p = body_problem(*settings, *EXACT)
    genes = unit_genes(p, 2, 0.03)
    found = p.evaluate(genes, with_grad=True)
    assert found.grad is not None
    step = 1e-5 * torch.eye(p.dimension, dtype=DTYPE)
    for k, gradient in enumerate(found.grad):
        differences = (p.evaluate(genes[k] + step, False).merit - p.evaluate(genes[k] - step, False).merit) / 2e-5
        error = (differences - gradient).abs() / gradient.abs().max()
        assert float(error.max()) < 1e-4, p.table.names[int(error.argmax())]
        assert int((gradient.abs() > 1e-3 * gradient.abs().max()).sum()) > 25


def test_few_rounds_give_nearly_that_gradient() -> None:
    """The rounds of a search: measured, within four degrees of the exact one."""
    exact, quick = body_problem(*ORDINARY, *EXACT), body_problem(*ORDINARY)
    genes = unit_genes(exact, 3, 0.03)
    wanted, found = (p.evaluate(genes, with_grad=True).grad for p in (exact, quick))
    assert wanted is not None
    assert found is not None
    cosine = torch.nn.functional.cosine_similarity(wanted, found, dim=-1)
    assert float(cosine.min()) > 0.995


def test_neighbours_do_not_matter() -> None:
    p = body_problem(*ORDINARY)
    genes = unit_genes(p, 5, 0.05)
    together = p.evaluate(genes, with_grad=True)
    spoiled = genes.clone()
    spoiled[0] = torch.nan
    spoiled[1] = 5.0
    beside = p.evaluate(spoiled, with_grad=True)
    assert not torch.isfinite(beside.cost[:2]).any()
    assert beside.grad is not None
    assert bool(torch.isfinite(beside.grad).all())
    for i in range(2, 5):
        alone = p.evaluate(genes[i : i + 1], with_grad=True)
        for other in (together, beside):
            torch.testing.assert_close(other.merit[i], alone.merit[0], rtol=1e-8, atol=1e-10)
            torch.testing.assert_close(other.grad[i], alone.grad[0], rtol=1e-5, atol=1e-6)
            assert int(other.status[i]) == int(alone.status[0])
            for name, value in alone.terms.items():
                torch.testing.assert_close(other.terms[name][i], value[0], rtol=1e-7, atol=1e-9)


def test_many_candidates_are_priced_in_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    p = body_problem(*ORDINARY)
    genes = unit_genes(p, 7, 0.05)
    whole = p.evaluate(genes, with_grad=True)
    monkeypatch.setattr(module, "CHUNK", 3)
    parts = p.evaluate(genes, with_grad=True)
    torch.testing.assert_close(parts.merit, whole.merit, rtol=1e-8, atol=1e-10)
    torch.testing.assert_close(parts.grad, whole.grad, rtol=1e-5, atol=1e-6)
    assert torch.equal(parts.status, whole.status)
    assert set(parts.terms) == set(whole.terms)
    assert all(len(value) == 7 for value in parts.terms.values())


def test_the_merit_is_the_sum_of_its_terms() -> None:
    p = body_problem(*BRISK)
    found = p.evaluate(unit_genes(p, 3, 0.03), with_grad=False)
    added = sum(value for name, value in found.terms.items() if name != "energy")
    torch.testing.assert_close(added, found.merit)
    assert {"positive_work", "negative_work", "torque", "torque_rate", "energy_match", "penalty"} <= set(found.terms)


def test_a_candidate_that_cannot_be_computed_stops_nothing() -> None:
    p = body_problem(*ORDINARY)
    genes = unit_genes(p, 2)
    genes[1, 3] = math.nan
    found = p.evaluate(genes, with_grad=True)
    assert int(found.status[0]) == Status.OK
    assert int(found.status[1]) in (Status.NOT_FINITE, Status.NOT_CLOSED)
    assert math.isinf(float(found.merit[1]))
    assert found.grad is not None
    assert float(found.grad[1].abs().max()) == 0.0


def merits(*settings: str) -> dict[str, Tensor]:
    p = body_problem(*settings, *EXACT)
    genes = unit_genes(body_problem(*ORDINARY, *EXACT), 3, 0.03)
    found = p.evaluate(genes, with_grad=False)
    return {**found.terms, "merit": found.merit}


def test_a_heavier_body_runs_at_the_same_cost() -> None:
    light, heavy = merits(*ORDINARY), merits(*ORDINARY, "character.mass=140")
    for name, value in light.items():
        torch.testing.assert_close(heavy[name], value, rtol=1e-9, atol=1e-12)


def test_a_body_four_times_as_tall_runs_twice_as_fast_at_the_same_cost() -> None:
    """Froude's similarity: the same genes are the same movement. Only the rounding of powers between positive and
    negative work has a width in W/kg: the two terms differ by up to 5 %, their powers do not."""
    small, tall = merits(*ORDINARY), merits("speed=7", "beta=0.2", "character.height=7.0")
    for name, value in small.items():
        rounded = name in ("positive_work", "negative_work", "merit")
        torch.testing.assert_close(tall[name], value, rtol=0.05 if rounded else 1e-5, atol=1e-7)
    runs = priced(), priced("speed=7", "beta=0.2", "character.height=7.0")
    powers = []
    problems = body_problem(*ORDINARY), body_problem("speed=7", "beta=0.2", "character.height=7.0")
    for p, run in zip(problems, runs, strict=True):
        power = muscle_power(muscle_pull(run, p.settings), p.pricing.numbers.muscles, p.settings.transfer)
        powers.append(power / (9.81 * p.speed))
    inner = slice(2, 22)
    torch.testing.assert_close(powers[1][..., inner], powers[0][..., inner], rtol=0.0, atol=1e-5)
    assert float(powers[0].abs().max()) > 0.1
    torch.testing.assert_close(runs[1].external_work(), runs[0].external_work(), rtol=0.02, atol=0.0)


def no_search(*given: Any) -> Any:
    raise AssertionError("nothing should be searched for")


def test_given_numbers_of_the_least_run_need_no_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "run_search", no_search)
    job = build_job(compose(["model=body", *BRISK]))
    p = job.problem
    assert isinstance(p, BodyProblem)
    assert p.least == (0.11, 0.22, None)
    torch.testing.assert_close(p.start, p.table.to_unit(p.table.ordinary))
    found = p.evaluate(unit_genes(p), with_grad=False)
    run = p.run(unit_genes(p), with_grad=False)
    wanted = energy_ratio(0.7, p.settings.scale) * 0.11
    missed = (float(run.external_work()[0]) / wanted - 1.0) ** 2
    assert float(found.terms["energy_match"][0]) == pytest.approx(p.settings.energy * missed)
    contact = float(run.contact_times()[0, 0])
    assert float(found.terms["contact_cap"][0]) == pytest.approx(
        p.settings.contact_cap * (max(contact / 0.22 - 1.0, 0.0) / 0.1) ** 2
    )
    # Told like the thesis' energy: where the work is that of the least run, it is 0.25.
    told = 0.25 * (float(run.external_work()[0]) / 0.11) ** (1.0 / p.settings.scale)
    assert float(found.terms["energy"][0]) == pytest.approx(told)
    # An ordinary run asks for nothing.
    ordinary = build_job(compose(["model=body", *ORDINARY])).problem
    assert isinstance(ordinary, BodyProblem)
    assert ordinary.least is None
    assert float(ordinary.evaluate(unit_genes(ordinary), False).terms["energy"][0]) == pytest.approx(0.25)
    assert ordinary.told({"name": "human"}) == {"name": "human"}


def test_told_puts_the_least_run_into_the_settings() -> None:
    job = build_job(compose(["model=body", *BRISK]))
    assert job.settings["costs"]["least"] == {"external_work": 0.11, "contact_time": 0.22}
    plain = {"name": "human", "least": {"external_work": None, "contact_time": None}, "torque": 1.0}
    found = job.problem.told(plain)
    assert found == {"name": "human", "least": {"external_work": 0.11, "contact_time": 0.22}, "torque": 1.0}
    assert plain["least"] == {"external_work": None, "contact_time": None}


def test_the_least_run_is_searched_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its numbers are those of the genes that the search finds; searches of brisk runs begin about them."""
    asked = []
    genes = unit_genes(body_problem(*ORDINARY))[0]

    def search(problem: BodyProblem, *given: Any) -> SimpleNamespace:
        assert problem.beta == 0.2
        assert problem.least is None
        asked.append(problem.speed)
        return SimpleNamespace(interrupted=False, best_genes=genes)

    monkeypatch.setattr(module, "run_search", search)
    monkeypatch.setattr(module, "_found", {})
    found = [build_job(compose(["model=body", "speed=3.5", f"beta={beta}"])).problem for beta in (0.5, 0.7)]
    assert asked == [3.5]
    run = body_problem(*ORDINARY).run(genes.unsqueeze(0), with_grad=False)
    for p in found:
        assert isinstance(p, BodyProblem)
        assert p.least is not None
        assert p.least.external_work == pytest.approx(float(run.external_work()[0]))
        assert p.least.contact_time == pytest.approx(float(run.contact_times()[0, 0]))
        assert torch.equal(p.start, genes)
        assert p.spread < body_problem(*ORDINARY).spread
    # Another speed, body or price has another one.
    for other in (["speed=4"], ["character=child"], ["costs.torque=0.2"], ["genes.fixed.step_width=0.05"]):
        typed = {word.split("=")[0] for word in other}
        base = [word for word in ("speed=3.5", "beta=0.7") if word.split("=")[0] not in typed]
        before = len(asked)
        build_job(compose(["model=body", *base, *other]))
        assert len(asked) == before + 1, other
    # Also where the gene table is the same: it ends at sprints.
    for speed in (12, 13):
        build_job(compose(["model=body", "beta=0.7", f"speed={speed}"]))
    assert asked[-2:] == [12.0, 13.0]


def test_a_speed_without_a_least_run_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def search(*given: Any) -> None:
        raise HopdiffError("nothing found.")

    monkeypatch.setattr(module, "run_search", search)
    monkeypatch.setattr(module, "_found", {})
    with pytest.raises(HopdiffError, match=r"no run of least cost was found at speed=3\.5 for character 'human'"):
        build_job(compose(["model=body", "speed=3.5", "beta=0.7"]))


@pytest.mark.parametrize("other", ["character.shoe=0.05", "character.joints.neck.segment.com=[0,0.09,0.008]"])
def test_another_body_has_another_least_run(monkeypatch: pytest.MonkeyPatch, other: str) -> None:
    asked = []

    def search(problem: BodyProblem, *given: Any) -> SimpleNamespace:
        asked.append(problem)
        return SimpleNamespace(interrupted=False, best_genes=unit_genes(problem)[0])

    monkeypatch.setattr(module, "run_search", search)
    monkeypatch.setattr(module, "_found", {})
    for more in ([], [other]):
        build_job(compose(["model=body", "speed=3.5", "beta=0.7", *more]))
    assert len(asked) == 2


@pytest.mark.parametrize(("speed", "beta", "says"), [(0.0, 0.2, "speed"), (math.nan, 0.2, "speed"), (3.0, 1.0, "beta")])
def test_numbers_that_make_no_sense_are_refused(speed: float, beta: float, says: str) -> None:
    p = body_problem(*ORDINARY)
    with pytest.raises(HopdiffError, match=says):
        BodyProblem(p.character, p.table, p.model, p.settings, speed, beta)


def test_single_precision_prices_alike() -> None:
    double, single = body_problem(*ORDINARY), body_problem(*ORDINARY, "dtype=float32")
    genes = unit_genes(double, 3, 0.03)
    a, b = double.evaluate(genes, with_grad=False), single.evaluate(genes.float(), with_grad=False)
    assert torch.equal(a.status, b.status)
    for name in ("positive_work", "negative_work", "torque"):
        torch.testing.assert_close(b.terms[name].double(), a.terms[name], rtol=2e-2, atol=1e-3)


def test_a_candidate_whose_rounds_do_not_come_to_rest_has_no_merit(monkeypatch: pytest.MonkeyPatch) -> None:
    p = body_problem(*ORDINARY)
    genes = unit_genes(p)
    assert math.isfinite(float(p.evaluate(genes, with_grad=False).merit))
    monkeypatch.setattr("hopdiff.effort.problem.LOST", 0.0)
    assert math.isinf(float(p.evaluate(genes, with_grad=False).merit))


def test_the_shortest_stride_is_two_of_the_shortest_steps() -> None:
    p = body_problem(*ORDINARY)
    row = p.table.names.index("step_time")
    step = float(p.table.low[row]) * math.sqrt(p.character.leg_length / 9.81)
    assert p.shortest_stride == pytest.approx(2.0 * step)


@pytest.mark.parametrize("settings", [ORDINARY, BRISK])
def test_residuals_are_roots_of_the_merit(settings: tuple[str, ...]) -> None:
    """But for a constant and for work, which is rounded where the power changes its sign: measured, to 2 per cent."""
    p = body_problem(*settings, *EXACT)
    genes = unit_genes(p, 4, 0.03)
    plain, found = p.evaluate(genes, with_grad=True), p.residuals(genes)
    torch.testing.assert_close(found.merit, plain.merit, rtol=1e-10, atol=0.0)
    assert torch.equal(found.status, plain.status)
    assert found.residuals is not None
    rest = found.merit - found.residuals.square().sum(-1)
    assert float((rest - rest.mean()).abs().max()) < 0.02 * float(found.merit.min())
    step = 1e-5 * torch.eye(p.dimension, dtype=DTYPE)
    assert plain.grad is not None
    for k, gradient in enumerate(plain.grad):
        ahead, behind = p.residuals(genes[k] + step).residuals, p.residuals(genes[k] - step).residuals
        assert ahead is not None
        assert behind is not None
        slopes = (found.residuals[k] * (ahead - behind)).sum(-1) / 1e-5
        assert float((slopes - gradient).norm() / gradient.norm()) < 0.05


def test_residuals_of_every_term_sum_to_it() -> None:
    p = body_problem(*BRISK, *EXACT)
    run = p.run(unit_genes(p, 3, 0.03), with_grad=False)
    prices = {term.name: term.weight * term.value(run) for term in p.terms}
    for term, roots in zip(p.terms, residuals_of(p.terms, run, prices), strict=True):
        off = prices[term.name] - roots.square().sum(-1)
        assert float((off - off.mean()).abs().max()) < (0.01 if "work" in term.name else 1e-9), term.name


def test_residuals_come_in_chunks_too(monkeypatch: pytest.MonkeyPatch) -> None:
    p = body_problem(*ORDINARY)
    genes = unit_genes(p, 5, 0.05)
    whole = p.residuals(genes)
    monkeypatch.setattr(module, "CHUNK", 2)
    parts = p.residuals(genes)
    assert whole.residuals is not None
    assert parts.residuals is not None
    torch.testing.assert_close(parts.residuals, whole.residuals)
    torch.testing.assert_close(parts.merit, whole.merit)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(3))
def test_the_default_search_ends_by_itself_in_one_place(seed: int) -> None:
    """Measured at 5 m/s, beta 0.2: 31 to 60 batches."""
    p = body_problem("speed=5", "beta=0.2")
    result = run_search(p, Gradient(), Budget(3000), torch.Generator().manual_seed(seed))
    assert result.stopped == "converged"
    assert len(result.history) < 80
    reference = run_search(p, Gradient(), Budget(3000), torch.Generator().manual_seed(99)).best_cost
    assert result.best_cost == pytest.approx(reference, rel=1e-3)
