"""task=edit: a clip walked or run to where the user wants it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hopdiff.io.bvh import read_bvh
from hopdiff.io.record import prepare_folder
from hopdiff.tasks.edit_job import edit, source_of
from hopdiff.tasks.edit_request import EditSettings, Request
from hopdiff.tasks.edit_results import edit_summary, write_edit
from hopdiff.tasks.job import Job, make_run
from hopdiff.tasks.run import searched


def run_edit(
    clip: str | Job,
    request: Request,
    how: EditSettings,
    settings: Mapping[str, Any],
    folder: Path,
    command: list[str],
) -> bool:
    """Edit a clip, write and describe it. Returns whether the user broke off the search for a run.

    clip: a BVH file, or the job of a run that is searched for first. settings: the whole configuration as plain data.
    Raises HopdiffError, naming file and line or the setting, for a file that cannot be read, targets that cannot be,
    or a folder that cannot be written; nothing is written then.
    """
    interrupted = False
    if isinstance(clip, Job):
        prepare_folder(folder)
        result = searched(clip)
        run = make_run(clip, result.best_genes, result)
        interrupted = run.interrupted
        name = f"run_v{run.metrics['speed']:g}_beta{run.metrics['beta']:g}"
        source = source_of(run.clip, name, how, request, None)
    else:
        file = read_bvh(clip, how.unit, how.up)
        source = source_of(file.clip(), Path(clip).name, how, request, file)
        prepare_folder(folder)
    done = edit(source, request, how)
    write_edit(folder, done, request, settings, command)
    print(edit_summary(folder, done), flush=True)
    return interrupted
