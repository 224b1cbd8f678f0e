"""The problem as a search sees it: gradients, failures, neighbours."""

from __future__ import annotations

import math
import subprocess
import sys
import warnings

import pytest
import torch
from torch import Tensor

import hopdiff.problem as module
from hopdiff import costs, limits
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.models.gait import stride_time
from hopdiff.problem import RunProblem
from hopdiff.types import HopdiffError, Status
from tests.builders import make_problem


def problem(*settings: str) -> RunProblem:
    """Of the smooth model, if the settings choose no other."""
    made = build_job(compose(("model=smooth", *settings))).problem
    assert isinstance(made, RunProblem)
    return made


def draw(of: RunProblem, count: int, seed: int = 0, inside: float = 0.0) -> Tensor:
    """Random candidates, `inside` away from the sides of the box."""
    generator = torch.Generator().manual_seed(seed)
    return inside + (1.0 - 2.0 * inside) * torch.rand(count, of.dimension, generator=generator, dtype=of.dtype)


@pytest.mark.few(3)
@pytest.mark.parametrize("form", ["smooth", "ratio"])
@pytest.mark.parametrize("priced", ["eval", "merit"])
def test_gradients_agree_with_central_differences(form: str, priced: str) -> None:
    """Of eval and of the whole merit, by every gene, at 100 random possible runs."""
    p = problem("speed=5", "beta=0.5", f"costs.gamma={form}")
    genes = draw(p, 140, inside=0.01)
    genes = genes[p.evaluate(genes, with_grad=False).status == Status.OK][:100]
    assert len(genes) == 100

    def price(x: Tensor) -> Tensor:
        merit, terms, _ = p.price(x, p.trajectory(x))
        return merit if priced == "merit" else terms["eval"]

    leaf = genes.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(price(leaf).sum(), leaf)
    step = 1e-6
    for gene, name in enumerate(p.table.names):
        shift = torch.zeros(p.dimension, dtype=p.dtype)
        shift[gene] = step
        with torch.no_grad():
            difference = (price(genes + shift) - price(genes - shift)) / (2.0 * step)
        error = (difference - gradient[:, gene]).abs() / gradient.abs().amax(-1)
        assert float(error.max()) < 1e-4, name


@pytest.mark.few(3)
@pytest.mark.parametrize("speed", [3, 5, 8])
def test_most_of_the_box_is_possible(speed: int) -> None:
    p = problem(f"speed={speed}")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = p.evaluate(draw(p, 4096), with_grad=True)
    assert result.grad is not None
    assert bool(torch.isfinite(result.grad).all())
    valid = result.status == Status.OK
    assert float(valid.double().mean()) >= 0.8
    assert bool(torch.isfinite(result.cost[valid]).all())
    assert bool(torch.isinf(result.cost[~valid]).all())


def test_neighbours_do_not_matter() -> None:
    p = problem("speed=4")
    genes = draw(p, 12)
    together = p.evaluate(genes, with_grad=True)
    spoiled = genes.clone()
    spoiled[0] = torch.nan
    spoiled[1] = 50.0
    beside = p.evaluate(spoiled, with_grad=True)
    assert not torch.isfinite(beside.cost[:2]).any()
    for i in range(2, 12):
        alone = p.evaluate(genes[i : i + 1], with_grad=True)
        for other in (together, beside):
            torch.testing.assert_close(other.merit[i], alone.merit[0], rtol=1e-9, atol=1e-12)
            torch.testing.assert_close(other.grad[i], alone.grad[0], rtol=1e-6, atol=1e-9)
            assert int(other.status[i]) == int(alone.status[0])


@pytest.mark.parametrize("settings", [("speed=5",), ("speed=4", "limp.amount=0.3"), ("model=thesis", "speed=5")])
def test_many_candidates_are_priced_in_chunks(monkeypatch: pytest.MonkeyPatch, settings: tuple[str, ...]) -> None:
    """Of the thesis, a chunk of short steps has fewer frames than one of long steps."""
    p = problem(*settings)
    genes = draw(p, 11, inside=0.1)
    priced, told = p.evaluate(genes, with_grad=True), p.residuals(genes)
    assert int(priced.merit.isfinite().sum()) > 5
    monkeypatch.setattr(module, "CHUNK", 4)
    sizes = []
    whole = RunProblem.trajectory
    monkeypatch.setattr(RunProblem, "trajectory", lambda own, x: sizes.append(len(x)) or whole(own, x))
    for found, wanted in ((p.evaluate(genes, with_grad=True), priced), (p.residuals(genes), told)):
        for name in ("cost", "merit", "status", "grad", "residuals"):
            torch.testing.assert_close(getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-10, msg=name)
        assert set(found.terms) == set(wanted.terms)
        for name, value in wanted.terms.items():
            torch.testing.assert_close(found.terms[name], value, rtol=1e-9, atol=1e-12)
    assert sizes == [4, 4, 3, 4, 4, 3]


@pytest.mark.thorough
def test_a_large_population_needs_little_memory() -> None:
    """In a process of its own, whose peak is its own: 4,096 candidates with gradient, and with residuals."""
    code = """
import resource
import torch
from hopdiff.composing import compose
from hopdiff.config import build_job
problem = build_job(compose(["model=smooth"])).problem
genes = torch.rand(4096, problem.dimension, dtype=problem.dtype, generator=torch.Generator().manual_seed(0))
problem.evaluate(genes[:1], with_grad=True)
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
before = peak()
problem.evaluate(genes, with_grad=True)
problem.residuals(genes)
print(peak() - before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) < 400.0


@pytest.mark.few(5)
@pytest.mark.parametrize("model", ["smooth", "thesis"])
@pytest.mark.parametrize("character", ["human", "child", "cartoon"])
def test_the_ordinary_run_has_the_energy_of_beta_0_2(model: str, character: str) -> None:
    p = problem("beta=0.2", f"model={model}", f"character={character}", "speed=4")
    result = p.evaluate(p.ordinary_genes.unsqueeze(0), with_grad=False)
    assert int(result.status) == Status.OK
    assert float(result.terms["energy"]) == pytest.approx(0.25, rel=1e-9)


FIXED = ("genes.fixed.step_width=0.11", "genes.fixed.duty_factor=0.25")


@pytest.mark.parametrize("settings", [FIXED, ("genes.common_eta=true", "genes.fixed.eta=9")])
def test_the_energy_unit_does_not_depend_on_what_is_fixed(settings: tuple[str, ...]) -> None:
    plain, other = problem("speed=4"), problem("speed=4", *settings)
    assert other.ordinary == plain.ordinary
    energy = [float(p.evaluate(p.start[None], with_grad=False).terms["energy"]) for p in (plain, other)]
    assert energy[0] == pytest.approx(0.25, rel=1e-9)
    assert energy[1] != pytest.approx(0.25, rel=1e-3)


def test_fixed_genes_cost_nothing_wherever_they_lie_in_the_box() -> None:
    p = problem("speed=4", *FIXED)
    low, high = draw(p, 2)[0].repeat(2, 1)
    low[p.table.free == 0], high[p.table.free == 0] = 0.0, 1.0
    assert not torch.equal(low, high)
    result = p.evaluate(torch.stack((low, high)), with_grad=True)
    assert float(result.merit[0]) == pytest.approx(float(result.merit[1]), rel=1e-9)
    assert float(result.grad[:, p.table.free == 0].abs().max()) == 0.0


def test_the_start_is_the_everyday_run_with_the_fixed_genes_put_in() -> None:
    plain, other = problem("speed=4"), problem("speed=4", *FIXED)
    values = [dict(zip(p.table.names, p.table.to_physical(p.start).tolist(), strict=True)) for p in (plain, other)]
    assert values[1] == pytest.approx(values[0] | {"step_width": 0.11, "duty_factor": 0.25}, rel=1e-12)


def test_single_precision_prices_alike() -> None:
    double, single = problem("speed=5"), problem("speed=5", "dtype=float32")
    genes = draw(double, 64)
    a, b = double.evaluate(genes, with_grad=False), single.evaluate(genes.float(), with_grad=False)
    both = (a.status == Status.OK) & (b.status == Status.OK)
    assert int(both.sum()) > 50
    torch.testing.assert_close(b.terms["energy"][both].double(), a.terms["energy"][both], rtol=2e-2, atol=1e-3)


@pytest.mark.parametrize(("speed", "says"), [(0.2, "no ordinary run exists at speed=0.2")])
def test_a_speed_without_an_ordinary_run_is_refused(speed: float, says: str) -> None:
    with pytest.raises(HopdiffError, match=says):
        problem(f"speed={speed}")


@pytest.mark.parametrize("beta", [0.1, 0.7])
def test_the_merit_is_the_sum_of_its_terms(beta: float) -> None:
    p = make_problem("speed=4", f"beta={beta}", "genes.fixed.step_width=0.11")
    s, genes = p.settings, draw(p, 6)
    t = p.trajectory(genes)
    merit, terms, _ = p.price(genes, t)
    raw = costs.energy_rate_raw(t, p.character)
    energy = raw / p.ordinary.energy_unit
    free = p.table.free > 0
    away = torch.stack([((row - p.ordinary_genes)[free] ** 2).sum() / p.dimension for row in genes])
    lean = math.radians(s.style.trunk_lean_deg)
    wanted = {
        "eval": costs.evaluation(costs.connectivity(t, s.gamma, s.gamma_guard), energy, beta),
        "energy_match": s.energy_match * costs.energy_mismatch(energy, beta),
        "leg_force": s.leg_force * (1.0 - beta) * costs.leg_effort(t),
        "style": s.style.weight * costs.style_mismatch(t, p.ordinary, s.style, beta),
        "posture": s.style.trunk_lean_weight * costs.posture_mismatch(t, lean),
        "ordinary": s.ordinary * away,
        "penalty": limits.penalty(limits.excesses(t, p.character, s.limits), s.limits),
    }
    for name, value in wanted.items():
        assert float(value.abs().max()) > 0.0, name
        torch.testing.assert_close(terms[name], value, rtol=1e-9, atol=1e-15, msg=name)
    torch.testing.assert_close(merit, sum(wanted.values()), rtol=1e-9, atol=0.0)
    torch.testing.assert_close(terms["energy_raw"], raw)
    torch.testing.assert_close(terms["energy"], energy)


def test_the_ordinary_run_is_measured_on_sound_legs() -> None:
    p = make_problem("speed=4")
    usual = p.ordinary
    t = p.trajectory(p.ordinary_genes[None])
    assert usual.contact_time == pytest.approx(float(t.contact_time), rel=1e-9)
    assert usual.flight_time == pytest.approx(float(t.flight_time), rel=1e-9)
    assert usual.bounce == pytest.approx(float(costs.com_bounce(t)), rel=1e-9)
    assert usual.arm_swing == pytest.approx(float(costs.arm_swing(t)), rel=1e-9)
    assert make_problem("speed=4", "limp.amount=0.3").ordinary == usual


def test_what_breaks_a_constraint_keeps_its_merit_and_loses_its_cost() -> None:
    p = make_problem("speed=5", "beta=0.5")
    result = p.evaluate(draw(p, 64, seed=4), with_grad=True)
    broken = result.status != Status.OK
    assert 0 < int(broken.sum()) < 64
    assert bool(torch.isinf(result.cost[broken]).all())
    torch.testing.assert_close(result.cost[~broken], result.merit[~broken], rtol=0.0, atol=0.0)
    computable = broken & (result.status != Status.STANCE_UNSOLVED)
    assert bool(torch.isfinite(result.merit[computable]).all())
    assert result.grad is not None
    assert bool((result.grad[computable].abs().amax(-1) > 0.0).all())
    assert p.evaluate(draw(p, 2), with_grad=False).grad is None


def test_froude_speed_is_that_over_the_root_of_g_and_leg_length() -> None:
    p = make_problem("speed=4")
    assert p.froude == pytest.approx(4.0 / math.sqrt(9.81 * p.character.leg_length), rel=1e-3)


def test_no_candidate_strides_faster_than_the_shortest_stride() -> None:
    """The least way on the ground at the asked speed, over the largest duty factor."""
    p = problem("speed=5", "beta=0.5")
    low, high = (dict(zip(p.table.names, ends.tolist(), strict=True)) for ends in (p.table.low, p.table.high))
    reach = low["leg_extension"] * math.sin(math.radians(low["touchdown_angle"])) * p.character.leg_length
    assert p.shortest_stride == pytest.approx(2.0 * reach / 5.0 / high["duty_factor"])
    genes = draw(p, 50)
    genes = genes[p.evaluate(genes, with_grad=False).status == Status.OK]
    assert float(stride_time(p.gait(genes)).min()) > p.shortest_stride


@pytest.mark.parametrize(
    "settings",
    [
        ("speed=5", "beta=0.5"),
        ("speed=3", "beta=0.0", "costs.gamma=ratio"),
        ("speed=4", "beta=0.7", "limp.amount=0.3"),
        ("model=thesis", "costs=default", "genes=default", "speed=5", "beta=0.5"),
        ("model=thesis", "speed=5", "beta=0.5"),
    ],
    ids=" ".join,
)
def test_residuals_are_roots_of_the_merit(settings: tuple[str, ...]) -> None:
    """Their squares sum to it but for one constant, and their slopes give its gradient."""
    p = problem(*settings)
    genes = draw(p, 60, inside=0.01)
    plain, found = p.evaluate(genes, with_grad=True), p.residuals(genes)
    for name in ("cost", "merit", "status"):
        assert torch.equal(getattr(found, name), getattr(plain, name))
    assert found.grad is None
    assert found.residuals is not None
    known = found.merit.isfinite()
    assert int(known.sum()) > 5
    rest = (found.merit - found.residuals.square().sum(-1))[known]
    torch.testing.assert_close(rest, rest[:1].expand_as(rest), rtol=0.0, atol=1e-9 * float(found.merit[known].max()))
    assert plain.grad is not None
    step = 1e-6
    for gene in (0, p.dimension // 2, p.dimension - 1):
        shift = step * torch.eye(p.dimension, dtype=p.dtype)[gene]
        ahead, behind = (p.residuals(genes + sign * shift).residuals for sign in (1.0, -1.0))
        assert ahead is not None
        assert behind is not None
        slope = (found.residuals * (ahead - behind) / step).sum(-1)
        error = (slope - plain.grad[:, gene])[known].abs() / plain.grad[known].abs().amax(-1)
        assert float(error.median()) < 1e-6
