"""The problems of this study: bodies, speeds and brisknesses, each with the objective of its model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from time import process_time
from typing import NamedTuple

import torch
from filelock import FileLock
from torch import Tensor

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort.problem import BodyProblem
from hopdiff.effort.terms import ORDINARY_BETA
from hopdiff.io.files import read_json
from hopdiff.io.record import write_json
from hopdiff.job import Job
from hopdiff.problem import RunProblem

# What chooses a model and its objective, on the command line of hopdiff.
MODELS: dict[str, tuple[str, ...]] = {
    "body": ("model=body",),
    "smooth": ("model=smooth",),
    "thesis": ("model=thesis", "costs=thesis"),
}
BODIES = {"body": ("human", "child", "cartoon"), "smooth": ("human", "child", "cartoon"), "thesis": ("human",)}
SPEEDS = (2.5, 3.5, 5.0, 6.5)  # m/s; with the beta below they hold figure 5.7 of the thesis, 5 m/s and beta .5
BETAS = (0.2, 0.35, 0.5, 0.7)
BATCHES = (1, 3, 8, 16, 64)

AnyProblem = BodyProblem | RunProblem


class Case(NamedTuple):
    """One problem. model: a key of MODELS; speed: m/s; character: a file of conf/character."""

    model: str
    speed: float
    beta: float
    character: str = "human"

    def __str__(self) -> str:
        return f"{self.model}, {self.character}, {self.speed:g} m/s, beta {self.beta:g}"

    @property
    def label(self) -> str:
        """Of its files."""
        return f"{self.model}_{self.character}_v{self.speed:g}_b{self.beta:g}"


def grid(model: str, characters: Sequence[str], speeds: Sequence[float], betas: Sequence[float]) -> list[Case]:
    """All cases of a model. characters: none for those that suit it."""
    bodies = characters or BODIES[model]
    return [Case(model, speed, beta, body) for body in bodies for speed in speeds for beta in betas]


def settings(case: Case, folder: Path | None = None) -> list[str]:
    """The command line of a case. folder: where its run of least cost is kept; None: it is searched for if needed."""
    asked = [*MODELS[case.model], f"character={case.character}", f"speed={case.speed}", f"beta={case.beta}"]
    if case.model != "body" or case.beta == ORDINARY_BETA or folder is None:
        return asked
    return [*asked, *(f"costs.least.{name}={value!r}" for name, value in least(case, folder).items())]


def least(case: Case, folder: Path) -> dict[str, float]:
    """Numbers of the run of least cost that the energy of model=body is told in.

    The same for every search, seed and briskness: it is searched for once a body and speed, as hopdiff itself does, and
    kept in the folder. Nobody is charged for it, and nobody begins there.
    """
    path = folder / f"least_{case.character}_v{case.speed:g}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(path.with_suffix(".lock")):
        if not path.is_file():
            problem = build_job(compose(settings(case))).problem
            assert isinstance(problem, BodyProblem)
            assert problem.least is not None
            found = problem.least
            write_json(path, {"external_work": found.external_work, "contact_time": found.contact_time})
    numbers: dict[str, float] = read_json(path)
    return numbers


def build(case: Case, folder: Path | None = None, more: Sequence[str] = ()) -> Job:
    """Problem and search of a case. more: settings besides, such as search=ga."""
    return build_job(compose([*settings(case, folder), *more]))


def build_problem(case: Case, folder: Path | None = None, more: Sequence[str] = ()) -> AnyProblem:
    return build(case, folder, more).problem


def random_genes(problem: AnyProblem, rows: int, seed: int = 0) -> Tensor:
    """(rows, G), uniform in the box."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(rows, problem.dimension, generator=generator, dtype=torch.float64).to(problem.dtype)


def gradient_prices(problem: AnyProblem, repeats: int) -> list[tuple[int, float, float]]:
    """(batch, seconds a batch without, with gradient), the least of `repeats` each, for random candidates."""

    def seconds(genes: Tensor, with_grad: bool) -> float:
        start = process_time()
        problem.evaluate(genes, with_grad)
        return process_time() - start

    timed = []
    for batch in BATCHES:
        genes = random_genes(problem, batch)
        without, with_grad = (min(seconds(genes, flag) for _ in range(repeats)) for flag in (False, True))
        timed.append((batch, without, with_grad))
    return timed


def typical_cost(problem: AnyProblem, count: int = 256) -> tuple[float, float]:
    """Median cost of uniform candidates that are possible runs (NaN if none is), and the share of all that are."""
    cost = problem.evaluate(random_genes(problem, count), False).cost
    valid = cost[cost.isfinite()]
    return float(valid.median()) if len(valid) else float("nan"), len(valid) / count


def objective(problem: AnyProblem) -> list[tuple[str, float, str]]:
    """(term, weight, what it puts in) of all that the cost is made of."""
    return [(term.name, term.weight, term.put_in) for term in problem.terms]
