"""A page that plays motions in any browser: one file that needs no network.

three.js draws it; the package trimesh ships that library for pages of its own, and it is taken from there. What the
page does is in the files of page/.
"""

from __future__ import annotations

import base64
import html
import json
import re
import zipfile
from collections.abc import Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hopdiff.editing.leg_joints import SIDES
from hopdiff.editing.loop import repetitions
from hopdiff.export.anatomy import parts_of
from hopdiff.export.glb import bodies_of, body_bytes, check
from hopdiff.export.ground import ground_path
from hopdiff.export.take import Take
from hopdiff.feet.contacts import spans
from hopdiff.geometry.quaternion import quaternions
from hopdiff.io.files import write_whole
from hopdiff.io.record import finite
from hopdiff.types import HopdiffError

PAGE = Path(__file__).with_name("page")
SCRIPTS = ("camera.js", "walker.js", "stage.js", "table.js", "controls.js")  # in the order in which they run
LIBRARY = "trimesh/resources/templates/viewer.zip"
LIBRARY_BEGINS, LIBRARY_ENDS = "<script>", "var camera,controls,scene,renderer,tracklight;"
TURN = 32767  # what a component 1 of a quaternion is in the page
POINTS = 600  # of the way that is drawn on the ground, at most
SOLE = 0.13  # m: half the length of a sole of which only a point is known
SOLE_REACH, BALL_AHEAD = (
    0.93,
    0.47,
)  # half a sole in lengths from ankle to ball; the ball ahead of its middle, in such halves
# What is told of a run beside the figure: number, what it is, unit, factor, digits.
SHOWN = (
    ("speed", "Speed", "m/s", 1.0, 2),
    ("beta", "Briskness β", "", 1.0, 2),
    ("character", "Character", "", 1.0, 0),
    ("body", "Body", "", 1.0, 0),
    ("parts", "Parts found on it", "", 1.0, 0),
    ("leg_ratio", "Legs, of the source's", "", 1.0, 3),
    ("search", "Search", "", 1.0, 0),
    ("model", "Model", "", 1.0, 0),
    ("costs", "Costs", "", 1.0, 0),
    ("seed", "Seed", "", 1.0, 0),
    ("step_frequency", "Steps", "/s", 1.0, 2),
    ("step_length", "Step length", "m", 1.0, 2),
    ("contact_time", "Contact", "s", 1.0, 3),
    ("flight_time", "Flight", "s", 1.0, 3),
    ("duty_factor", "Duty factor", "", 1.0, 3),
    ("com_oscillation", "Bounce", "cm", 100.0, 1),
    ("peak_leg_force_bw", "Leg force", "body weights", 1.0, 2),
    ("energy_rate", "Energy / distance", "", 1.0, 3),
    ("energy_target", "Energy asked for", "", 1.0, 3),
    ("cost", "Cost", "", 1.0, 3),
    ("trunk_lean_deg", "Trunk lean", "°", 1.0, 1),
    ("arm_swing_deg", "Arm swing", "°", 1.0, 0),
    ("knee_swing_max_deg", "Knee in swing", "°", 1.0, 0),
)


def write_player(path: Path, takes: Sequence[Take], together: str = "side_by_side") -> None:
    """Write a page that plays takes, whole or not at all.

    together: how several takes are shown at first, side_by_side or overlaid. Raises HopdiffError if there is no take,
    a take has no frames, the drawing library is not where it was, or the file cannot be written.
    """
    write_whole(path, page(takes, together))


def page(takes: Sequence[Take], together: str = "side_by_side") -> str:
    """The text of the page; see `write_player`."""
    if not takes:
        raise HopdiffError("cannot write a page without a motion.")
    bodies, whose = bodies_of(takes)
    data = {
        "together": together,
        "bodies": [base64.b64encode(body_bytes(body)).decode("ascii") for body in bodies],
        "takes": [_told(take) | {"body": body} for take, body in zip(takes, whose, strict=True)],
    }
    parts = {
        "title": html.escape(", ".join(take.name for take in takes)),
        "style": _part("page.css"),
        "library": _library(),
        # Nothing in the data can end the element that it stands in.
        "data": json.dumps(finite(data), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c"),
        "script": "\n".join(_part(name) for name in SCRIPTS),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _part("page.html"))


def _part(name: str) -> str:
    return (PAGE / name).read_text(encoding="utf-8")


def _library() -> str:
    """three.js with its loader of glTF, as trimesh ships it, licence line first."""
    try:
        # The package itself, which takes long to import, is not needed.
        with zipfile.ZipFile(str(distribution("trimesh").locate_file(LIBRARY))) as archive:
            text = archive.read("viewer.html.template").decode("utf-8")
        begin = text.index(LIBRARY_BEGINS) + len(LIBRARY_BEGINS)
        library = text[begin : text.index(LIBRARY_ENDS)]
    except (ImportError, OSError, KeyError, ValueError, zipfile.BadZipFile):
        library = ""
    if "THREE.GLTFLoader=" not in library or "</script" in library:
        raise HopdiffError(
            "HTML pages are drawn with the three.js that trimesh ships, and the trimesh that is installed has none that"
            " is known: install the version in constraints.txt."
        )
    return library


def _told(take: Take) -> dict[str, Any]:
    """All that the page knows of a take; places on the ground are [x, z] in metres.

    Numbers of every frame are little-endian in base64: 32-bit floats, and the turns of joints as 16-bit quaternions
    (x, y, z, w), each component within 1 / 65534.
    """
    check(take)
    way, clip = ground_path(take), take.clip
    told: dict[str, Any] = {
        "name": take.name,
        "frames": take.frames,
        "frameTime": clip.frame_time,
        "joints": list(clip.skeleton.names),
        "loop": take.loop,
        "root": _packed(clip.root_position),
        "turns": _packed(TURN * quaternions(clip.rotations), "<i2"),
        "offsets": None if clip.offsets is None else _packed(clip.offsets),
        "way": _packed(way.place),
        "heading": _packed(way.yaw),
        "drawn": max(1, -(-take.frames // POINTS)),
        "steps": _steps(take),
        "height": round(float(clip.joint_positions()[..., 1].max()), 3),
        "again": None,
        **_numbers(take),
    }
    if take.loop:
        once = repetitions(take.clip, 2)[1]
        yaw = torch.atan2(once.turn[0, 2], once.turn[0, 0])
        told["again"] = {"yaw": float(yaw), "from": once.start[[0, 2]].tolist(), "to": once.here[[0, 2]].tolist()}
    return told


def _packed(values: Tensor, kind: str = "<f4") -> str:
    """Numbers of every frame as base64."""
    array = values.detach().double().cpu().numpy()
    return base64.b64encode((np.rint(array) if kind == "<i2" else array).astype(kind).tobytes()).decode("ascii")


def _rounded(values: Tensor) -> list[Any]:
    """To a tenth of a millimetre, which keeps pages small."""
    return (torch.round(values.double() * 1e4) / 1e4).tolist()


def _steps(take: Take) -> list[dict[str, Any]]:
    """Where feet stand: middle of the sole, heading [rad], half its length [m] and side, in the order of touchdowns."""
    if take.contact is None or take.feet is None:
        return []
    way, places, parts = ground_path(take).yaw, take.clip.joint_positions(), parts_of(take.clip.skeleton)
    found = []
    for k, side in enumerate(SIDES):
        ball, size = parts.get(f"{side}_toe"), SOLE
        if ball is not None:
            size = SOLE_REACH * float(take.clip.skeleton.offsets[ball].norm())
        for first, last in spans(take.contact[:, k]):
            middle = (first + last) // 2
            heading = way[middle]
            ahead = torch.stack((torch.sin(heading), torch.cos(heading)))
            # The ball does not move while the heel comes up.
            place = take.feet[middle, k] if ball is None else places[middle, ball]
            place = place[[0, 2]] - (0.0 if ball is None else BALL_AHEAD * size) * ahead
            told = {"place": _rounded(place), "heading": round(float(heading), 4), "size": round(size, 4)}
            found.append({"frame": first, "side": side, **told})
    return sorted(found, key=lambda step: step["frame"])


def _numbers(take: Take) -> dict[str, list[list[str]]]:
    """Rows [what, value, unit] for people: the best known, and all others by their names."""
    numbers, shown, known = take.numbers, [], {entry[0] for entry in SHOWN}
    for name, what, unit, factor, digits in SHOWN:
        value = numbers.get(name)
        if isinstance(value, str):
            shown.append([what, value, unit])
        elif isinstance(value, int | float):
            shown.append([what, f"{factor * value:.{digits}f}", unit])
    shown += [
        ["Duration", f"{take.clip.duration:.2f}", "s"],
        ["Frames", f"{1.0 / take.clip.frame_time:.4g}", "/s"],
        ["Joints", str(len(take.clip.skeleton.names)), ""],
    ]
    more = [
        [name.replace("_", " "), f"{value:.5g}" if isinstance(value, float) else str(value), ""]
        for name, value in numbers.items()
        if name not in known and isinstance(value, int | float | str)
    ]
    return {"shown": shown, "more": more}
