"""Do exports arrive in other programs as they left? python -m experiments.exports --clips FOLDER"""

from __future__ import annotations

import argparse
import platform
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import torch
from PIL import Image

from experiments.bench.__main__ import processor
from experiments.exports.blender import import_options, look
from experiments.exports.in_browser import find_chromium
from experiments.exports.measure import (
    Exported,
    blender_rows,
    browser_rows,
    export_all,
    feet_rows,
    in_blender,
    retarget_rows,
    seam_rows,
    skating_rows,
    timing_rows,
    validator_rows,
)
from experiments.exports.runs import captured_clips, own_runs, presets
from experiments.exports.validator import VARIABLE, modules
from experiments.report import markdown, origin
from hopdiff.export.fbx import find_blender
from hopdiff.export.take import Take
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

HERE = Path(__file__).parent
PICTURED = 0.4  # of the brisk run's stride, in flight
BODIES = ("wander_cmu_91_01_digital8_30hz", "walk_straight_snu_30hz")  # more skeletons of a folder of captured clips
COLOURS = 256  # of Blender's picture


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.exports", description=__doc__)
    parser.add_argument("--clips", type=Path, help="folder of captured BVH files, for the skating ratio")
    parser.add_argument("--blender", help="Blender, or a Python that has bpy (or HOPDIFF_BLENDER)")
    parser.add_argument("--evaluations", type=int, default=2000, help="budget of each search")
    parser.add_argument("--rounds", type=int, default=7, help="timings of each kind, in turns; the median counts")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md and pictures")
    given = parser.parse_args(arguments)
    torch.set_num_threads(1)
    program = blender(given.blender)
    runs = list(own_runs(given.evaluations).values())
    # Pages are looked at in a browser, below.
    # Blend spaces are looked at in the tests: they take loops of one body.
    wanted = {
        name: one
        for name, one in presets().items()
        if one.kind not in ("html", "blendspace") and (one.kind != "fbx" or program)
    }
    with tempfile.TemporaryDirectory(prefix="hopdiff_exports_") as folder:
        files = export_all(runs, wanted, Path(folder))
        parts = [
            origin("exports", sys.argv[1:] if arguments is None else arguments),
            "",
            f"{processor()}, 1 thread, torch {torch.__version__}, Python {platform.python_version()}; searches of"
            f" {given.evaluations} evaluations; presets: {', '.join(wanted)}.",
            "",
            *blender_part(program, files),
            *validator_part(files),
            *browser_part(runs, Path(folder), given.out / "pictures"),
            *feet_part(files, runs, given.clips),
            "## Time",
            "",
            "A minute at 60 frames/s on 22 joints, written in turns; bytes are those of a joint and frame.",
            "",
            markdown(
                ("kind", "frames", "ms", "s of motion / s", "kB", "bytes"),
                timing_rows(runs[1], Path(folder), given.rounds),
            ),
        ]
        if program:
            picture(program, files, given.out / "pictures")
    text = "\n".join(parts)
    write_whole(given.out / "results.md", text)
    print(text)


def blender(setting: str | None) -> str | None:
    """The Blender to use, if there is one."""
    try:
        return find_blender(setting)
    except HopdiffError as error:
        if setting:
            raise
        print(f"Without Blender: {error}")
        return None


def blender_part(program: str | None, files: Sequence[Exported]) -> list[str]:
    if program is None:
        return ["## Blender", "", "Left out: there was no Blender.", ""]
    found = in_blender(program, files)
    return [
        f"## Blender {found[0][1].version}",
        "",
        "Every tenth frame: farthest that any bone begins from our joint, in the exported motion and in the run before"
        " anything was done to it for the export (hips, shoulders, elbows, neck: joints that exports leave alone)."
        " Size: of the joints, over ours. Up, facing: between their spine, or their hips, and ours; ours face Blender's"
        " front view. Duration: over ours.",
        "",
        markdown(
            ("preset", "run", "bones", "frames", "off mm", "off run mm", "size", "up deg", "facing deg", "duration"),
            blender_rows(found),
        ),
    ]


def validator_part(files: Sequence[Exported]) -> list[str]:
    if (folder := modules()) is None:
        return ["## Khronos glTF validator", "", f"Left out: {VARIABLE} names no folder with gltf-validator.", ""]
    rows = validator_rows(files, folder)
    return [
        f"## Khronos glTF validator {rows[0][-1]}",
        "",
        markdown(
            ("preset", "motions", "kB", "errors", "warnings", "infos", "hints"),
            [row[:-1] for row in rows],
        ),
    ]


def browser_part(runs: Sequence[Take], folder: Path, pictures: Path) -> list[str]:
    try:
        find_chromium()
    except HopdiffError as error:
        return ["## Chromium", "", f"Left out: {error}", ""]
    pictures.mkdir(parents=True, exist_ok=True)
    # Of the page that holds the loops, in one row.
    rows = browser_rows([run for run in runs if run.loop], presets()["html"], folder, pictures / "page.png")
    return [
        f"## Chromium {rows[0][-1]}",
        "",
        "`motion.html` without a screen. Frames: to which the slider was set, and which the page then showed. Off:"
        " farthest that any joint of any motion then was from ours. Moved: of a joint, while it played. Pictures/s:"
        " while it plays, drawn by program without a graphics card. Shades: in the picture of the figures.",
        "",
        markdown(
            (
                "motions",
                "kB",
                "ms to write",
                "frames",
                "off mm",
                "moved m",
                "pictures/s",
                "shades",
                "console errors",
                "requests",
            ),
            [row[:-1] for row in rows],
        ),
    ]


def feet_part(files: Sequence[Exported], runs: Sequence[Take], clips: Path | None) -> list[str]:
    captured = captured_clips(clips)
    note = "" if captured else " Captured clips are left out: --clips names no folder that has them."
    return [
        "## Feet",
        "",
        "Read back from the files, while a foot stands: how far over the ground the joint of its toes gets from where"
        " it began, how fast it moves, and its least and greatest height.",
        "",
        markdown(("preset", "run", "drift mm", "mm/s at most", "lowest mm", "highest mm"), feet_rows(files)),
        "## Skating",
        "",
        "Ratio: share of the intervals between frames at 20 frames/s in which the toe joint of either foot is lower"
        " than 5 cm at both ends, faster than 0.5 m/s over the ground, and so in the mean over the 5 about it;"
        f" the ground is at the lowest place of the toes.{note}",
        "",
        markdown(("motion", "", "s", "ratio", "standing m/s", "standing mm"), skating_rows(runs, captured)),
        *retarget_part(files, runs, clips),
        "## Loops",
        "",
        "Where the last frame is followed by the first of the next time: how far joints are from where they begin, and"
        " how much the velocity of any joint changes there, against the largest change between frames elsewhere.",
        "",
        markdown(("preset", "run", "gap mm", "seam m/s", "elsewhere m/s", "ratio"), seam_rows(files)),
    ]


def retarget_part(files: Sequence[Exported], runs: Sequence[Take], clips: Path | None) -> list[str]:
    """Runs on the bodies of captured clips, and of our own file for Unreal Engine."""
    bodies = [clips / f"{name}.bvh" for name in (*captured_clips(clips), *BODIES)] if clips else []
    bodies = [body for body in bodies if body.is_file()]
    bodies.append(next(file.path for file in files if file.preset == "glb_unreal"))
    with tempfile.TemporaryDirectory(prefix="hopdiff_retarget_") as folder:
        rows = retarget_rows(runs, bodies, Path(folder))
    return [
        "## Other bodies",
        "",
        "Runs on the skeletons of other files: ratio of the legs, drift of standing feet (the balls, or the ends of"
        " shanks without feet), their least and greatest height, and how far joints are off in the written file.",
        "",
        markdown(("body", "run", "legs", "drift mm", "lowest mm", "highest mm", "off mm"), rows),
    ]


def picture(program: str, files: Sequence[Exported], folder: Path) -> None:
    """Blender's picture of the brisk run in the plain GLB file."""
    file = next(file for file in files if file.preset == "glb")
    folder.mkdir(parents=True, exist_ok=True)
    brisk = next(k for k, take in enumerate(file.takes) if take.name == "brisk")
    target, moment = folder / "blender.png", PICTURED * file.takes[brisk].clip.duration
    look(program, file.path, "glb", file.takes, file.runs, import_options(file.settings), (target, moment, "brisk"))
    # Few colours keep the noise of the light, and the file, small.
    with Image.open(target) as whole:
        few = whole.convert("RGB").quantize(COLOURS, kmeans=2)
    few.save(target, optimize=True)


if __name__ == "__main__":
    main()
