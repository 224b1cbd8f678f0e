"""task=run: search for a run and write its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from hopdiff.io.run_folder import RunFolder
from hopdiff.job import Job, check_frames, find, make_run
from hopdiff.messages import say
from hopdiff.search.loop import HistoryRow, OnStep, SearchResult
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.notes import notes_of
from hopdiff.tasks.results import summary, write_found, write_run


def build(call: Call) -> Work:
    """Check the settings of a run. Raises HopdiffError, naming the setting."""
    job = call.job()
    check_frames(job)

    def work(folder: RunFolder) -> None:
        result = searched(job)
        # First of all what the search has found: everything else can be made again from it.
        write_found(folder.path, job, result)
        found = make_run(job, result.best_genes, result)
        folder.interrupted, folder.notes = found.interrupted, notes_of(found)
        write_run(folder.path, job, found, folder.command)
        say(summary(folder.path, job, found, folder.notes))

    return work


def searched(job: Job) -> SearchResult:
    """The search of a job with a progress bar. Raises HopdiffError if no valid candidate turned up."""
    if job.word:
        say(job.word)
    with progress(job.budget.evaluations) as on_step:
        result = find(job, on_step)
    if result.interrupted:
        say("Interrupted: this is the best run so far.")
    return result


@contextmanager
def progress(evaluations: int) -> Iterator[OnStep]:
    """A progress bar with the best cost so far; silent when not on a terminal."""
    with tqdm(total=evaluations, unit="eval", disable=None, dynamic_ncols=True) as bar:

        def on_step(row: HistoryRow, result: SearchResult) -> None:
            bar.set_postfix_str(f"best {row.best:.5f}, energy {row.energy:.3f}", refresh=False)
            bar.update(min(round(row.spent), evaluations) - bar.n)

        yield on_step


TASK = Task(build, motion=True)
