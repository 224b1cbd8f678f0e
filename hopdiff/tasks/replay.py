"""task=replay: make the motion of a genes file again, without a search."""

from __future__ import annotations

import math
from pathlib import Path

from hopdiff.character import Character
from hopdiff.io.genes_file import GenesFile, unit_genes
from hopdiff.io.record import prepare_folder
from hopdiff.tasks.job import Job, make_run
from hopdiff.tasks.results import summary, write_run
from hopdiff.types import HopdiffError, Status


def replay(job: Job, genes_file: GenesFile, original: Character, folder: Path, command: list[str]) -> None:
    """Make, write and describe the run of a genes file.

    original: the body it was found for. On another one, or at another speed, genes may lie outside the range of a
    search there. Raises HopdiffError if the genes do not fit the gene table, are no possible run with these settings,
    or the folder cannot be written.
    """
    here, legs = job.problem.character, (job.problem.character.leg_length, original.leg_length)
    speed = float(genes_file.settings.get("speed", job.problem.speed))
    strange = legs[0] != legs[1] or speed != job.problem.speed
    genes = unit_genes(genes_file, job.table, strange)
    priced = job.problem.evaluate(genes.unsqueeze(0), with_grad=False)
    if not math.isfinite(float(priced.cost)):
        reason = Status(int(priced.status)).sentence
        hint = ""
        # The same Froude number: motions of bodies of different size are alike then.
        if abs((alike := speed * math.sqrt(legs[0] / legs[1])) - job.problem.speed) > 0.01:
            hint = f" Try speed={alike:.2f}, which gives the character {here.name} the Froude number of the original."
        raise HopdiffError(
            f"genes_file {str(genes_file.path)!r} is not a possible run with these settings: {reason}{hint}"
        )
    prepare_folder(folder)
    done = make_run(job, genes)
    write_run(folder, job, done, command)
    if outside := [name for name, value in zip(job.table.names, genes.tolist(), strict=True) if not 0 <= value <= 1]:
        print(f"Outside the range of a search on this body at this speed: {', '.join(outside)}.", flush=True)
    print(summary(folder, job, done), flush=True)
