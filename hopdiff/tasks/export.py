# No `from __future__ import annotations`: OmegaConf reads the types of the settings classes.
"""task=export, and what `export=[...]` adds to other tasks: motions of run folders in the formats of other programs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from hopdiff.export.mapping import NAMES_FILE
from hopdiff.export.prepare import in_place_if, named, with_clip
from hopdiff.export.request import Exports
from hopdiff.export.retarget import Target, retargeted, write_retargeted
from hopdiff.export.settings import RetargetSettings
from hopdiff.export.skin_check import SkinCheck, worst_of
from hopdiff.export.tables import read_npz
from hopdiff.export.take import Take
from hopdiff.export.write import Output, distinct, outputs, plain, written
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.bvh import read_bvh
from hopdiff.io.files import read_json, write_whole
from hopdiff.io.record import write_json
from hopdiff.io.run_folder import Note, RunFolder
from hopdiff.job import run_name
from hopdiff.messages import plural, say
from hopdiff.runs.folders import find_runs
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.results import shown
from hopdiff.types import HopdiffError

# What a run folder holds its motion in; the first that is there counts.
SOURCES = ("motion.npz", "edited.bvh", "walk.bvh", "motion.bvh")


@dataclass
class ExportTask:
    """run: a run folder or a BVH file, or a list of them. runs: a folder with run folders below it."""

    run: Any
    runs: str | None


@dataclass(frozen=True)
class Written:
    """files: that were written, each with words on what is in it. checks: of the skin of another body, by motion.
    notes: by the name of the export."""

    files: Sequence[tuple[Path, str]]
    checks: Sequence[SkinCheck]
    notes: Sequence[Note] = ()


def build(call: Call) -> Work:
    """Read the motions. Raises HopdiffError for what cannot be read, or where nothing is asked for."""
    sources = sources_of(call.own.run, call.own.runs)
    if not call.exports:
        raise HopdiffError("task=export needs export=[...], as export=[glb,bvh_blender]; --help lists what there is.")
    takes = distinct([read_take(source) for source in sources])

    def work(folder: RunFolder) -> None:
        made = _noted(folder, write_all(takes, call.exports, folder.path))
        notes = [f"{take.name}: {note}" for take in takes for note in take.notes]
        folder.notes += [Note("clip", note) for note in notes]
        told = [("note", note) for note in notes]
        rows = [("motions", _motions(takes)), *_rows(made), *told, *_mapped(folder, call.exports, made)]
        rows.append(("files", shown(folder.path)))
        say("\n".join(f"{name:<9} {text}" for name, text in rows))

    return work


def read_take(source: Path) -> Take:
    """The motion of a run folder, or of a BVH or NPZ file. Raises HopdiffError if there is none."""
    if source.is_file():
        return _of_file(source, source.stem, {})
    if not source.is_dir():
        raise HopdiffError(f"run={source}: there is no such folder.")
    motion = next((source / name for name in SOURCES if (source / name).is_file()), None)
    if motion is None:
        raise HopdiffError(f"run={source} holds no motion: none of {', '.join(SOURCES)} is in it.")
    numbers = read_json(source / "metrics.json") if (source / "metrics.json").is_file() else {}
    if not isinstance(numbers, dict):
        raise HopdiffError(f"{source / 'metrics.json'} does not hold the metrics of a run.")
    name = Path(str(numbers["clip"])).stem + "_edited" if "clip" in numbers else motion.stem
    if all(isinstance(numbers.get(entry), int | float) for entry in ("speed", "beta")):
        name = run_name(numbers)
    return _of_file(motion, name, numbers)


def _of_file(path: Path, name: str, numbers: Mapping[str, Any]) -> Take:
    match path.suffix.lower():
        case ".npz":
            return read_npz(path)
        case ".bvh":
            file = read_bvh(path, numbers.get("unit"), numbers.get("up"))
            return replace(Take.of_clip(plain(name), file.clip(), numbers), notes=file.notes)
        case _:
            raise HopdiffError(f"run={path}: motions are read from run folders, BVH and NPZ files.")


def sources_of(run: Any, runs: str | None) -> list[Path]:
    """The places that run=PLACE, run=[PLACE,...] and runs=FOLDER name. Raises HopdiffError if there is none."""
    given = run if isinstance(run, list | tuple) else [] if run is None else [run]
    if not all(isinstance(one, str) and one for one in given):
        raise HopdiffError(f"run must be a folder, or a list of folders, not {run!r}.")
    found = [Path(one) for one in given]
    if runs is not None:
        # Exports of runs lie in folders of their own, without metrics.
        found += [folder for folder in find_runs(Path(runs)) if any((folder / name).is_file() for name in SOURCES)]
    if not found:
        raise HopdiffError("task=export needs run=DIR, a run folder, run=[DIR,...], or runs=FOLDER with runs below it.")
    return found


def export_result(folder: RunFolder, exports: Exports) -> None:
    """Write the motion of a run folder that was just made into that folder."""
    export_takes(folder, [read_take(folder.path)], exports)


def export_takes(folder: RunFolder, takes: Sequence[Take], exports: Exports) -> None:
    """Write motions that were just made into a run folder, and tell the user of the files."""
    made = _noted(folder, write_all(takes, exports, folder.path))
    rows = _rows(made) + _mapped(folder, exports, made)
    say("\n".join(f"{name:<9} {text}" for name, text in rows))


def write_all(takes: Sequence[Take], exports: Exports, folder: Path) -> Written:
    """Write takes in all wanted forms, all of which are made before the first file is written.

    Raises HopdiffError for what a motion does not allow, or a file that cannot be written.
    """
    files: list[tuple[Path, str]] = []
    checks: list[SkinCheck] = []
    if exports.target is not None:
        takes = on_target(takes, exports.target, exports.retarget)
    ready = outputs(takes, exports.files, folder)
    if exports.target is not None:
        suffix = exports.target.suffix
        lots = [("retargeted", takes)] if suffix != ".bvh" or len(takes) == 1 else []
        for name, lot in lots or [(f"retargeted_{plain(take.name)}", [take]) for take in takes]:
            path = folder / f"{name}{suffix}"
            checks += write_retargeted(path, lot, exports.target)
            files.append((path, _frames(lot)))
    files += [(path, _content(one)) for path, one in written(ready)]
    return Written(
        files, checks, [Note(one.export, f"exports.{one.export}: {note}") for one in ready for note in one.notes]
    )


def on_target(takes: Sequence[Take], target: Target, settings: RetargetSettings) -> list[Take]:
    """Takes on another body, as clips that the settings ask for. Raises HopdiffError, naming the setting."""
    try:
        # What mirrors and repeats knows the source; the target's feet are planted over the whole of it.
        facing = torch.tensor(target.facing(), dtype=torch.float64)
        rest = axis_rotation("Y", -facing) @ target.rest[0]
        moved = [in_place_if(retargeted(with_clip(take, settings), target), settings, rest) for take in takes]
        return named(moved, settings)
    except HopdiffError as error:
        raise HopdiffError(f"retarget: {error}") from error


def _mapped(folder: RunFolder, exports: Exports, made: Written) -> list[tuple[str, str]]:
    """Lines for people on the parts that were found on another body, and on its skin. The same goes into the metrics of
    a run, or a file of its own where there are none; parts that were not found may be filled in in a third."""
    if exports.target is None:
        return []
    report, name = exports.target.report(), Path(exports.target.name).name
    worst = worst_of(made.checks)
    numbers = {**report.numbers(), "notes": list(exports.target.notes), "skin": worst.numbers() if worst else None}
    metrics = folder.path / "metrics.json"
    if metrics.is_file():
        write_json(metrics, {**read_json(metrics), "retarget": numbers})
    else:
        write_json(folder.path / "retarget.json", numbers)
    if report.missing:
        write_whole(folder.path / NAMES_FILE, report.names_file())
    rows = [("body", report.sentence())]
    rows += [("skin", worst.sentence())] if worst else []
    told = [report.warning(), *exports.target.notes]
    told += dict.fromkeys(warning for check in made.checks for warning in check.warnings(name))
    for sentence in told:
        if sentence is not None:
            folder.notes.append(Note("retarget", sentence))
            rows.append(("note", sentence))
    return rows


def _noted(folder: RunFolder, made: Written) -> Written:
    """What was written, folders among it known as the run's own, notes on it kept."""
    folder.folders += [path.name for path, _ in made.files if path.is_dir()]
    folder.notes += made.notes
    return made


def _rows(made: Written) -> list[tuple[str, str]]:
    """Lines for people: what, and file with its size; then the notes."""
    wide = max(len(path.name) for path, _ in made.files)
    rows = [
        ("exported" if k == 0 else "", f"{path.name:<{wide}}  {_size(path):>7}  {words}")
        for k, (path, words) in enumerate(made.files)
    ]
    return rows + [("note", note.sentence) for note in made.notes]


def _size(path: Path) -> str:
    size = sum(one.stat().st_size for one in path.iterdir()) if path.is_dir() else path.stat().st_size
    return f"{math.ceil(size / 1000)} kB" if size < 1e6 else f"{size / 1e6:.1f} MB"


def _content(output: Output) -> str:
    """Words on what is in a file."""
    pictures = output.settings.format.pictures
    return _frames(output.takes, None if pictures is None else pictures(output.takes, output.settings))


def _frames(takes: Sequence[Take], pictures: int | None = None) -> str:
    """Words on the motions of a file, and how many pictures it has of them. Where a whole number of frames fills a loop
    they do not lie at the frame rate that was asked for."""
    take, count = takes[0], sum(one.frames for one in takes)
    what = plural(count, "frame") if pictures is None else plural(pictures, "picture")
    if len(takes) > 1:
        return f"{len(takes)} motions, {what}"
    return f"{what} at {1.0 / take.clip.frame_time:.2f}/s" + (", loops" if take.loop else "")


def _motions(takes: Sequence[Take]) -> str:
    first = [f"{take.name} ({take.frames} frames, {take.clip.duration:.2f} s)" for take in takes[:3]]
    return ", ".join(first) + (f" and {len(takes) - 3} more" if len(takes) > 3 else "")


TASK = Task(build, ExportTask, exports=True)
