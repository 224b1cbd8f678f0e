"""What the body looks like that comes with every motion. python -m experiments.exports.mannequin

One picture, rendered by Blender from GLB files: eight sides at rest; six phases of a brisk run, the child and the
cartoon at rest; six phases of a jog, and those two as they run. Needs HOPDIFF_BLENDER.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from PIL import Image

from experiments.exports.runs import own_runs
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.export.fbx import find_blender, run_in_blender
from hopdiff.export.full_body import full_body, is_model_body
from hopdiff.export.glb import write_glb
from hopdiff.export.pose import with_rest_pose
from hopdiff.export.take import Take
from hopdiff.job import search_run

HERE = Path(__file__).parent
SCRIPT = HERE / "mannequin_in_blender.py"
SIZE = (216, 320)  # pixels of each figure
COLUMNS = 8
COLOURS = 128
PAPER = (236, 238, 242)
SIDES = 8
PHASES = 6
OTHERS = ("child", "cartoon")
QUARTER = 35.0  # degrees from which figures are seen from ahead


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.exports.mannequin", description=__doc__)
    parser.add_argument("--blender", help="Blender, or a Python that has bpy (or HOPDIFF_BLENDER)")
    parser.add_argument("--evaluations", type=int, default=500, help="budget of each search")
    parser.add_argument("--out", type=Path, default=HERE / "pictures" / "mannequin.png", help="the picture")
    given = parser.parse_args(arguments)
    program = find_blender(given.blender)
    torch.set_num_threads(1)
    runs = own_runs(given.evaluations, path=False)
    for name in OTHERS:
        asked = [
            "model=smooth",
            f"character={name}",
            "speed=2.5",
            "beta=0.4",
            f"budget.evaluations={given.evaluations}",
        ]
        runs[name] = replace(search_run(build_job(compose(asked))).take(), name=name)
    with tempfile.TemporaryDirectory(prefix="hopdiff_mannequin_") as folder:
        shots = shots_of(runs, Path(folder))
        job = Path(folder, "job.json")
        job.write_text(json.dumps({"size": SIZE, "shots": shots}), encoding="utf-8")
        run_in_blender(program, SCRIPT, [str(job)], "cannot picture the body", 1200.0)
        sheet(shots, given.out)
    print(given.out)


def shots_of(runs: dict[str, Take], folder: Path) -> list[dict[str, Any]]:
    """What is rendered, row by row; writes the GLB files."""
    files, takes = {}, {}
    for name, run in runs.items():
        take = full_body(run) if is_model_body(run.clip.skeleton) else run
        takes[name] = with_rest_pose(take, "a")
        files[name] = str(folder / f"{name}.glb")
        write_glb(files[name], [takes[name]])

    def shot(name: str, around: float, share: float | None, high: float = 2.1) -> dict[str, Any]:
        time = None if share is None else share * takes[name].clip.duration
        motion = None if share is None else takes[name].name
        return {"file": files[name], "motion": motion, "time": time, "from": around, "high": high}

    phases = [k / PHASES for k in range(PHASES)]
    shots = [shot("brisk", 360.0 / SIDES * k, None) for k in range(SIDES)]
    shots += [shot("brisk", 90.0, share) for share in phases]
    shots += [shot("child", QUARTER, None, 1.6), shot("cartoon", QUARTER, None, 1.6)]
    shots += [shot("jog", QUARTER, share) for share in phases]
    shots += [shot("child", QUARTER + 20.0, 0.3, 1.6), shot("cartoon", QUARTER + 20.0, 0.3, 1.6)]
    return [{**one, "picture": str(folder / f"{k}.png")} for k, one in enumerate(shots)]


def sheet(shots: Sequence[dict[str, Any]], target: Path) -> None:
    wide, high = SIZE
    whole = Image.new("RGB", (COLUMNS * wide, -(-len(shots) // COLUMNS) * high), PAPER)
    for k, shot in enumerate(shots):
        with Image.open(shot["picture"]) as one:
            figure = one.convert("RGBA")
            whole.paste(figure, (k % COLUMNS * wide, k // COLUMNS * high), figure)
    target.parent.mkdir(parents=True, exist_ok=True)
    whole.quantize(COLOURS, kmeans=2).save(target, optimize=True)


if __name__ == "__main__":
    main()
