# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""task=path: a run along a curve on the ground, in a given time."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hopdiff import costs
from hopdiff.effort.metrics import MEASURING_FPS, standing_feet
from hopdiff.effort.problem import BodyProblem
from hopdiff.genes import FROUDE_RANGE
from hopdiff.geometry.curve import PlaneCurve, curve_through
from hopdiff.io.points import read_points
from hopdiff.io.record import prepare_folder, write_table
from hopdiff.metrics import loop_error, stance_foot_drift
from hopdiff.models.course import run_along, turning_lean
from hopdiff.motion import Motion
from hopdiff.numerics import GRAVITY
from hopdiff.plots.animation import path_film
from hopdiff.plots.path import oblique_figure, path_figure
from hopdiff.problem import RunProblem
from hopdiff.search.loop import SearchResult
from hopdiff.tasks.job import Job, Run, make_run
from hopdiff.tasks.results import (
    Figures,
    caption,
    search_figures,
    shown,
    write_motion,
    write_moving,
    write_numbers,
    write_pictures,
)
from hopdiff.tasks.run import searched
from hopdiff.types import HopdiffError
from hopdiff.whole_body.course import Course

HOLD = 1.0  # of gravity: what a foot on level ground can push sideways
MAX_FRAMES = 100_000
MAX_SAMPLES = 1_000_000  # along a path, in the search for its tightest turn
# Numbers of the straight run that are not those of one along a curve.
OF_STRAIGHT_RUNS = (
    *("flight_residual_bw", "stance_residual_bw", "moment_residual_nm", "momentum_drift", "friction_needed"),
    *("peak_force_bw", "least_force_bw"),
)
CADENCES = 201  # stride times looked up between the shortest and the longest


@dataclass
class PathSettings:
    """points: [[x, z], ...] [m]. file: a CSV or SVG file, which goes before the points. time [s]. closed: None if the
    points shall tell.

    scale: metres a unit of the file. smooth: length of the way over which the curve is averaged [m].
    """

    points: list[Any] = field(default_factory=list)  # of pairs; whole numbers would be refused for floats
    file: str | None = None
    time: float | None = None
    closed: bool | None = None
    scale: float = 1.0
    smooth: float = 0.0
    max_lean_deg: float = 30.0


@dataclass(frozen=True)
class Route:
    """What is asked for. points: (K, 2) as given, x and z [m]. time [s]. max_lean [rad]."""

    points: NDArray[np.float64]
    curve: PlaneCurve
    time: float
    max_lean: float

    @property
    def speed(self) -> float:
        return self.curve.length / self.time

    def tightest(self) -> tuple[float, Tensor]:
        """The least radius of a turn [m] and the place (2,) where it is."""
        count = min(max(1000, math.ceil(self.curve.length / 0.02)), MAX_SAMPLES)
        arc = torch.linspace(0.0, self.curve.length, count + 1, dtype=torch.float64)
        bend = self.curve.curvature(arc).abs()
        # A turn about on the spot has no curvature before or after it, only another heading.
        turn = self.curve.heading(arc).diff().abs() * (count / self.curve.length)
        bend[1:] = torch.maximum(bend[1:], turn)
        worst = int(bend.argmax())
        return 1.0 / max(float(bend[worst]), 1e-9), self.curve.position(arc[worst : worst + 1])[0]


def plan(settings: PathSettings, leg_length: float, body: str, fps: float) -> Route:
    """The route of the settings. leg_length [m] and name of the body bound its speed, fps [frames/s] its time.

    Raises HopdiffError, naming the setting and the range that is possible, for points or a file that make no curve,
    a number out of range, a time for which the body would have to be too fast or too slow, or a turn too sharp.
    """
    if not settings.points and settings.file is None:
        raise HopdiffError("task=path needs either path.points=[[x,z],...] or path.file=FILE.")
    if settings.time is None:
        raise HopdiffError("task=path needs path.time, the seconds from the first point to the last.")
    for name, value, least in (("time", settings.time, 0.0), ("scale", settings.scale, 0.0)):
        if not (math.isfinite(value) and value > least):
            raise HopdiffError(f"path.{name} must be a number above {least:g}, not {value:g}.")
    if not (math.isfinite(settings.smooth) and settings.smooth >= 0):
        raise HopdiffError(f"path.smooth must be a number of 0 or more, not {settings.smooth:g}.")
    if not 0.0 <= settings.max_lean_deg <= 45.0:
        raise HopdiffError(f"path.max_lean_deg must lie between 0 and 45, not {settings.max_lean_deg:g}.")
    points: Any = settings.points if settings.file is None else read_points(Path(settings.file), settings.scale)
    curve = curve_through(points, settings.closed, settings.smooth)
    route = Route(np.asarray(points, dtype=np.float64), curve, settings.time, math.radians(settings.max_lean_deg))
    _check_speed(route, leg_length, body)
    if settings.time * fps > MAX_FRAMES:
        raise HopdiffError(
            f"path.time={settings.time:g} at fps={fps:g} makes more than {MAX_FRAMES} frames: {MAX_FRAMES / fps:.0f} s"
            " are the most."
        )
    return route


def _check_speed(route: Route, leg_length: float, body: str) -> None:
    slowest, fastest = (froude * math.sqrt(GRAVITY * leg_length) for froude in FROUDE_RANGE)
    length, (radius, place) = route.curve.length, route.tightest()
    most = min(fastest, math.sqrt(HOLD * GRAVITY * radius))
    where = f"the path turns with a radius of {radius:.2f} m near [{place[0] + 0.0:.1f}, {place[1] + 0.0:.1f}]"
    if most < slowest:
        raise HopdiffError(
            f"{where}: too sharp at any speed; the character {body} needs {slowest**2 / (HOLD * GRAVITY):.2f} m or more"
            " (path.smooth rounds it, 0.5 over about a metre)."
        )
    # Rounded inwards, so that both ends are allowed.
    times = (
        f"path.time must lie between {math.ceil(10.0 * length / most) / 10.0:g}"
        f" and {math.floor(10.0 * length / slowest) / 10.0:g} s"
    )
    if route.speed > fastest or route.speed < slowest:
        raise HopdiffError(
            f"path.time={route.time:g} asks for {route.speed:.1f} m/s over {length:.1f} m, and the character {body}"
            f" runs at {slowest:.1f} to {fastest:.1f} m/s: {times}."
        )
    if route.speed > most:
        raise HopdiffError(
            f"{where}, where {route.speed:.1f} m/s need {route.speed**2 / (HOLD * GRAVITY):.2f} m: {times}, or the"
            " turn be wider."
        )


def run_path(job: Job, route: Route, folder: Path, command: list[str]) -> bool:
    """Search a run of the route's speed, fit whole strides and lead it along. Returns whether the user broke it off.

    Raises HopdiffError if no valid candidate turned up, whole strides do not fit, or a turn is out of a leg's reach;
    nothing is written then.
    """
    if (cadence := cadence_gene(job.problem)) in job.settings["genes"]["fixed"]:
        raise HopdiffError(
            f"genes.fixed.{cadence} cannot be set with task=path: whole strides fill path.time by the"
            f" {cadence.replace('_', ' ')}."
        )
    prepare_folder(folder)
    run = path_run(job, route, searched(job))
    write_path_run(folder, job, route, run, command)
    print(path_summary(folder, run), flush=True)
    return run.interrupted


def path_run(job: Job, route: Route, result: SearchResult) -> Run:
    """The run that a search found, led along a route in whole strides.

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
    return replace(run, motion=motion, metrics=metrics)


def cadence_gene(problem: RunProblem | BodyProblem) -> str:
    """The gene by which strides are made to fill a time."""
    return "step_time" if isinstance(problem, BodyProblem) else "duty_factor"


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


def write_path_run(folder: Path, job: Job, route: Route, run: Run, command: list[str]) -> None:
    """Write everything a run along a path leaves behind. Raises HopdiffError if a file cannot be written."""
    motion = run.motion
    write_motion(folder, run)
    arc = route.curve.length * torch.arange(run.clip.frames, dtype=torch.float64) / (run.clip.frames - 1)
    point, heading = route.curve.position(arc), route.curve.heading(arc)
    rows = torch.cat((torch.stack((motion.times.cpu().double(), arc), dim=-1), point, heading[:, None]), dim=-1)
    write_table(folder / "path.csv", ("time", "way", "x", "z", "heading"), rows.tolist())
    pictures = {}
    if job.settings["pictures"]:
        figures: Figures = {
            "path": lambda: path_figure(motion, route.points, point),
            "along": lambda: oblique_figure(motion, curve=point),
        }
        pictures = write_pictures(folder, figures | search_figures(run))
        first, second = caption(run)
        way = f"{route.curve.length:.1f} m in {route.time:g} s: {first}"
        write_moving(folder, job, path_film(motion, point, (way, second)))
    write_numbers(folder, job, run, command, pictures)


def path_summary(folder: Path, run: Run) -> str:
    """The table at the end of a run along a path."""
    m = run.metrics
    rows = [
        ("asked", f"{m['path_length']:.2f} m in {m['path_time']:g} s, so {m['speed']:.2f} m/s, beta {m['beta']:g}"),
        ("reached", f"{m['strides']} strides, each {100 * m['stride_adjustment']:+.1f} % in time to fit"),
        ("", f"lean up to {m['max_lean_deg']:.1f} deg, planted feet move {1000 * m['foot_slide_max']:.2f} mm at most"),
        (
            "",
            f"contact {m['contact_time']:.3f} s, flight {m['flight_time']:.3f} s, energy {m['energy_rate']:.3f} of"
            f" {m['energy_target']:.3f}",
        ),
        ("searched", f"{m['search']}, {m['evaluations']} evaluations, {m['wall_seconds']:.1f} s"),
        ("files", shown(folder)),
    ]
    return "\n".join(f"{name:<9} {text}" for name, text in rows)
