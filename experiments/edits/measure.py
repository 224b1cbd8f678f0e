"""What every edit of the study comes to, and how long it takes."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from experiments.edits.cases import NAMED, Case, grid
from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.leg_joints import facing, find_legs
from hopdiff.editing.measure import path_measures
from hopdiff.editing.root_path import RootPath, path_of, root_path, steps_of, with_root_path
from hopdiff.editing.solve import SolveSettings
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.feet.contacts import find_contacts, slide_numbers
from hopdiff.feet.planting import clean_feet
from hopdiff.geometry.clip import Clip

ALPHAS = (0.3, 0.5, math.inf)


def arrivals(paths: dict[str, tuple[RootPath, float]]) -> list[tuple[str, ...]]:
    """Rows by alpha: edits, those that arrive, rounds (median, most), largest errors and move of the start."""
    rows = []
    for alpha in ALPHAS:
        found = [
            (edit_path(path, [case.constraint(path)], frame_time, SolveSettings(alpha=alpha)), path)
            for path, frame_time in paths.values()
            for case in grid()
        ]
        edits = [edited for edited, _ in found]
        start = max(float((edited.path.place[0] - path.place[0]).norm()) for edited, path in found)
        rounds = [edited.rounds for edited in edits]
        rows.append(
            (
                f"{alpha:g}",
                str(len(edits)),
                str(sum(edited.converged for edited in edits)),
                f"{statistics.median(rounds):g}",
                str(max(rounds)),
                f"{1000 * max(edited.error_place for edited in edits):.4f}",
                f"{math.degrees(max(edited.error_yaw for edited in edits)):.5f}",
                f"{1000 * start:.4f}",
            )
        )
    return rows


def qualities(clips: dict[str, Clip]) -> list[tuple[str, ...]]:
    """Rows by clip and case: stretch, side-slip, turns, and slide, drift and depth of the feet by stage."""
    rows = []
    for name, clip in clips.items():
        legs = find_legs(clip.skeleton)
        path = root_path(clip, facing(clip.skeleton, legs))
        contacts = find_contacts(clip, legs)
        source = slide_numbers(clip, contacts)
        for case in NAMED:
            edited = edit_path(path, [case.constraint(path)], clip.frame_time).path
            moved = with_root_path(clip, path, edited)
            clean = clean_feet(clip, moved, contacts).clip
            m = path_measures(path, edited, clip.frame_time)
            before, after = slide_numbers(moved, contacts), slide_numbers(clean, contacts)
            rows.append(
                (
                    name,
                    case.name,
                    f"{m['stretch']:.2f}",
                    f"{m['side_slip_p95_deg']:.1f}",
                    f"{m['turn_max_deg']:.1f}",
                    " / ".join(f"{n['slide_speed']:.3f}" for n in (source, before, after)),
                    " / ".join(f"{100 * n['drift']:.1f}" for n in (source, before, after)),
                    " / ".join(f"{1000 * n['foot_depth']:.0f}" for n in (source, after)),
                    f"{fastest(clean) / fastest(clip):.2f}",
                )
            )
    return rows


def fastest(clip: Clip) -> float:
    """Largest angular speed of any joint [rad/s]."""
    between = clip.rotations[:-1].transpose(-1, -2) @ clip.rotations[1:]
    cosine = 0.5 * (between.diagonal(dim1=-2, dim2=-1).sum(-1) - 1.0)
    return float(torch.acos(cosine.clamp(-1.0, 1.0)).max()) / clip.frame_time


def timings(path: RootPath, frame_time: float, frames: Sequence[int], rounds: int) -> list[tuple[str, ...]]:
    """Rows by number of frames: median milliseconds of ours and of a dense pseudo-inverse, in turns."""
    rows = []
    for count in frames:
        long = longer(path, count)
        wish = Case("", 0.3, 0.0, 90.0).constraint(long)
        # Beyond some thousand frames a dense matrix takes minutes and gigabytes.
        calls: dict[str, Callable[[], object]] = {"ours": lambda p=long, w=wish: edit_path(p, [w], frame_time)}  # type: ignore[misc]
        if count <= 3000:
            calls["dense"] = lambda p=long, w=wish: dense_edit(p, w)  # type: ignore[misc]
        taken: dict[str, list[float]] = {name: [] for name in calls}
        for _ in range(rounds if count <= 1000 else 1 if count <= 3000 else 3):
            for name, call in calls.items():
                begun = time.perf_counter()
                call()
                taken[name].append(time.perf_counter() - begun)
        ours = 1e3 * statistics.median(taken["ours"])
        dense = 1e3 * statistics.median(taken["dense"]) if "dense" in taken else math.nan
        ratio = "-" if math.isnan(dense) else f"{dense / ours:.1f}"
        rows.append((f"{count:,}", f"{ours:.1f}", "-" if math.isnan(dense) else f"{dense:.1f}", ratio))
    return rows


def longer(path: RootPath, frames: int) -> RootPath:
    """A path of some number of frames, its steps repeated."""
    steps = steps_of(path)
    return path_of(steps.repeat(math.ceil(frames / len(steps)), 1)[: frames - 1], path.place[0], path.yaw[0])


def dense_edit(path: RootPath, wish: Constraint, alpha: float = 0.3, epsilon: float = 0.01) -> Tensor:
    """Kim & Lee (2021), Algorithm 1, written plainly: a dense pseudo-inverse, and the constraint on the last step moved
    by what lacks at the end."""
    steps = steps_of(path)
    count = len(steps)
    full = torch.eye(count, dtype=torch.float64) - 0.5 * (
        torch.diag(torch.ones(count - 1, dtype=torch.float64), 1)
        + torch.diag(torch.ones(count - 1, dtype=torch.float64), -1)
    )
    full[0, 1] = full[-1, -2] = -1.0
    first, last = torch.zeros(1, count, dtype=torch.float64), torch.zeros(1, count, dtype=torch.float64)
    first[0, 0] = last[0, -1] = 1.0
    matrix = torch.cat((full, first, last))
    delta = laplacian(steps)
    target = torch.tensor((*(wish.place or (0.0, 0.0)), wish.yaw or 0.0), dtype=torch.float64)
    inverse = torch.linalg.pinv(matrix)
    bound, solved = steps[-1].clone(), steps
    for _ in range(20):
        ends = path_of(solved, path.place[0], path.yaw[0])
        error = target - torch.cat((ends.place[-1], ends.yaw[-1:]))
        size = float(error.abs().max())
        if size <= epsilon:
            break
        # The last step carries the whole ramp of the change, half of it on average.
        bound = bound + min(1.0, alpha / size) * error * 2.0 / count
        solved = inverse @ torch.cat((delta, steps[:1], bound.unsqueeze(0)))
    return solved
