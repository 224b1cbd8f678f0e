"""What an edit asks for: frames with a place, a yaw, or both; and the edit itself."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.editing.course import course_of
from hopdiff.editing.root_path import RootPath, steps_of
from hopdiff.editing.solve import PathSolver, SolveSettings, Targets
from hopdiff.types import HopdiffError

TURNS = ("nearest", "left", "right")
FEWEST_FRAMES = 3
MOST_PACE = 2.5  # times the speed of the clip that is asked for at most
WALKED, RUN = 2.0, 12.0  # m/s that anybody can walk, and that nobody exceeds
SLACK = 0.3  # m that a body may be moved without a step
SPIN, BLINK = 8.0, 0.1  # rad/s that anybody turns by in s
DEARER = (5.0, 25.0, 125.0)  # times the weight of turns with which an edit is tried again that asks for more
AGREE = 1e-6  # m and rad within which two constraints on one frame say the same


@dataclass(frozen=True)
class Constraint:
    """frame: counted from 0. place: x and z [m], None where free. yaw: from +z towards +x [rad], None where free.

    keep: the yaw of the clip itself, in place of `yaw`.
    """

    frame: int
    place: tuple[float, float] | None = None
    yaw: float | None = None
    keep: bool = False


@dataclass(frozen=True, eq=False)
class EditedPath:
    """path: as asked, of as many frames as the source. rounds: until the error fell below epsilon.

    error_place [m], error_yaw [rad]: largest that is left. converged: whether they are below epsilon.
    milliseconds: by what took them. rise: (T,) by how much frames are raised [m], None where none is.
    """

    path: RootPath
    rounds: int
    error_place: float
    error_yaw: float
    converged: bool
    milliseconds: dict[str, float]
    rise: Tensor | None = None


def edit_path(
    path: RootPath,
    constraints: Sequence[Constraint],
    frame_time: float,
    settings: SolveSettings | None = None,
    turn: str = "nearest",
    guess: RootPath | None = None,
) -> EditedPath:
    """The path that meets the constraints and is otherwise as like the given one as can be.

    A yaw means every yaw a whole turn away; `turn` says which is taken: the nearest to that of the clip, turned as the
    constraint before it turned the clip, or the next to the left or right of that. If all constraints keep the clip's
    yaw, no frame turns. guess: a path near the solution, from which it is sought; many far turns need one.
    Raises HopdiffError for too few frames, no constraint, a frame outside the clip, numbers that are not finite, or
    two constraints on one frame that contradict.
    """
    begun = time.perf_counter()
    targets = targets_of(path, constraints, turn)
    # Steps are weighed along and across the way, whichever way the body faces.
    course = course_of(path, frame_time)
    targets = replace(targets, yaw=targets.yaw + course[targets.frames], start_yaw=targets.start_yaw + course[:1])
    settings = settings or SolveSettings()
    solver = PathSolver(RootPath(path.place, path.yaw + course), frame_time, settings)
    ready = time.perf_counter()
    with torch.no_grad():
        near = None if guess is None else steps_of(RootPath(guess.place, guess.yaw + course)).unsqueeze(0)
        found = solver.solve(targets, near)
        most = max(SPIN, spin(solver.source.yaw, frame_time))
        for dearer in DEARER if guess is None else ():
            whirl = spin(found.path.yaw[0], frame_time)
            if whirl <= most:
                break
            # A body that has next to no way left to go would rather whirl than slow down.
            other = PathSolver(solver.source, frame_time, replace(settings, turn=dearer * settings.turn)).solve(targets)
            if bool(other.converged[0]) and spin(other.path.yaw[0], frame_time) < whirl:
                found = other
    done = time.perf_counter()
    return EditedPath(
        RootPath(found.path.place[0], found.path.yaw[0] - course),
        int(found.rounds[0]),
        float(found.error_place[0]),
        float(found.error_yaw[0]),
        bool(found.converged[0]),
        {"set_up": 1e3 * (ready - begun), "solve": 1e3 * (done - ready)},
    )


def spin(yaw: Tensor, frame_time: float) -> float:
    """How fast a body turns at most, over BLINK, its yaws being (T,) [rad] [rad/s]."""
    apart = max(1, min(len(yaw) - 1, round(BLINK / frame_time)))
    return float((yaw[apart:] - yaw[:-apart]).abs().max()) / (apart * frame_time)


def check_reach(path: RootPath, constraints: Sequence[Constraint], frame_time: float) -> None:
    """Raises HopdiffError, with the way that is possible, for bound frames that nobody could get to in their time.

    That is faster than MOST_PACE times the fastest second of the clip, or what anybody walks, and never faster than
    anybody runs.
    """
    count = min(path.frames - 1, max(1, round(1.0 / frame_time)))
    steps = path.place.diff(dim=0).norm(dim=-1)
    walked = torch.cat((torch.zeros_like(steps[:1]), steps.cumsum(0)))
    pace = float((walked[count:] - walked[:-count]).max()) / (count * frame_time)
    pace = min(max(MOST_PACE * pace, WALKED), RUN)
    before, place = 0, path.place[0]
    for one in sorted((c for c in constraints if c.place is not None), key=lambda c: c.frame):
        here = torch.tensor(one.place, dtype=path.place.dtype)
        if one.frame > before:
            gap, most = float((here - place).norm()), pace * (one.frame - before) * frame_time + SLACK
            if gap > most:
                raise HopdiffError(
                    f"frame {one.frame} cannot be at [{here[0]:g}, {here[1]:g}]: that is {gap:.1f} m from where frame"
                    f" {before} is, and in {(one.frame - before) * frame_time:.2f} s this clip can get {most:.1f} m far"
                    f" at most."
                )
        before, place = one.frame, here


def targets_of(path: RootPath, constraints: Sequence[Constraint], turn: str = "nearest") -> Targets:
    """The targets of one edit (B = 1) of a path. Raises HopdiffError, see `edit_path`."""
    if path.frames < FEWEST_FRAMES:
        raise HopdiffError(f"an edit needs a clip of at least {FEWEST_FRAMES} frames, not {path.frames}.")
    if turn not in TURNS:
        raise HopdiffError(f"the turn must be one of {', '.join(TURNS)}, not {turn!r}.")
    if not constraints:
        raise HopdiffError("an edit needs at least one frame with a place or a heading.")
    frames = _merged(path, constraints)
    turning = any(c.yaw is not None or not c.keep for c in frames.values())
    yaws = _whole_turns(path, frames, turn)
    start = frames.pop(0, Constraint(0))
    start_place = path.place[0] if start.place is None else torch.tensor(start.place, dtype=torch.float64)
    if not frames:
        # The start alone moves: the rest goes along as it is.
        frames[path.frames - 1] = Constraint(path.frames - 1)
    order = sorted(frames)
    places = [frames[k].place or (0.0, 0.0) for k in order]
    return Targets(
        frames=torch.tensor(order),
        place=torch.tensor([places], dtype=torch.float64),
        yaw=torch.tensor([[yaws.get(k, 0.0) for k in order]], dtype=torch.float64),
        has_place=torch.tensor([frames[k].place is not None for k in order]),
        has_yaw=torch.tensor([turning and k in yaws for k in order]),
        start_place=start_place.unsqueeze(0),
        start_yaw=torch.tensor([yaws.get(0, float(path.yaw[0]))], dtype=torch.float64),
        turning=turning,
    )


def _merged(path: RootPath, constraints: Sequence[Constraint]) -> dict[int, Constraint]:
    """One constraint a frame."""
    found: dict[int, Constraint] = {}
    for one in constraints:
        if not 0 <= one.frame < path.frames:
            raise HopdiffError(f"frame {one.frame} lies outside the clip, whose frames are 0 to {path.frames - 1}.")
        for number in (*(one.place or ()), *(() if one.yaw is None else (one.yaw,))):
            if not math.isfinite(number):
                raise HopdiffError(f"frame {one.frame}: place and heading must be finite numbers, not {number:g}.")
        other = found.get(one.frame, one)
        if one.place and other.place and math.dist(one.place, other.place) > AGREE:
            raise HopdiffError(f"frame {one.frame} shall be at {list(other.place)} and at {list(one.place)}.")
        yaw, other_yaw = (float(path.yaw[c.frame]) if c.keep else c.yaw for c in (one, other))
        if yaw is not None and other_yaw is not None and abs(math.remainder(yaw - other_yaw, math.tau)) > AGREE:
            raise HopdiffError(
                f"frame {one.frame} shall face {math.degrees(other_yaw):g} and {math.degrees(yaw):g} degrees."
            )
        found[one.frame] = Constraint(
            one.frame,
            other.place if one.place is None else one.place,
            other.yaw if one.yaw is None else one.yaw,
            one.keep or other.keep,
        )
    return found


def _whole_turns(path: RootPath, constraints: dict[int, Constraint], turn: str) -> dict[int, float]:
    """The wanted yaws by frame on the branches that are asked for [rad]."""
    found, change = {}, 0.0
    for frame in sorted(constraints):
        one, own = constraints[frame], float(path.yaw[frame])
        if one.yaw is None and not one.keep:
            continue
        more = math.remainder((own if one.yaw is None else one.yaw) - own - change, math.tau)
        if turn == "left" and more < -AGREE:
            more += math.tau
        if turn == "right" and more > AGREE:
            more -= math.tau
        change += more
        found[frame] = own + change
    return found
