"""task=body: the character itself, standing, with its joints and its measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from hopdiff.character import Character
from hopdiff.io.record import write_json, write_table
from hopdiff.io.run_folder import RunFolder
from hopdiff.messages import say
from hopdiff.numerics import GRAVITY
from hopdiff.plots.figure import character_figure
from hopdiff.plots.save import save_figure
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.results import shown

COLUMNS = ("joint", "parent", "length", "mass", "com_x", "com_y", "com_z", "inertia_x", "inertia_y", "inertia_z")


def build(call: Call) -> Work:
    """Build the body. Raises HopdiffError, naming the setting."""
    character = Character.build(call.settings.character)

    def work(folder: RunFolder) -> None:
        measures, rows = body_measures(character), joint_rows(character)
        write_table(folder.path / "body.csv", COLUMNS, rows)
        write_json(folder.path / "metrics.json", {"character": character.name, **measures})
        if call.settings.pictures:
            save_figure(character_figure(character), folder.path / "body.png")
        say(summary(character, measures, rows, folder.path))

    return work


def body_measures(character: Character) -> dict[str, float]:
    """Lengths [m], mass [kg], and the speed of Froude number 1, sqrt(g leg length) [m/s]."""
    skeleton = character.skeleton
    index = skeleton.index

    def length(*joints: str) -> float:
        return sum(float(skeleton.offsets[index(joint)].norm()) for joint in joints)

    return {
        "height": character.height,
        "mass": character.mass,
        "leg_length": character.leg_length,
        "thigh": character.thigh,
        "shank": character.shank,
        "arm_length": length("left_elbow") + float(skeleton.end_sites["left_elbow"].norm()),
        "trunk_length": length("waist", "neck"),
        "hip_width": 2.0 * character.hip_half_width,
        "shoulder_width": 2.0 * float(skeleton.offsets[index("left_shoulder")][0]),
        "froude_speed": math.sqrt(GRAVITY * character.leg_length),
    }


def joint_rows(character: Character) -> list[list[Any]]:
    """A row a joint, as COLUMNS: length to its end or to the joint farthest up or down from it [m], mass [kg], centre
    of mass in its frame [m], moments of inertia of all that hangs on it about left, up and forward [kg m^2]."""
    skeleton = character.skeleton
    rows = []
    for i, name in enumerate(skeleton.names):
        tips = [skeleton.offsets[child] for child in skeleton.children(i)]
        tips += [skeleton.end_sites[name]] if name in skeleton.end_sites else []
        parent = skeleton.names[skeleton.parents[i]] if skeleton.parents[i] >= 0 else None
        # Shoulders and hips lie beside the trunk, not at its end.
        length = float(max(tips, key=lambda tip: abs(float(tip[1]))).norm())
        numbers = torch.cat((character.masses[i : i + 1], character.coms[i], character.inertias[i]))
        rows.append([name, parent, length, *numbers.tolist()])
    return rows


def summary(character: Character, measures: Mapping[str, float], rows: list[list[Any]], folder: Path) -> str:
    """What is printed: the measures, and length and mass of every part."""
    m = measures
    lines = [
        f"{character.name}: {m['height']:.3f} m, {m['mass']:.1f} kg, legs {m['leg_length']:.3f} m, arms"
        f" {m['arm_length']:.3f} m, trunk {m['trunk_length']:.3f} m; Froude number 1 at {m['froude_speed']:.2f} m/s",
        f"{'joint':<15}{'parent':<15}{'length m':>9}{'mass kg':>9}",
    ]
    lines += [f"{name:<15}{parent or '-':<15}{length:>9.3f}{mass:>9.2f}" for name, parent, length, mass, *_ in rows]
    return "\n".join([*lines, f"files          {shown(folder)}"])


TASK = Task(build)
