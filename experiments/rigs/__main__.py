"""Does anybody's character run? python -m experiments.rigs [--folder FOLDER]"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from experiments.exports.runs import own_runs
from experiments.exports.validator import modules, validate
from experiments.report import markdown, origin
from experiments.rigs.judge import Seen, seen
from experiments.rigs.picture import sheet
from hopdiff.export.retarget import read_target, retargeted, write_retargeted
from hopdiff.export.take import Take
from hopdiff.io.files import write_whole
from hopdiff.io.glb_file import GlbFile
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rig_families import FAMILIES
from tests.export.stand_ins import ALL, stand_in

HERE = Path(__file__).parent
SOLE, STRETCH, FACING = 0.01, 2.0, 45.0  # m, ratio, degrees: what a stand-in may be off
GROWN = 0.08  # of the height: longer edges are seen to be torn
HEADING = (
    "character",
    "parts",
    "missed",
    "sole [cm]",
    "sunk [cm]",
    "stretch",
    "grown [cm]",
    "facing [deg]",
    "validator",
    "s",
    "verdict",
)


@dataclass(frozen=True)
class Tried:
    """One character. known: parts that it has, None of a file of somebody's. seen: None where it was refused, or its
    skin cannot be read. said: the refusal, or the notes."""

    name: str
    found: int
    missed: int | None
    seen: Seen | None
    validator: str
    seconds: float
    said: str

    @property
    def verdict(self) -> str:
        if self.found == 0:
            return "refused"
        if self.seen is None:
            return "not seen"
        one = self.seen
        whole = one.stretch < STRETCH or one.grown < GROWN * one.height
        sound = one.sole < SOLE and whole and one.facing < FACING and not self.missed
        return "right" if sound else "look"

    def row(self) -> tuple[object, ...]:
        one = self.seen
        numbers = ("-",) * 5
        if one is not None:
            numbers = (f"{100 * one.sole:.2f}", f"{100 * one.sunk:.2f}", f"{one.stretch:.2f}")
            numbers += (f"{100 * one.grown:.1f}", f"{one.facing:.0f}")
        missed = "-" if self.missed is None else self.missed
        parts = f"{self.found} of {len(JOINTS)}" if self.found else "-"
        return (self.name, parts, missed, *numbers, self.validator, f"{self.seconds:.2f}", self.verdict)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.rigs", description=__doc__)
    parser.add_argument("--folder", type=Path, help="GLB and VRM files of real characters, looked at as well")
    parser.add_argument("--evaluations", type=int, default=2000, help="budget of the run's search")
    parser.add_argument("--families", type=int, default=len(FAMILIES), help="stand-ins of so many families only")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md and pictures")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    take = own_runs(given.evaluations)["brisk"]
    with tempfile.TemporaryDirectory(prefix="hopdiff_rigs_") as folder:
        made = [tried(path, take, known) for path, known in stand_ins(Path(folder), given.families)]
        real = [tried(path, take, None) for path in files(given.folder)]
    parts = [origin("rigs", sys.argv[1:] if arguments is None else arguments, ("--folder",)), ""]
    parts += [
        "A brisk run of `model=smooth` on stand-ins, each with one or two of the properties of others' files.",
        "",
    ]
    parts += [markdown(HEADING, [one.row() for one in made]), *_total(made)]
    if real:
        parts += ["", "## Files of a folder", "", markdown(HEADING, [one.row() for one in real]), *_total(real), ""]
        parts += [f"- {one.name}: {one.said}" for one in real if one.said]
    text = "\n".join(parts) + "\n"
    given.out.mkdir(parents=True, exist_ok=True)
    write_whole(given.out / "results.md", text)
    sheet(
        given.out / "pictures" / "stand_ins.png",
        [(one.name, one.seen.shape, one.seen.edges) for one in made if one.seen is not None],
    )
    print(text)


def stand_ins(folder: Path, families: int) -> Iterator[tuple[Path, int]]:
    """Files of one body on every family's skeleton, plain and with properties in turn; and how many parts it has."""
    names = list(FAMILIES)[:families]
    for k, family in enumerate(names):
        for properties in ((), (ALL[k % len(ALL)],), (ALL[(k + 3) % len(ALL)], ALL[(k + 8) % len(ALL)])):
            path = folder / f"{'+'.join((family, *properties))}.glb"
            path.write_bytes(stand_in(family, *properties))
            yield path, len(FAMILIES[family].parts)


def files(folder: Path | None) -> list[Path]:
    if folder is None:
        return []
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".glb", ".vrm"))
    if not found:
        raise SystemExit(f"--folder: no GLB or VRM file is in {folder}.")
    return found


def tried(path: Path, take: Take, known: int | None) -> Tried:
    """A run put on a character, and the file looked at."""
    start, program = time.perf_counter(), modules()
    with tempfile.TemporaryDirectory(prefix="hopdiff_rig_") as folder:
        out = Path(folder, f"out{path.suffix.lower()}")
        try:
            target = read_target(path)
            moved = retargeted(take, target)
            write_retargeted(out, [moved], target)
        except HopdiffError as error:
            said = str(error).replace(str(path.parent), "").lstrip("/")
            return Tried(path.stem, 0, None, None, "-", time.perf_counter() - start, said)
        seconds = time.perf_counter() - start
        errors = "-"
        if program is not None:
            errors = " -> ".join(str(validate(file, program).errors) for file in (path, out))
        found = len(target.parts)
        assert moved.contact is not None
        times = moved.clip.frame_time * np.arange(moved.frames)
        travel = moved.clip.root_position[-1] - moved.clip.root_position[0]
        one = None
        if target.skin is not None and isinstance(target.file, GlbFile) and not compressed(target.file):
            way = float(travel[0]), float(travel[2])
            # Faces are turned to +z in glTF, but of characters of VRM 0.
            back = "backwards" in path.stem or "VRM" in target.file.content.get("extensions", {})
            one = seen(out, moved.name, times, moved.contact.numpy(), way, (0.0, -1.0 if back else 1.0))
        missed = None if known is None else known - found
        return Tried(path.stem, found, missed, one, errors, seconds, " ".join(target.notes))


def compressed(file: GlbFile) -> bool:
    """Whether a file's mesh is packed in a way that the reader of this study does not know."""
    content = file.content
    primitives = [one for mesh in content.get("meshes", ()) for one in mesh["primitives"]]
    return any(
        "compression" in name for one in (*content["bufferViews"], *primitives) for name in one.get("extensions", ())
    )


def _total(rows: Sequence[Tried]) -> list[str]:
    count = {
        verdict: sum(row.verdict == verdict for row in rows) for verdict in ("right", "refused", "look", "not seen")
    }
    return [f"{len(rows)} characters: " + ", ".join(f"{number} {verdict}" for verdict, number in count.items()) + "."]


if __name__ == "__main__":
    main()
