# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=edit: a clip walked or run to where the user wants it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hopdiff.export.tables import read_npz
from hopdiff.geometry.clip import Clip
from hopdiff.grounds import build_ground
from hopdiff.io.bvh import read_bvh
from hopdiff.io.run_folder import Note, RunFolder
from hopdiff.job import make_run
from hopdiff.messages import say
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.edit_job import Edit, edit, source_of
from hopdiff.tasks.edit_join import read_neighbours
from hopdiff.tasks.edit_request import EditSettings, Request, TargetSettings, request_of
from hopdiff.tasks.edit_results import edit_summary, write_edit
from hopdiff.tasks.route import CurveSettings
from hopdiff.tasks.run import searched
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

SAME = 1e-4  # m by which two files of one motion may differ


@dataclass
class EditTask:
    """clip: a BVH file; None makes a run of our own. before, after: BVH files that the clip goes on from and leads to.
    target, constraints, or path: where it shall go. edit: how.
    ground: what feet stand on, see `hopdiff.grounds`."""

    clip: str | None
    before: str | None
    after: str | None
    target: TargetSettings
    constraints: list[Any]
    edit: EditSettings
    path: CurveSettings
    ground: dict[str, Any]


def build(call: Call) -> Work:
    """Read the request and the clip, or check the settings of the run that is made in its place.

    Raises HopdiffError, naming file and line or the setting, for a file that cannot be read or targets that cannot be.
    """
    own = call.own
    own.edit.check()
    request = request_of(own.target, own.constraints, own.path)
    ground = build_ground(own.ground)
    if own.clip is not None:
        file = read_bvh(own.clip, own.edit.unit, own.edit.up)
        clip = file.clip()
        source = source_of(clip, Path(own.clip).name, own.edit, request, file, contact_beside(Path(own.clip), clip))
        neighbours = read_neighbours(own.before, own.after, file, Path(own.clip).name)
        done = edit(source, request, own.edit, ground, neighbours)
        return lambda folder: write(folder, done, request, call, ground)
    if own.before is not None or own.after is not None:
        raise HopdiffError("before and after need clip=FILE, a BVH file of their skeleton.")
    job = call.job()

    def work(folder: RunFolder) -> None:
        result = searched(job)
        run = make_run(job, result.best_genes, result)
        folder.interrupted = run.interrupted
        name = f"run_v{run.metrics['speed']:g}_beta{run.metrics['beta']:g}"
        made = source_of(run.clip, name, own.edit, request, None, run.motion.contact.cpu())
        write(folder, edit(made, request, own.edit, ground), request, call, ground)

    return work


def contact_beside(path: Path, clip: Clip) -> Tensor | None:
    """(T, 2) when the feet of a clip are on the ground, if the file of a run that hopdiff made lies beside it and holds
    the same motion."""
    file = path.parent / "motion.npz"
    if not file.is_file():
        return None
    try:
        take = read_npz(file)
    except HopdiffError:
        return None
    same = take.clip.skeleton.names == clip.skeleton.names and take.frames == clip.frames
    near = same and torch.allclose(take.clip.root_position.double(), clip.root_position.double(), atol=SAME)
    return take.contact if near else None


def write(folder: RunFolder, done: Edit, request: Request, call: Call, ground: Ground) -> None:
    """Write and describe an edit. Raises HopdiffError if a file cannot be written."""
    folder.notes = [Note("edit", warning) for warning in done.warnings]
    write_edit(folder.path, done, request, call.plain, ground)
    say(edit_summary(folder.path, done))


TASK = Task(build, EditTask, motion=True)
