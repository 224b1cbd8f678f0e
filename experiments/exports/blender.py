"""What Blender makes of exported files, against the motions that they were written from."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from experiments.exports.runs import BVH_OPTIONS
from hopdiff.editing.leg_joints import SIDES
from hopdiff.export.anatomy import parts_of
from hopdiff.export.fbx import run_in_blender
from hopdiff.export.settings import UNITS, ExportSettings
from hopdiff.export.take import Take

SCRIPT = Path(__file__).with_name("in_blender.py")
EVERY = 10  # frames between those that are compared
# The model's own joints; knees move so that feet stand.
OWN = ("pelvis", "neck", *(f"{side}_{part}" for side in SIDES for part in ("shoulder", "elbow", "hip")))
FPS = 60  # of the scene that a file is imported into


@dataclass(frozen=True)
class Seen:
    """One motion of a file as Blender shows it, against ours. bones: of which both know. keys, frames: theirs, ours.

    worst: farthest that a bone begins from our joint [m]. origin: and from the joint of the run, of those that an
    export leaves where they are. size: height of the joints over ours. tilt: of their up
    against Blender's [rad]. facing: of the body against Blender's front view [rad]. duration: over ours. version: of
    Blender.
    """

    name: str
    bones: int
    joints: int
    keys: int
    frames: int
    worst: float
    origin: float
    size: float
    tilt: float
    facing: float
    duration: float
    fps: float
    version: str


def import_options(settings: ExportSettings) -> dict[str, Any]:
    """What a user sets in Blender's importer for a file with these settings."""
    if settings.kind != "bvh":
        return {}
    forward, up = BVH_OPTIONS[settings.up]
    scale = 1.0 / UNITS[settings.unit]
    return {"axis_forward": forward, "axis_up": up, "global_scale": scale, "update_scene_fps": True}


def look(
    program: str,
    file: Path,
    kind: str,
    takes: Sequence[Take],
    runs: Sequence[Take],
    options: dict[str, Any] | None = None,
    picture: tuple[Path, float, str] | None = None,
) -> list[Seen]:
    """Import a file and compare every motion in it. takes: what it was written from; runs: what those were made of.

    picture: a PNG file to be rendered, the time [s] and the motion. Raises HopdiffError if Blender
    fails.
    """
    frames = {take.name: looked_up(take.frames) for take in takes}
    times = {take.name: [k * take.clip.frame_time for k in frames[take.name]] for take in takes}
    job: dict[str, Any] = {"kind": kind, "file": str(file), "options": options or {}, "fps": FPS, "times": times}
    if kind == "usd":
        # The importer leaves the scene's frame rate to its user.
        job["fps_base"] = FPS * takes[0].clip.frame_time
    if picture is not None:
        job |= {"picture": str(picture[0].resolve()), "picture_time": picture[1], "picture_name": picture[2]}
    with tempfile.TemporaryDirectory() as folder:
        question, answer = Path(folder, "job.json"), Path(folder, "answer.json")
        question.write_text(json.dumps(job), encoding="utf-8")
        run_in_blender(program, SCRIPT, [str(question), str(answer)], f"cannot look at {file.name}")
        found = json.loads(answer.read_text(encoding="utf-8"))
    names = [take.name for take in takes]
    seen = []
    for one in found["animations"]:
        k = names.index(one["name"]) if kind not in ("bvh", "usd") else 0
        seen.append(compared(one, takes[k], runs[k], frames[names[k]], found["fps"], found["blender"]))
    return seen


def compared(one: dict[str, Any], take: Take, run: Take, frames: list[int], fps: float, version: str) -> Seen:
    """One animation of an answer against the motion that it was written from."""
    names = take.clip.skeleton.names
    known = [name for name in one["bones"] if name in names]
    theirs = torch.tensor(one["heads"], dtype=torch.float64)[:, [one["bones"].index(name) for name in known]]
    ours = in_blenders_axes(take.clip.joint_positions()[frames])[:, [names.index(name) for name in known]]
    parts = {part: known.index(names[joint]) for part, joint in parts_of(take.clip.skeleton).items()}
    across = (theirs[:, parts["left_hip"]] - theirs[:, parts["right_hip"]]).mean(dim=0)
    own_across = (ours[:, parts["left_hip"]] - ours[:, parts["right_hip"]]).mean(dim=0)
    high = (theirs[:, parts["head"]] - theirs[:, parts["pelvis"]]).mean(dim=0)
    own_high = (ours[:, parts["head"]] - ours[:, parts["pelvis"]]).mean(dim=0)
    kept = {part: joint for part, joint in parts_of(run.clip.skeleton).items() if part in OWN and part in parts}
    source = in_blenders_axes(run.clip.joint_positions()[frames])[:, list(kept.values())]
    return Seen(
        name=one["name"],
        bones=len(known),
        joints=len(names),
        keys=one["keys"],
        frames=take.frames,
        worst=float((theirs - ours).norm(dim=-1).max()),
        origin=float((theirs[:, [parts[part] for part in kept]] - source).norm(dim=-1).max()),
        size=float(spread(theirs) / spread(ours)),
        tilt=between(high, own_high),
        facing=between(across, own_across),
        duration=one["duration"] / take.clip.duration,
        fps=fps,
        version=version,
    )


def looked_up(frames: int) -> list[int]:
    """Every tenth frame, and the last."""
    return sorted({*range(0, frames, EVERY), frames - 1})


def in_blenders_axes(places: Tensor) -> Tensor:
    """(..., 3) places with x left, y up, z forward, where Blender has them: z up, and the body facing -y."""
    return torch.stack((places[..., 0], -places[..., 2], places[..., 1]), dim=-1)


def spread(places: Tensor) -> Tensor:
    """Mean distance (...) of joints (..., J, 3) from their middle [m]."""
    return (places - places.mean(dim=-2, keepdim=True)).norm(dim=-1).mean()


def between(a: Tensor, b: Tensor) -> float:
    """Angle between two vectors (3,) [rad]."""
    return math.atan2(float(torch.linalg.cross(a, b).norm()), float(a @ b))
