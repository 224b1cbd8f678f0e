"""Rows of the study's tables."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from experiments.exports.blender import Seen, import_options, look
from experiments.exports.feet import seam, skating_ratio, standing, toes
from experiments.exports.glb import read_glb
from experiments.exports.in_browser import frames_per_second, played
from experiments.exports.runs import cut, lasting
from experiments.exports.validator import validate
from hopdiff.export.full_body import full_body
from hopdiff.export.glb import glb_bytes
from hopdiff.export.player import write_player
from hopdiff.export.prepare import prepared
from hopdiff.export.retarget import read_target, retargeted, write_retargeted
from hopdiff.export.settings import UNITS, ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.write import write_exports
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import read_bvh, write_bvh
from hopdiff.io.files import write_whole

MINUTE, FRAME_RATE = 60.0, 60.0  # s and frames/s of the motion whose writing is timed
MANY = 20  # motions of one page
SKATED = 10.0  # s of a loop that is laid end to end to be scored
PLAYED = ("glb", "bvh", "fbx", "usd")  # kinds that Blender opens

Row = tuple[str, ...]


@dataclass(frozen=True)
class Exported:
    """One file. takes: the motions as they should be in it; runs: what those were made of."""

    preset: str
    settings: ExportSettings
    path: Path
    takes: tuple[Take, ...]
    runs: tuple[Take, ...]


def export_all(runs: Sequence[Take], presets: Mapping[str, ExportSettings], folder: Path) -> list[Exported]:
    """Write every preset, each into a folder of its own.

    Raises HopdiffError for what cannot be written.
    """
    files = []
    for name, settings in presets.items():
        settings.check(name)
        own = folder / name
        own.mkdir(parents=True, exist_ok=True)
        # Without what is written beside them, as an index is.
        made = [output for path, output in write_exports(runs, {name: settings}, own) if path == output.path]
        for output, own_runs in zip(made, [tuple(runs)] if len(made) == 1 else [(run,) for run in runs], strict=True):
            files.append(Exported(name, settings, output.path, tuple(output.takes), own_runs))
    return files


def in_blender(program: str, files: Sequence[Exported]) -> list[tuple[Exported, Seen]]:
    """Every motion of the files that Blender opens, as it shows it."""
    return [
        (file, seen)
        for file in files
        if file.settings.kind in PLAYED
        for seen in look(program, file.path, file.settings.kind, file.takes, file.runs, import_options(file.settings))
    ]


def blender_rows(found: Sequence[tuple[Exported, Seen]]) -> list[Row]:
    """Rows by file and motion."""
    return [
        (
            file.preset,
            seen.name if file.settings.kind != "bvh" else file.takes[0].name,
            f"{seen.bones} / {seen.joints}",
            f"{seen.keys} / {seen.frames}",
            f"{1000 * seen.worst:.4f}",
            f"{1000 * seen.origin:.4f}",
            f"{seen.size:.6f}",
            f"{math.degrees(seen.tilt):.4f}",
            f"{math.degrees(seen.facing):.4f}",
            f"{seen.duration:.5f}",
        )
        for file, seen in found
    ]


def validator_rows(files: Sequence[Exported], folder: Path) -> list[Row]:
    """Rows by GLB file: motions, kilobytes, errors, warnings, remarks."""
    rows: list[Row] = []
    for file in files:
        if file.settings.kind == "glb":
            report = validate(file.path, folder)
            counts = (report.errors, report.warnings, report.infos, report.hints)
            size = f"{file.path.stat().st_size / 1000:.0f}"
            rows.append((file.preset, str(len(file.takes)), size, *map(str, counts), report.version))
    return rows


def browser_rows(runs: Sequence[Take], settings: ExportSettings, folder: Path, picture: Path) -> list[Row]:
    """Rows by page: what Chromium does with it. runs: each has a page, and all have one together.

    picture: a PNG file of the last page.
    """
    takes = [prepared(run, settings) for run in runs]
    rows: list[Row] = []
    many = [replace(takes[k % len(takes)], name=f"{takes[k % len(takes)].name} {k + 1}") for k in range(MANY)]
    for shown in (*([take] for take in takes), many, takes):
        file = folder / "page.html"
        begun = time.perf_counter()
        write_player(file, shown, settings.together)
        taken = time.perf_counter() - begun
        last = max(shown, key=lambda take: take.clip.duration).frames - 1
        found = played(file, shown, [*range(0, last, max(1, last // 10)), last], picture)
        rows.append(
            (
                ", ".join(take.name for take in shown),
                f"{file.stat().st_size / 1000:,.0f}",
                f"{1000 * taken:.0f}",
                f"{sum(wanted == frame for wanted, frame in found.shown)} / {len(found.shown)}",
                f"{1000 * found.worst:.4f}",
                f"{found.moved:.2f}",
                f"{frames_per_second(file):.0f}",
                f"{found.shades:,}",
                str(len(found.errors)),
                str(len(found.requests)),
                found.version,
            )
        )
    return rows


def read_back(file: Exported) -> dict[str, Clip]:
    """The motions of a BVH or GLB file by the names of its takes."""
    if file.settings.kind == "glb":
        return read_glb(file.path)
    return {file.takes[0].name: read_bvh(file.path, 1.0 / UNITS[file.settings.unit], file.settings.up).clip()}


def feet_rows(files: Sequence[Exported]) -> list[Row]:
    """Rows by file and motion: how far the balls of feet move while they stand, read from the file."""
    rows: list[Row] = []
    for file in files:
        if file.settings.kind not in ("bvh", "glb"):
            continue
        clips = read_back(file)
        for take in file.takes:
            if take.contact is None:
                continue
            clip = clips[take.name]
            found = standing(toes(clip), take.contact, take.clip.frame_time)
            rows.append(
                (
                    file.preset,
                    take.name,
                    f"{1000 * found.drift:.4f}",
                    f"{1000 * found.fastest:.2f}",
                    f"{1000 * found.lowest:.2f}",
                    f"{1000 * found.highest:.2f}",
                )
            )
    return rows


def skating_rows(runs: Sequence[Take], captured: Mapping[str, Take]) -> list[Row]:
    """Rows by motion: seconds that were scored, skating ratio, and what feet do while they stand."""
    rows: list[Row] = []
    for name, take in ({run.name: lasting(full_body(run), SKATED) for run in runs} | dict(captured)).items():
        contact = take.contact
        moves = None if contact is None else standing(toes(take.clip), contact, take.clip.frame_time)
        rows.append(
            (
                name,
                "captured" if name in captured else "ours",
                f"{take.clip.duration:.1f}",
                f"{skating_ratio(take):.3f}",
                "-" if moves is None else f"{moves.mean:.3f}",
                "-" if moves is None else f"{1000 * moves.drift:.1f}",
            )
        )
    return sorted(rows, key=lambda row: (row[1] == "captured", row[0]))


def retarget_rows(runs: Sequence[Take], bodies: Sequence[Path], folder: Path) -> list[Row]:
    """Rows by run and body, a BVH or GLB file: what the feet do there, and what comes back from the file."""
    rows: list[Row] = []
    for body in bodies:
        target = read_target(body)
        for run in runs:
            take = retargeted(run, target)
            assert take.feet is not None
            assert take.contact is not None
            file = folder / f"body{target.suffix}"
            write_retargeted(file, [take], target)
            # The last of the motions in the file: it may have had one of the same name.
            back = read_bvh(file).clip() if target.suffix == ".bvh" else [*read_glb(file).values()][-1]
            off = (back.joint_positions() - take.clip.joint_positions()).norm(dim=-1).max()
            found = standing(take.feet, take.contact, take.clip.frame_time)
            rows.append(
                (
                    body.name,
                    run.name,
                    f"{take.numbers['leg_ratio']:.3f}",
                    f"{1000 * found.drift:.4f}",
                    f"{1000 * found.lowest:.2f}",
                    f"{1000 * found.highest:.2f}",
                    f"{1000 * float(off):.4f}",
                )
            )
    return rows


def seam_rows(files: Sequence[Exported]) -> list[Row]:
    """Rows by file and loop that runs straight on: gap at the seam, and change of velocity there and elsewhere."""
    rows: list[Row] = []
    for file in files:
        if file.settings.kind not in ("bvh", "glb"):
            continue
        for take, run in zip(file.takes, file.runs, strict=True):
            if run.loop:
                found = seam(read_back(file)[take.name])
                ratio = f"{found.kink / found.elsewhere:.2f}"
                gap = f"{1000 * found.gap:.4f}"
                rows.append((file.preset, take.name, gap, f"{found.kink:.2f}", f"{found.elsewhere:.2f}", ratio))
    return rows


def timing_rows(run: Take, folder: Path, rounds: int) -> list[Row]:
    """Rows by kind: milliseconds to write a minute of 22 joints (median, in turns), minutes a second, kilobytes."""
    frames = round(MINUTE * FRAME_RATE) + 1
    take = cut(lasting(full_body(run), MINUTE + 1.0).resampled(FRAME_RATE, exact=True), frames)
    paths = {"BVH": folder / "minute.bvh", "GLB": folder / "minute.glb"}
    calls: dict[str, Callable[[], None]] = {
        "BVH": lambda: write_bvh(paths["BVH"], take.clip),
        "GLB": lambda: write_whole(paths["GLB"], glb_bytes([take])),
    }
    taken: dict[str, list[float]] = {kind: [] for kind in calls}
    for _ in range(rounds):
        for kind, call in calls.items():
            begun = time.perf_counter()
            call()
            taken[kind].append(time.perf_counter() - begun)
    rows: list[Row] = []
    for kind, seconds in taken.items():
        middle = statistics.median(seconds)
        size = paths[kind].stat().st_size
        rows.append(
            (
                kind,
                f"{take.frames:,}",
                f"{1000 * middle:.0f}",
                f"{take.clip.duration / middle:,.0f}",
                f"{size / 1000:,.0f}",
                f"{size / take.frames / take.clip.rotations.shape[1]:.1f}",
            )
        )
    return rows
