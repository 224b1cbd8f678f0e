# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=replay: make the motion of a genes file again, without a search."""

import math
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig
from torch import Tensor

from hopdiff.character import Character
from hopdiff.config import build_job, checked, with_saved
from hopdiff.io.genes_file import GenesFile, read_genes, unit_genes
from hopdiff.io.run_folder import RunFolder
from hopdiff.job import Job, check_frames, make_run
from hopdiff.messages import say, typed_names
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.notes import notes_of
from hopdiff.tasks.results import summary, write_run
from hopdiff.types import HopdiffError, Status


@dataclass
class ReplayTask:
    """genes_file: the genes.json of a run."""

    genes_file: str | None


def build(call: Call) -> Work:
    """Read the genes and see that they are a possible run.

    Raises HopdiffError if they do not fit the gene table, or are no possible run with these settings.
    """
    if call.own.genes_file is None:
        raise HopdiffError("task=replay needs genes_file=FILE, the genes.json of a run.")
    if "experiment" in (typed := typed_names(call.command)):
        raise HopdiffError("+experiment has no effect with task=replay: type single settings, as limp.amount=0.3.")
    file = read_genes(Path(call.own.genes_file))
    original = original_body(call.config, file)
    try:
        merged = with_saved(call.config, file.settings, typed)
    except HopdiffError as error:
        raise HopdiffError(f"genes_file {str(file.path)!r}: {error}") from error
    job = build_job(merged)
    check_frames(job)
    genes = possible_genes(job, file, original)

    def work(folder: RunFolder) -> None:
        done = make_run(job, genes)
        folder.notes = notes_of(done)
        write_run(folder.path, job, done, folder.command)
        unit = zip(job.table.names, genes.tolist(), strict=True)
        if outside := [name for name, value in unit if not 0 <= value <= 1]:
            say(f"Outside the range of a search on this body at this speed: {', '.join(outside)}.")
        say(summary(folder.path, job, done, folder.notes))

    return work


def possible_genes(job: Job, file: GenesFile, original: Character) -> Tensor:
    """The genes of a file as a point (G,) of the unit box.

    original: the body they were found for. On another one, or at another speed, genes may lie outside the range of a
    search there. Raises HopdiffError if the genes do not fit the gene table or are no possible run.
    """
    here, legs = job.problem.character, (job.problem.character.leg_length, original.leg_length)
    speed = float(file.settings.get("speed", job.problem.speed))
    strange = legs[0] != legs[1] or speed != job.problem.speed
    genes = unit_genes(file, job.table, strange)
    priced = job.problem.evaluate(genes.unsqueeze(0), with_grad=False)
    if not math.isfinite(float(priced.cost)):
        reason = Status(int(priced.status)).sentence
        hint = ""
        # The same Froude number: motions of bodies of different size are alike then.
        if abs((alike := speed * math.sqrt(legs[0] / legs[1])) - job.problem.speed) > 0.01:
            hint = f" Try speed={alike:.2f}, which gives the character {here.name} the Froude number of the original."
        raise HopdiffError(f"genes_file {str(file.path)!r} is not a possible run with these settings: {reason}{hint}")
    return genes


def original_body(config: DictConfig, genes: GenesFile) -> Character:
    """The body that genes were found for. Raises HopdiffError, naming the file."""
    saved = {name: value for name, value in genes.settings.items() if name == "character"}
    try:
        return Character.build(checked(with_saved(config, saved, ())).character)
    except HopdiffError as error:
        raise HopdiffError(f"genes_file {str(genes.path)!r}, of its saved settings: {error}") from error


TASK = Task(build, ReplayTask, motion=True)
