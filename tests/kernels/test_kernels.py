"""Kernels: numbers taken out of objects and put in, the chain about the compiled pieces, and one piece compiled."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.effort.problem import BodyProblem
from hopdiff.kernels import choose as choose_module
from hopdiff.kernels import store
from hopdiff.kernels.bound import Bound
from hopdiff.kernels.build import build
from hopdiff.kernels.choose import chosen
from hopdiff.kernels.numbers import numbers_of, packed, with_numbers
from hopdiff.kernels.pieces import Told
from hopdiff.objective import Term
from hopdiff.types import HopdiffError
from tests.effort.runs import ORDINARY, unit_genes
from tests.whole_body.bodies import body_problem

LEAST = ("costs.least.external_work=0.2", "costs.least.contact_time=0.25")
OTHERS = [
    ("speed=3.5", "beta=0.2"),
    ("speed=3", "beta=0.7", *LEAST),
    ("speed=2.5", "beta=0.5", "character=child", *LEAST),
]

KERNELS: dict[str, store.Kernel] = {}  # of `traced`


def told_of(problem: BodyProblem) -> Told:
    return Told.of(problem.table.names, problem.model, problem.pricing.numbers, problem.speed)


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Pieces as a kernel of another body's run would do them: its structure, and numbers that it is given. What was
    called, and for how many candidates."""
    elsewhere = told_of(body_problem("speed=4", "beta=0.6", "character.proportions.legs=1.1", *LEAST))
    calls = []

    def kernel(piece: str) -> Callable[[list[Tensor]], list[Tensor]]:
        def run(inputs: list[Tensor]) -> list[Tensor]:
            count = {"pull": 4}.get(piece, 3)
            given, plain, tensors = inputs[:count], inputs[count], inputs[count + 1 :]
            assert all(x.is_contiguous() for x in given)
            calls.append((piece, len(given[0])))
            with torch.enable_grad():  # as a trace of the piece has it
                return list(getattr(with_numbers(elsewhere, plain, tensors), piece)(*given))

        return run

    monkeypatch.setattr("tests.kernels.test_kernels.KERNELS", {piece: kernel(piece) for piece in store.PIECES})
    return calls


def with_kernels(*words: str) -> BodyProblem:
    """A problem of its own: others share one."""
    problem = body_problem.__wrapped__(*words)
    problem.kernels = Bound(KERNELS, told_of(problem))
    return problem


# -- numbers --


@dataclass(frozen=True)
class Thing:
    size: float
    none: float
    wide: float
    names: tuple[str, ...]
    parts: list[Tensor]
    count: int


def test_numbers_are_taken_out_and_put_in() -> None:
    thing = Thing(2.0, 0.0, math.inf, ("a",), [torch.ones(2)], 3)
    plain, tensors, structure = numbers_of(thing)
    assert plain == [2.0]
    assert len(tensors) == 1
    other = with_numbers(thing, torch.tensor([5.0]), [torch.zeros(2)])
    assert (float(other.size), other.none, other.wide, other.names, other.count) == (5.0, 0.0, math.inf, ("a",), 3)
    assert other.parts[0].tolist() == [0.0, 0.0]
    assert (thing.size, thing.parts[0].tolist()) == (2.0, [1.0, 1.0])
    assert numbers_of(replace(thing, size=7.0))[2] == structure


@pytest.mark.parametrize(
    "changed",
    [{"none": 1.0}, {"size": 0.0}, {"wide": 1.0}, {"names": ("b",)}, {"count": 4}, {"parts": [torch.ones(3)]}],
)
def test_other_equations_are_another_structure(changed: dict[str, object]) -> None:
    thing = Thing(2.0, 0.0, math.inf, ("a",), [torch.ones(2)], 3)
    assert numbers_of(replace(thing, **changed))[2] != numbers_of(thing)[2]  # type: ignore[arg-type]


def test_what_has_no_numbers_is_refused() -> None:
    with pytest.raises(TypeError, match="object"):
        numbers_of([object()])


def test_bodies_speeds_and_wishes_share_a_structure() -> None:
    structures = {numbers_of(told_of(body_problem(*words)))[2] for words in OTHERS}
    assert len(structures) == 1
    assert numbers_of(told_of(body_problem(*ORDINARY, "costs.steady=0.3", "model.rounds=12")))[2] in structures
    assert numbers_of(told_of(body_problem(*ORDINARY, "costs=effort")))[2] not in structures
    assert numbers_of(told_of(body_problem(*ORDINARY, "limp.amount=0.2")))[2] not in structures


def test_no_equation_reads_the_character() -> None:
    told = told_of(body_problem(*ORDINARY))
    plain, tensors, _ = numbers_of(told)
    own = with_numbers(told, packed(plain, tensors[0]), tensors)
    assert isinstance(told.model.character, Character)
    assert own.model.character is own.model.layout.character is own.model.layout.skeleton is None


# -- the chain --


@pytest.mark.parametrize("words", OTHERS)
def test_kernels_of_another_body_price_this_one(words: tuple[str, ...], traced: list[tuple[str, int]]) -> None:
    plain, compiled = body_problem(*words), with_kernels(*words)
    genes = (plain.start + 0.02 * (unit_genes(plain, 3, 0.3) - unit_genes(plain)[0])).clamp(0.0, 1.0)
    for with_grad in (False, True):
        a, b = plain.evaluate(genes, with_grad), compiled.evaluate(genes, with_grad)
        torch.testing.assert_close(b.merit, a.merit, rtol=1e-9, atol=0.0)
        assert list(a.terms) == list(b.terms)
        for name, value in a.terms.items():
            torch.testing.assert_close(b.terms[name], value, rtol=1e-7, atol=1e-9)
        assert a.status.tolist() == b.status.tolist()
        if with_grad:
            assert a.grad is not None
            assert b.grad is not None
            torch.testing.assert_close(b.grad, a.grad, rtol=1e-6, atol=1e-7 * float(a.grad.abs().max()))
    assert {piece for piece, _ in traced} == set(store.PIECES)


def test_one_candidate_is_priced_as_two_and_many_in_parts(traced: list[tuple[str, int]]) -> None:
    problem = with_kernels(*ORDINARY)
    problem.evaluate(problem.start.unsqueeze(0), with_grad=True)
    counts = {count for _, count in traced}
    assert min(counts) == 2
    assert max(counts) == store.MOST  # of the anchor, which has more
    alone = problem.evaluate(problem.start.unsqueeze(0), with_grad=True)
    assert alone.grad is not None
    assert alone.grad.shape == (1, problem.dimension)


def test_residuals_about_a_point_tell_its_slopes(traced: list[tuple[str, int]]) -> None:
    plain, compiled = body_problem(*ORDINARY), with_kernels(*ORDINARY)
    nudge = 1e-4
    x = (plain.start + 0.01).clamp(0.05, 0.95)
    points = torch.cat((x[None], x + nudge * torch.eye(len(x), dtype=x.dtype)))
    exact = body_problem(*ORDINARY, "model.rounds=30").residuals(points).residuals
    assert exact is not None
    wanted = (exact[1:] - exact[:1]) / nudge
    for problem in (plain, compiled):
        many = problem.residuals_about(torch.cat((points, points)), len(points))
        assert many.residuals is not None
        one, other = many.residuals.chunk(2)
        torch.testing.assert_close(one, other, rtol=1e-6, atol=1e-8)
        if problem is plain:  # kernels have residuals of what is asked for as well, which are 0
            found = (one[1:] - one[:1]) / nudge
            assert float((found - wanted).norm() / wanted.norm()) < 1e-4
        alone = problem.residuals(points).residuals
        assert alone is not None
        torch.testing.assert_close((one**2).sum(-1), (alone**2).sum(-1), rtol=1e-6, atol=0.0)


# -- which --


def test_a_word_says_why_nothing_is_compiled(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(store.CACHE, str(tmp_path / "none"))
    problem = body_problem(*ORDINARY)
    told, values = told_of(problem), problem.table.values(problem.start.unsqueeze(0))
    assert chosen("false", told, values, False) == (None, "")
    assert "compile=true" in chosen("auto", told, values, False).word
    assert "terms of other packages" in chosen("auto", told, values, True).word
    with pytest.raises(HopdiffError, match="compile=true: the cost has terms of other packages"):
        chosen("true", told, values, True)
    with pytest.raises(HopdiffError, match="Unknown compile 'yes'"):
        chosen("yes", told, values, False)
    monkeypatch.setattr(choose_module, "compiler", lambda: None)
    with pytest.raises(HopdiffError, match="C\\+\\+ compiler"):
        chosen("true", told, values, False)
    assert "with a C++ compiler" in chosen("auto", told, values, False).word
    assert not (tmp_path / "none").exists()


def test_kernels_that_cannot_be_loaded_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(store.CACHE, str(tmp_path))
    problem = body_problem(*ORDINARY)
    told, values = told_of(problem), problem.table.values(problem.start.unsqueeze(0))
    folder = store.folder_of(numbers_of(told)[2])
    folder.mkdir()
    for piece in store.PIECES:
        (folder / f"{piece}.pt2").write_bytes(b"broken")
    found = chosen("auto", told, values, False)
    assert found.kernels is None
    assert "cannot be loaded" in found.word
    with pytest.raises(HopdiffError, match=r"compile=true: what is compiled in .* cannot be loaded"):
        chosen("true", told, values, False)


def test_own_terms_are_not_compiled() -> None:
    found = body_problem(*ORDINARY)
    other = BodyProblem(
        found.character,
        found.table,
        found.model,
        found.settings,
        3.5,
        0.2,
        [Term("own", 1.0, lambda r: r.moved)],
        "auto",
    )
    assert "terms of other packages" in other.word
    assert other.kernels is None


def test_other_equations_lie_in_another_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(store.CACHE, str(tmp_path))
    here = store.folder_of("a")
    assert here.parent == tmp_path
    assert store.folder_of("b") != here
    monkeypatch.setattr(store, "equations", lambda: "others")
    assert store.folder_of("a") != here


def test_old_kernels_are_cleared_away_and_nothing_else(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(store.CACHE, str(tmp_path))
    for k in range(store.KEPT + 2):
        folder = tmp_path / f"{k:024x}"
        folder.mkdir()
        (folder / "round.pt2").write_bytes(b"")
    (tmp_path / "mine").mkdir()
    store.tidy()
    assert len(list(tmp_path.iterdir())) == store.KEPT + 1
    assert (tmp_path / "mine").is_dir()


@pytest.mark.thorough
@pytest.mark.skipif(store.compiler() is None, reason="there is no C++ compiler")
def test_a_piece_is_compiled_and_does_what_it_was_traced_from(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("hopdiff.kernels.build.PIECES", ("round",))
    problem = body_problem(*ORDINARY)
    said: list[str] = []
    build(told_of(problem), problem.table.values(problem.start.unsqueeze(0)), tmp_path, said.append)
    assert said == ["compiling kernels, 1 of 1 ..."]
    other = body_problem(*OTHERS[2])
    kernels, anchor = Bound({"round": store.load(tmp_path, "round")}, told_of(other)), other.anchor
    assert anchor is not None
    for count in (1, 2, 5, 70):
        genes = (other.start + 0.05 * (unit_genes(other, count, 0.3) - 0.5)).clamp(0.0, 1.0)
        values = other.table.values(genes)
        state = anchor.near(values)
        movement = other.model.movement(other.table.decode(genes), torch.full((count,), other.speed).to(genes))
        wanted = movement.round(state, anchor.told)
        torch.testing.assert_close(kernels.rounds(values)(state, anchor.told), wanted, rtol=1e-9, atol=1e-11)
    build(told_of(problem), problem.table.values(problem.start.unsqueeze(0)), tmp_path, said.append)
    assert len(said) == 1
