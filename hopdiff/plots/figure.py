"""The standing character with its joints, as in Kang (1999), figure 2.1."""

from __future__ import annotations

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hopdiff.character import Character
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.joint_names import side_of
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.scene import draw_seen
from hopdiff.plots.view import FRONT, RIGHT, Array, Camera

_TALL = 6.5  # inches of the standing body
_ASIDE = 0.06  # body heights from the outline to the names
_ROOM = 0.2  # body heights for a name
_TICK = 0.25  # metres
_LINE = 0.035  # body heights between two names, at least
_DOT = style.SERIES[4]


def character_figure(character: Character) -> Figure:
    """The character at rest, from the front and from its right side, its joints as dots with their names.

    From the front the character's left is on the right. The scale counts metres above the ground; height, mass and
    leg length stand in the title.
    """
    body = Body(character.skeleton)
    pose = _rest(character, body)
    height = character.height
    title = f"{character.name}: {height:.2f} m tall, {character.mass:.0f} kg, legs of {character.leg_length:.2f} m"
    views = (("from the front", FRONT), ("from the right", RIGHT))
    columns = [
        max(np.abs(part.outline[:, 0]).max() for part in body.parts(pose, c)) + _ASIDE * height for _, c in views
    ]
    halves = [column + _ROOM * height for column in columns]
    top = max(float(pose[:, 1].max()), height) * 1.05
    bottom = -0.04 * height
    scale = _TALL / height  # inches in a metre
    figure = style.new_figure(scale * 2 * sum(halves) + 1.0, scale * (top - bottom) + 1.0, title)
    panels = figure.subplots(1, 2, sharey=True, width_ratios=halves)
    for axes, (name, camera), column, half in zip(panels, views, columns, halves, strict=True):
        style.tidy(axes, grid=False)
        axes.set(xlim=(-half, half), ylim=(bottom, top), aspect="equal")
        axes.set_xticks([])
        axes.tick_params(length=0)
        axes.spines[["left", "bottom"]].set_visible(False)
        axes.set_xlabel(name)
        axes.grid(axis="y", color=style.FAINT, linewidth=0.8)
        axes.set_axisbelow(True)
        axes.axhline(0.0, color=style.GROUND, linewidth=2.0, zorder=1)
        draw_seen(axes, body, pose, camera)
        flat = camera.project(pose)[: len(body.joint_names), :2]
        axes.plot(*flat.T, "o", markersize=7, color=_DOT, markeredgecolor="white", zorder=5)
        _names(axes, list(body.joint_names), flat, camera, column, _LINE * height)
    panels[0].set_yticks(np.arange(0.0, top, _TICK))
    panels[0].set_ylabel("height [m]")
    return figure


def _rest(character: Character, body: Body) -> Array:
    """(J + E, 3) points of the standing body, above the origin [m]."""
    skeleton = character.skeleton
    identity = torch.eye(3, dtype=skeleton.offsets.dtype, device=skeleton.offsets.device)
    rotations = identity.expand(1, len(skeleton.names), 3, 3)
    found: Array = body.points(Clip(skeleton, skeleton.offsets[:1], rotations, 1.0))[0]
    return found


def _names(axes: Axes, joints: list[str], flat: Array, camera: Camera, column: float, apart: float) -> None:
    """Names beside the dots, tied to them by thin lines: those of the limbs from the front, the others from aside.

    column: distance of the names from the middle [m]; apart: of one name from the next, at least [m].
    """
    shown = {"left": 1.0, "right": -1.0} if camera == FRONT else {"middle": 1.0}
    for side, sign in shown.items():
        y = -np.inf
        for joint in sorted((j for j, name in enumerate(joints) if side_of(name) == side), key=lambda j: flat[j, 1]):
            y = max(float(flat[joint, 1]), y + apart)
            axes.annotate(
                joints[joint].replace("_", " "),
                (float(flat[joint, 0]), float(flat[joint, 1])),
                (sign * column, y),
                ha="left" if sign > 0 else "right",
                va="center",
                fontsize=10,
                color=style.INK,
                arrowprops={"arrowstyle": "-", "color": style.GROUND, "linewidth": 0.8, "shrinkA": 2, "shrinkB": 4},
                zorder=6,
            )
