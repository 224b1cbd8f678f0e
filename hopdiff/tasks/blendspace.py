# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=blendspace: runs of every speed with every beta, written as clips that can be blended."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from omegaconf import DictConfig, OmegaConf
from torch import Tensor, stack

from hopdiff.composing import defaults_of
from hopdiff.config import build_job, check_numbers
from hopdiff.effort.problem import NEAR, BodyProblem
from hopdiff.export.request import Exports
from hopdiff.export.settings import ExportSettings
from hopdiff.export.tables import write_npz
from hopdiff.export.take import Take
from hopdiff.export.write import distinct
from hopdiff.io.record import prepare_folder, write_json
from hopdiff.io.run_folder import RunFolder
from hopdiff.job import Job, check_frames, make_run
from hopdiff.messages import say
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.export import export_takes
from hopdiff.tasks.results import shown, write_motion, write_numbers
from hopdiff.tasks.run import searched
from hopdiff.tasks.turning import check_turn, turning
from hopdiff.types import HopdiffError

RUNS = "runs"  # folder of the runs, inside of that of the task


@dataclass
class GridSettings:
    """speeds [m/s], betas: each speed with each beta is a run. turns [deg/s]: of each run, to the left; 0: straight."""

    speeds: list[float]
    betas: list[float]
    turns: list[float]


@dataclass
class BlendSpaceTask:
    """blendspace: the grid of runs."""

    blendspace: GridSettings


def build(call: Call) -> Work:
    """Check the grid. Raises HopdiffError, naming the setting."""
    grid: GridSettings = call.own.blendspace
    for name in ("speeds", "betas", "turns"):
        values = getattr(grid, name)
        if not values or len(set(values)) < len(values):
            raise HopdiffError(f"blendspace.{name} must be a list of different numbers, not {values}.")
    for speed in grid.speeds:
        for beta in grid.betas:
            check_numbers(replace(call.settings, speed=speed, beta=beta))
        for turn in grid.turns:
            check_turn(speed, turn, "blendspace.turns")
    exports = call.exports
    if not exports.files:
        chosen = ExportSettings(**defaults_of("export", "blendspace"))
        exports = replace(exports, files={"blendspace": chosen})
    # What is wrong with other settings shows in the run of one crossing; beta 0.2 needs no search to be built.
    check_frames(build_job(at(call.config, grid.speeds[0], 0.2)))
    return lambda folder: work(call, grid, exports, folder)


def work(call: Call, grid: GridSettings, exports: Exports, folder: RunFolder) -> None:
    """Search for the runs, each beginning at the best that is known of its neighbours, and write them."""
    takes: list[Take] = []
    genes: dict[tuple[int, int], dict[str, float]] = {}
    places = [(i, k) for i in range(len(grid.speeds)) for k in range(len(grid.betas))]
    for number, (i, k) in enumerate(places, 1):
        speed, beta = sorted(grid.speeds)[i], sorted(grid.betas)[k]
        job = build_job(at(call.config, speed, beta))
        begin_near(job, [genes[near] for near in ((i - 1, k), (i, k - 1)) if near in genes])
        result = searched(job)
        run = make_run(job, result.best_genes, result)
        genes[i, k] = run.genes
        own = folder.path / RUNS / f"v{speed:g}_beta{beta:g}"
        prepare_folder(own)
        write_numbers(own, job, run)
        write_motion(own, run)
        for turn in sorted(grid.turns):
            take = run.take() if turn == 0.0 else turning(job, run, turn)
            takes.append(take)
            if turn != 0.0:
                bent = own.with_name(f"{own.name}_turn{turn:g}")
                prepare_folder(bent)
                write_json(bent / "metrics.json", take.numbers)
                write_npz(bent / "motion.npz", take)
        cost, seconds = run.metrics["cost"], run.metrics["wall_seconds"]
        say(f"{number:>3} of {len(places)}: {speed:g} m/s, beta {beta:g}: cost {cost:.4f}, {seconds:.0f} s")
        if result.interrupted:
            folder.interrupted = True
            break
    export_takes(folder, distinct(takes), exports)
    say(f"{'files':<9} {shown(folder.path)}")


def at(config: DictConfig, speed: float, beta: float) -> DictConfig:
    """The settings of one run of the grid."""
    found = config.copy()
    OmegaConf.update(found, "speed", speed)
    OmegaConf.update(found, "beta", beta)
    return found


def begin_near(job: Job, neighbours: Sequence[dict[str, float]]) -> None:
    """Have the search of a job begin at the run of a neighbour, where that costs less than where it would begin.

    neighbours: their genes by name, in the units of the gene table.
    """
    problem = job.problem
    if not isinstance(problem, BodyProblem) or not neighbours:
        return
    low = job.table.low
    points: list[Tensor] = [
        problem.start,
        *(job.table.to_unit(low.new_tensor(list(genes.values()))).clamp(0.0, 1.0) for genes in neighbours),
    ]
    costs = problem.evaluate(stack(points), with_grad=False).cost.tolist()
    best = min(range(len(points)), key=lambda which: costs[which] if math.isfinite(costs[which]) else math.inf)
    if best > 0 and math.isfinite(costs[best]):
        problem.start, problem.spread = points[best], NEAR


TASK = Task(build, BlendSpaceTask, exports=True)
