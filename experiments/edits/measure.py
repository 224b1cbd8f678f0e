"""What every edit of the study comes to, and how long it takes."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from experiments.edits.cases import Case, grid
from hopdiff.composing import compose
from hopdiff.config import typed
from hopdiff.editing.laplacian import laplacian
from hopdiff.editing.root_path import RootPath, path_of, root_path, steps_of, with_root_path
from hopdiff.editing.solve import SolveSettings
from hopdiff.editing.targets import Constraint, edit_path
from hopdiff.geometry.clip import Clip
from hopdiff.tasks.edit import EditTask
from hopdiff.tasks.edit_job import edit, source_of
from hopdiff.tasks.edit_request import Request

ALPHAS = (0.3, 0.5, math.inf)


def arrivals(paths: dict[str, tuple[RootPath, float]]) -> list[tuple[str, ...]]:
    """Rows by alpha: edits, those that arrive, rounds (median, most), largest errors and move of the start."""
    rows: list[tuple[str, ...]] = []
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


def timings(clip: Clip, frames: Sequence[int], rounds: int) -> list[tuple[str, ...]]:
    """Rows by number of frames: median milliseconds of the path, of a dense pseudo-inverse, in turns, and of the feet's
    clean-up."""
    rows: list[tuple[str, ...]] = []
    frame_time, path = clip.frame_time, root_path(clip)
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
        feet = statistics.median(whole(clip, count)["ms_feet"] for _ in range(rounds if count <= 1000 else 1))
        texts = ("-", "-") if math.isnan(dense) else (f"{dense:.1f}", f"{dense / ours:.1f}")
        rows.append((f"{count:,}", f"{ours:.1f}", *texts, f"{feet:.1f}", f"{feet / ours:.1f}"))
    return rows


def whole(clip: Clip, frames: int) -> dict[str, float]:
    """Numbers of an edit with its clean-up, as the command makes it, of a clip of some number of frames."""
    settings = typed(compose(["task=edit"]), EditTask).edit
    settings.repeat = 1
    request = Request(
        ({"frame": -1, "position": (0.3, 0.0), "heading": math.radians(90.0), "relative": True},), None, None
    )
    metrics: dict[str, float] = edit(
        source_of(long_clip(clip, frames), "", settings, request, None), request, settings
    ).metrics
    return metrics


def long_clip(clip: Clip, frames: int) -> Clip:
    """A clip of some number of frames, its steps repeated."""
    times = math.ceil(frames / (clip.frames - 1))
    again = replace(
        clip,
        root_position=clip.root_position[:-1].repeat(times, 1)[:frames],
        rotations=clip.rotations[:-1].repeat(times, 1, 1, 1)[:frames],
    )
    return with_root_path(again, root_path(again), longer(root_path(clip), frames))


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
