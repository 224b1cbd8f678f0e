# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""task=path: a run along a curve on the ground, in a given time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from omegaconf import OmegaConf
from torch import Tensor

from hopdiff import costs
from hopdiff.character import Character
from hopdiff.config import Config, build_job
from hopdiff.effort.metrics import MEASURING_FPS, standing_feet
from hopdiff.effort.problem import BodyProblem
from hopdiff.grounds import build_ground
from hopdiff.io.record import write_table
from hopdiff.io.run_folder import Note, RunFolder
from hopdiff.job import Job, Run, make_run
from hopdiff.messages import plural, say, typed_names
from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.base import STIFFNESS
from hopdiff.models.course import run_along, turning_lean
from hopdiff.motion import Motion
from hopdiff.plots.animation import path_film
from hopdiff.plots.path import oblique_figure, path_figure
from hopdiff.problem import RunProblem
from hopdiff.search.loop import SearchResult
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.notes import notes_of
from hopdiff.tasks.results import (
    Figures,
    caption,
    search_figures,
    shown,
    write_found,
    write_motion,
    write_moving,
    write_numbers,
    write_pictures,
    write_run_events,
)
from hopdiff.tasks.route import PathSettings, Route, plan
from hopdiff.tasks.run import searched
from hopdiff.tasks.uneven import ground_notes, ground_rows, on_ground
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError
from hopdiff.whole_body.course import Course

# Numbers of the straight run that are not those of one along a curve.
OF_STRAIGHT_RUNS = (
    *("flight_residual_bw", "stance_residual_bw", "moment_residual_nm", "momentum_drift", "friction_needed"),
    *("peak_force_bw", "least_force_bw"),
)
OF_LEVEL_RUNS = ("foot_slip", "cop_excess")  # and those of one on level ground
CADENCES = 201  # stride times looked up between the shortest and the longest


@dataclass
class PathTask:
    """path: see `PathSettings`. ground: what feet stand on, see `hopdiff.grounds`."""

    path: PathSettings
    ground: dict[str, Any]


def route_of(settings: Config, asked: PathTask) -> Route:
    """The route that is asked for, checked against what the body can run. Raises HopdiffError, naming the setting."""
    character = Character.build(settings.character)
    return plan(asked.path, character.leg_length, character.name, settings.fps)


def build(call: Call) -> Work:
    """Check path and settings. Raises HopdiffError, naming the setting and the range that is possible."""
    words = typed_names(call.command)
    if "speed" in words:
        raise HopdiffError("speed cannot be set with task=path: path.time and the length of the path give it.")
    if "path.points" in words and "path.file" in words:
        raise HopdiffError("path.points and path.file are both set: give the path by one of them.")
    ground, route = build_ground(call.own.ground), route_of(call.settings, call.own)
    OmegaConf.update(call.config, "speed", route.speed)
    job = build_job(call.config, settings=replace(call.settings, speed=route.speed))
    if (cadence := cadence_gene(job.problem)) in job.settings["genes"]["fixed"]:
        raise HopdiffError(
            f"genes.fixed.{cadence} cannot be set with task=path: whole strides fill path.time by the"
            f" {cadence.replace('_', ' ')}."
        )

    def work(folder: RunFolder) -> None:
        result = searched(job)
        write_found(folder.path, job, result)
        run = path_run(job, route, result, ground)
        folder.interrupted, folder.notes = run.interrupted, [*notes_of(run), *ground_notes(run.metrics)]
        write_path_run(folder.path, job, route, run, folder.command, ground)
        say(path_summary(folder.path, run, folder.notes))

    return work


def path_run(job: Job, route: Route, result: SearchResult, ground: Ground | None = None) -> Run:
    """The run that a search found, led along a route in whole strides. ground: what it is put on, level if None.

    Raises HopdiffError if whole strides do not fit, or a turn is out of a leg's reach.
    """
    genes, strides = whole_strides(job.problem, result.best_genes, route.time)
    run = make_run(job, genes, result)
    with torch.no_grad():
        motion = led_along(job.problem, genes, route, strides, job.fps)
        before = float(stride_times(job.problem, result.best_genes.unsqueeze(0)))
    # The thesis model counts whole frames, so that its strides are stretched by what is left.
    stride = route.time / strides
    made = {"stride_time": stride, "step_frequency": 2.0 / stride, "stride_adjustment": stride / before - 1.0}
    metrics = run.metrics | path_metrics(route, motion, strides) | made
    if isinstance(job.problem, BodyProblem):
        # Feet are measured on frames so dense that differences between them do not tell; what was solved for is the
        # straight run, so that nothing is said of how well physics is kept along the curve.
        dense = led_along(job.problem, genes, route, strides, MEASURING_FPS)
        feet = standing_feet(dense)
        metrics = {name: value for name, value in metrics.items() if name not in OF_STRAIGHT_RUNS} | feet
        metrics["foot_slide_max"] = feet["foot_slip"]
    if ground is not None and not ground.flat:
        raised = on_ground(motion, ground)
        metrics = {name: value for name, value in metrics.items() if name not in OF_LEVEL_RUNS} | raised.numbers
        motion = raised.motion
    return replace(run, motion=motion, metrics=metrics)


def cadence_gene(problem: RunProblem | BodyProblem) -> str:
    """The gene by which strides are made to fill a time."""
    if isinstance(problem, BodyProblem):
        return "step_time"
    return STIFFNESS if STIFFNESS in problem.table.names else "duty_factor"


def stride_times(problem: RunProblem | BodyProblem, genes: Tensor) -> Tensor:
    """(P,) duration of the strides of candidates (P, G) [s]."""
    with torch.no_grad():
        if isinstance(problem, BodyProblem):
            speed = torch.full((len(genes),), problem.speed).to(genes)
            movement = problem.model.movement(problem.table.decode(genes), speed)
            return movement.grid.total * (2.0 if movement.plan.mirrored else 1.0)
        return 2.0 * costs.step_time(problem.trajectory(genes))


def led_along(problem: RunProblem | BodyProblem, genes: Tensor, route: Route, strides: int, fps: float) -> Motion:
    """The motion of a candidate (G,) along a route."""
    if isinstance(problem, BodyProblem):
        lean = turning_lean(route.curve, strides, route.time, route.max_lean)
        return Course(problem.gait(genes.unsqueeze(0)), route.curve, strides, route.time, lean).motion(fps)
    gait = problem.gait(genes.unsqueeze(0))
    return run_along(gait, route.curve, strides, route.time, fps, route.max_lean)


def whole_strides(problem: RunProblem | BodyProblem, genes: Tensor, time: float) -> tuple[Tensor, int]:
    """Genes (G,) of the unit box whose strides fill a time [s], and how many they are.

    Only one gene is changed: of the whole body the step time, else the duty factor (contact stays, flight becomes
    longer or shorter). Of the numbers of strides that are possible the one with the least cost is taken. Raises
    HopdiffError if there is none.
    """
    index = problem.table.names.index(cadence_gene(problem))
    share = torch.linspace(0.0, 1.0, CADENCES).to(genes)
    tried = genes.expand(CADENCES, -1).clone()
    tried[:, index] = share
    lasting = stride_times(problem, tried)
    # The stride shortens as the duty factor grows, and gets longer with the step time.
    if bool(lasting[-1] > lasting[0]):
        share, lasting = share.flip(0), lasting.flip(0)
    shares = share.cpu().double().numpy()[::-1]
    durations = np.maximum.accumulate(np.nan_to_num(lasting.cpu().double().numpy()[::-1]))
    least, most = math.ceil(time / durations[-1]), math.floor(time / durations[0])
    counts = list(range(max(least, 1), most + 1))
    if counts:
        candidates = genes.expand(len(counts), -1).clone()
        wanted = [np.interp(time / count, durations, shares) for count in counts]
        candidates[:, index] = torch.as_tensor(np.array(wanted)).to(genes)
        priced = problem.evaluate(candidates, with_grad=False).cost
        best = int(priced.argmin())
        if bool(torch.isfinite(priced[best])):
            return candidates[best], counts[best]
    raise HopdiffError(
        f"no whole number of strides fits path.time={time:g}: at {problem.speed:.2f} m/s a stride takes"
        f" {durations[0]:.2f} to {durations[-1]:.2f} s; a longer path, or another time or seed, may do."
    )


def path_metrics(route: Route, motion: Motion, strides: int) -> dict[str, Any]:
    """What is known of a run along a path, SI units."""
    arc = torch.linspace(0.0, route.curve.length, 2000, dtype=torch.float64)
    lean = turning_lean(route.curve, strides, route.time, route.max_lean)(arc)
    root = motion.clip.root_position
    found = {
        "path_length": route.curve.length,
        "path_time": route.time,
        "closed": route.curve.closed,
        "strides": strides,
        "min_radius": route.tightest()[0],
        "max_lean_deg": math.degrees(float(lean.abs().max())),
        "foot_slide_max": stance_foot_drift(motion),
        "min_foot_clearance": float(motion.feet[..., 1].min()),
        "frames": motion.clip.frames,
        "frame_time": motion.clip.frame_time,
    }
    if route.curve.closed:
        found["loop_error"] = max(loop_error(motion), float((root[-1] - root[0]).abs().max()))
    return found


def write_path_run(
    folder: Path, job: Job, route: Route, run: Run, command: Sequence[str], ground: Ground | None = None
) -> None:
    """Write everything a run along a path leaves behind. ground: to be drawn, if it is not flat.

    Raises HopdiffError if a file cannot be written.
    """
    motion = run.motion
    write_numbers(folder, job, run)
    write_motion(folder, run)
    arc = route.curve.length * torch.arange(run.clip.frames, dtype=torch.float64) / (run.clip.frames - 1)
    point, heading = route.curve.position(arc), route.curve.heading(arc)
    rows = torch.cat((torch.stack((motion.times.cpu().double(), arc), dim=-1), point, heading[:, None]), dim=-1)
    write_table(folder / "path.csv", ("time", "way", "x", "z", "heading"), rows.tolist())
    pictures = {}
    if job.settings["pictures"]:
        figures: Figures = {
            "path": lambda: path_figure(motion, route.points, point, ground=ground),
            "along": lambda: oblique_figure(motion, curve=point, ground=ground),
        }
        pictures = write_pictures(folder, figures | search_figures(run))
        first, second = caption(run)
        way = f"{route.curve.length:.1f} m in {route.time:g} s: {first}"
        write_moving(folder, job, path_film(motion, point, (way, second), ground))
    write_run_events(folder, run, command, pictures)


def path_summary(folder: Path, run: Run, notes: Sequence[Note] = ()) -> str:
    """The table at the end of a run along a path."""
    m = run.metrics
    rows = [
        ("asked", f"{m['path_length']:.2f} m in {m['path_time']:g} s, so {m['speed']:.2f} m/s, beta {m['beta']:g}"),
        ("reached", f"{plural(m['strides'], 'stride')}, each {100 * m['stride_adjustment']:+.1f} % in time to fit"),
        ("", f"lean up to {m['max_lean_deg']:.1f} deg, planted feet move {1000 * m['foot_slide_max']:.2f} mm at most"),
        (
            "",
            f"contact {m['contact_time']:.3f} s, flight {m['flight_time']:.3f} s, energy {m['energy_rate']:.3f} of"
            f" {m['energy_target']:.3f}",
        ),
        *ground_rows(m),
        ("searched", f"{m['search']}, {plural(m['evaluations'], 'evaluation')}, {m['wall_seconds']:.1f} s"),
        *(("note", note.sentence) for note in notes),
        ("files", shown(folder)),
    ]
    return "\n".join(f"{name:<9} {text}" for name, text in rows)


TASK = Task(build, PathTask, motion=True)
