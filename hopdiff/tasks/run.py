"""task=run: search for a run and write its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tqdm import tqdm

from hopdiff.io.record import prepare_folder
from hopdiff.search.loop import HistoryRow, OnStep, SearchResult
from hopdiff.tasks.job import Job, find, make_run
from hopdiff.tasks.results import summary, write_run


def run(job: Job, folder: Path, command: list[str]) -> bool:
    """Search, write, and print what came out. Returns whether the user broke the search off.

    Raises HopdiffError if the folder cannot be written, before anything is searched, or if no valid candidate
    turned up.
    """
    prepare_folder(folder)
    result = searched(job)
    found = make_run(job, result.best_genes, result)
    write_run(folder, job, found, command)
    print(summary(folder, job, found), flush=True)
    return found.interrupted


def searched(job: Job) -> SearchResult:
    """The search of a job with a progress bar. Raises HopdiffError if no valid candidate turned up."""
    with progress(job.budget.evaluations) as on_step:
        result = find(job, on_step)
    if result.interrupted:
        print("Interrupted: this is the best run so far.", flush=True)
    return result


@contextmanager
def progress(evaluations: int) -> Iterator[OnStep]:
    """A progress bar with the best cost so far; silent when not on a terminal."""
    with tqdm(total=evaluations, unit="eval", disable=None, dynamic_ncols=True) as bar:

        def on_step(row: HistoryRow, result: SearchResult) -> None:
            bar.set_postfix_str(f"best {row.best:.5f}, energy {row.energy:.3f}", refresh=False)
            bar.update(min(round(row.spent), evaluations) - bar.n)

        yield on_step
