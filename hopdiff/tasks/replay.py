"""task=replay: make the motion of a genes file again, without a search."""

from __future__ import annotations

import math
from pathlib import Path

from hopdiff.io.genes_file import GenesFile, unit_genes
from hopdiff.io.record import prepare_folder
from hopdiff.tasks.job import Job, make_run
from hopdiff.tasks.results import summary, write_run
from hopdiff.types import HopdiffError, Status


def replay(job: Job, genes_file: GenesFile, folder: Path, command: list[str]) -> None:
    """Make, write and describe the run of a genes file.

    Raises HopdiffError if the genes do not fit the gene table, are no possible run with these settings, or the
    folder cannot be written.
    """
    genes = unit_genes(genes_file, job.table)
    priced = job.problem.evaluate(genes.unsqueeze(0), with_grad=False)
    if not math.isfinite(float(priced.cost)):
        reason = Status(int(priced.status)).sentence
        raise HopdiffError(f"genes_file {str(genes_file.path)!r} is not a possible run with these settings: {reason}")
    prepare_folder(folder)
    done = make_run(job, genes)
    write_run(folder, job, done, command)
    print(summary(folder, job, done), flush=True)
