"""What a task works on, and what comes out of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from hopdiff.effort.metrics import body_metrics
from hopdiff.effort.problem import BodyProblem
from hopdiff.export.take import Segments, Take
from hopdiff.genes import GeneTable
from hopdiff.geometry.clip import Clip
from hopdiff.kernels.choose import ON
from hopdiff.metrics import run_metrics
from hopdiff.models.gait import LEAST_FRAMES, enough_fps
from hopdiff.motion import Motion
from hopdiff.problem import RunProblem
from hopdiff.search.base import Search
from hopdiff.search.loop import Budget, HistoryRow, OnStep, SearchResult, run_search
from hopdiff.types import HopdiffError
from hopdiff.whole_body.layout import JOINT_OF, SEGMENTS


@dataclass(frozen=True)
class Job:
    """Everything a run is made from, built and checked.

    fps: wanted frames a second. threads: of PyTorch. settings: the whole resolved configuration as plain data.
    saved: the part of it that belongs into the genes file, so that a replay needs nothing else.
    """

    problem: RunProblem | BodyProblem
    table: GeneTable
    search: Search
    budget: Budget
    seed: int
    fps: float
    threads: int
    settings: dict[str, Any]
    saved: dict[str, Any]

    @property
    def word(self) -> str:
        """Why evaluations are not compiled, where they could have been; nothing otherwise."""
        if isinstance(self.problem, BodyProblem):
            return self.problem.word
        return f"compile={ON}: only model=body is compiled." if str(self.settings["compile"]).lower() == ON else ""


@dataclass(frozen=True)
class Run:
    """A run that was found or replayed.

    genes: value by name, in the units of the gene table. metrics: what metrics.json holds, SI units. masses: of the
    eleven segments of the character by joint [kg]; segments: those that the motion moves. history: one row a step of
    the search, none for a replay. interrupted: whether the user broke the search off.
    """

    motion: Motion
    genes: dict[str, float]
    metrics: dict[str, Any]
    masses: dict[str, float]
    segments: Segments
    history: list[HistoryRow] = field(default_factory=list)
    interrupted: bool = False

    @property
    def clip(self) -> Clip:
        return self.motion.clip

    def take(self) -> Take:
        """The run as other programs are given it."""
        return Take.of_motion(run_name(self.metrics), self.motion, self.masses, self.metrics, self.segments)


def run_name(metrics: Mapping[str, Any]) -> str:
    """What a run is called in other programs: run_v5_beta0.7."""
    return f"run_v{metrics['speed']:.3g}_beta{metrics['beta']:g}"


def search_run(job: Job, on_step: OnStep | None = None) -> Run:
    """Search for the best run and make it.

    on_step: called after every step of the search. Raises HopdiffError if no valid candidate turned up.
    """
    result = find(job, on_step)
    return make_run(job, result.best_genes, result)


def find(job: Job, on_step: OnStep | None = None) -> SearchResult:
    """The search alone."""
    return run_search(job.problem, job.search, job.budget, torch.Generator().manual_seed(job.seed), on_step)


def make_run(job: Job, genes: Tensor, result: SearchResult | None = None) -> Run:
    """Make the run of one candidate. genes: (G,) in the unit box; result: the search that found it, if any."""
    motion = job.problem.motion(genes, job.fps)
    values = job.table.to_physical(genes).tolist()
    body = job.problem.character
    return Run(
        motion=motion,
        genes=dict(zip(job.table.names, values, strict=True)),
        metrics={**metrics_of(job.problem, genes), **_provenance(job, motion, result)},
        masses=dict(zip(body.skeleton.names, body.masses.tolist(), strict=True)),
        segments=segments_of(job.problem),
        history=result.history if result else [],
        interrupted=result.interrupted if result else False,
    )


def metrics_of(problem: RunProblem | BodyProblem, genes: Tensor) -> dict[str, float]:
    """The numbers of one candidate (G,) of the unit box."""
    return body_metrics(problem, genes) if isinstance(problem, BodyProblem) else run_metrics(problem, genes)


def segments_of(problem: RunProblem | BodyProblem) -> Segments:
    """The rigid segments that the motion's joints carry."""
    if isinstance(problem, BodyProblem):
        layout = problem.model.layout
        names = tuple(JOINT_OF[segment] for segment in SEGMENTS)
        return Segments(names, layout.masses, layout.centres, layout.inertias, layout.heel)
    body = problem.character
    moments = body.masses.unsqueeze(-1) * body.gyrations**2
    return Segments(body.skeleton.names, body.masses, body.coms, moments, None)


def _provenance(job: Job, motion: Motion, result: SearchResult | None) -> dict[str, Any]:
    """The part of the metrics that says how the run was come by."""
    return {
        "evaluations": result.evaluations if result else 0,
        "gradient_evaluations": result.gradient_evaluations if result else 0,
        "invalid_fraction": result.invalid_fraction if result else 0.0,
        "wall_seconds": result.seconds if result else 0.0,
        "stopped": result.stopped if result else "",
        "compiled": isinstance(job.problem, BodyProblem) and job.problem.kernels is not None,
        "search": job.search.name if result else "none",
        "model": job.settings["model"]["name"],
        "costs": job.settings["costs"]["name"],
        "character": _body_choice(job.settings["character"]),
        "genes": _gene_choice(job.settings["genes"]),
        "seed": job.seed,
        "frames": motion.clip.frames,
        "frame_time": motion.clip.frame_time,
    }


def _body_choice(settings: Mapping[str, Any]) -> str:
    """The character and how it is changed, in one word: "human+legs=1.2"."""
    changed = [f"{part}={factor:g}" for part, factor in settings["proportions"].items() if factor != 1.0]
    return "+".join([settings["name"], *changed])


def _gene_choice(settings: Mapping[str, Any]) -> str:
    """The gene table and how it departs from its plain use, in one word: "default+common_eta+step_width=0.1"."""
    common = ["common_eta"] if settings["common_eta"] else []
    fixed = [f"{name}={value:g}" for name, value in sorted(settings["fixed"].items())]
    return "+".join([settings["name"], *common, *fixed])


def check_frames(job: Job) -> None:
    """Raises HopdiffError if `fps` is too low for the shortest stride that a search of this job may find."""
    shortest = job.problem.shortest_stride
    if round(shortest * job.fps) < LEAST_FRAMES:
        raise HopdiffError(
            f"fps={job.fps:g} is too low: at this speed a stride may take {shortest:.3f} s, which needs"
            f" {enough_fps(shortest)} frames/s or more."
        )


@contextmanager
def threads(count: int) -> Iterator[None]:
    """PyTorch with that many threads, and with as many as before afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
