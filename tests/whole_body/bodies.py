"""Movements that the tests of the whole body start from: a run, a walk, a hop and a limp that can be solved."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import torch
from omegaconf import OmegaConf
from torch import Tensor

from hopdiff.character import Character
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort.problem import BodyProblem
from hopdiff.whole_body.layout import Layout
from hopdiff.whole_body.model import BodyModel
from hopdiff.whole_body.movement import Body, Movement
from hopdiff.whole_body.plan import HOP, LIMP, PLANS, RUN, WALK
from tests.builders import settings_of

DTYPE = torch.float64
UP = torch.tensor([0.0, 9.81, 0.0], dtype=DTYPE)
NAMES = (RUN.name, WALK.name, HOP.name, LIMP.name)
SPEEDS = {"run": 3.5, "walk": 1.3, "hop": 1.5, "limp": 3.5}
ROUNDS = 30
LIMP_AMOUNT = 0.2

# A jog, in the units of the gene table: where the gene table begins may change, these do not.
START: dict[str, float | tuple[float, ...]] = {
    "step_time": 1.15,
    "contact_share": 0.66,
    "force_2": 0.0,
    "force_3": 0.0,
    "force_4": 0.0,
    "aim_below": 0.1,
    "aim_sway": 0.0,
    "foot_touchdown": 12.0,
    "foot_settle": 5.0,
    "foot_slap": 30.0,
    "foot_rise": 3.5,
    "reach_touchdown": 0.987,
    "reach_takeoff": 0.988,
    "step_width": 0.065,
    "swing_thigh": (-25, -5, 20, 35, 35),
    "swing_knee": (55, 85, 85, 55, 20),
    "swing_ankle": (-15, -8),
    "pelvis_tilt": 6.0,
    "pelvis_roll_cos": 0.0,
    "pelvis_roll_sin": 0.0,
    "pelvis_yaw_cos": 0.0,
    "pelvis_yaw_sin": 0.0,
    "trunk_lean": 8.0,
    "shoulder_mean": -10.0,
    "shoulder_cos": -20.0,
    "shoulder_sin": 0.0,
    "elbow_mean": 85.0,
    "elbow_cos": 0.0,
    "elbow_sin": 0.0,
    "arm_abduction": 12.0,
    "arm_inward": 20.0,
}
# What the movements change of it, in the same units but for the step time [s] and the step width [m]. A walk stands on
# nearly straight legs, and leaves the ground with a bent knee.
CHANGES: dict[str, dict[str, float | tuple[float, ...]]] = {
    "run": {
        "pelvis_roll_cos": 2.0,
        "pelvis_yaw_sin": -3.0,
        "swing_knee": (70, 104, 100, 62, 22),
        "swing_ankle": (-8, 0),
    },
    "walk": {
        "step_time": 0.55,
        "contact_share": 1.2,
        "force_3": 0.4,
        "aim_below": 0.4,
        "foot_touchdown": 18.0,
        "foot_settle": 6.0,
        "foot_rise": 4.0,
        "reach_touchdown": 0.978,
        "reach_takeoff": 0.945,
        "step_width": 0.1,
        "swing_thigh": (-9, 6, 24, 35, 38),
        "swing_knee": (50, 72, 75, 58, 28),
        "swing_ankle": (2, 3),
        "pelvis_tilt": 4.0,
        "trunk_lean": 3.0,
        "shoulder_mean": 0.0,
        "shoulder_cos": -25.0,
        "elbow_mean": 30.0,
    },
    "hop": {
        "step_time": 0.42,
        "contact_share": 0.6,
        "foot_touchdown": -5.0,
        "foot_settle": 3.0,
        "foot_slap": 10.0,
        "foot_rise": 3.0,
        "reach_takeoff": 0.97,
        "swing_thigh": (-10, -4, 6, 16, 20),
        "swing_knee": (20, 30, 35, 28, 15),
        "swing_ankle": (-8, -3),
        "trunk_lean": 10.0,
        "shoulder_cos": -20.0,
    },
    "limp": {
        "pelvis_roll_cos": 2.0,
        "shoulder_cos": -25.0,
        "reach_touchdown": 0.972,
        "swing_knee": (50, 85, 90, 60, 28),
        "swing_ankle": (-8, 0),
    },
}


@cache
def body_problem(*overrides: str) -> BodyProblem:
    """The problem that these overrides of the command line stand for; at beta 0.2 nothing is searched for."""
    problem = build_job(compose(["model=body", *overrides])).problem
    assert isinstance(problem, BodyProblem)
    return problem


def plain_problem() -> BodyProblem:
    return body_problem("speed=3.5", "beta=0.2")


@cache
def layout_of(name: str = "human", **changed: float) -> Layout:
    """The layout of a character in conf/character, with settings changed; keys with a dot as `proportions__legs`."""
    settings = OmegaConf.create(settings_of("character", name))
    for key, value in changed.items():
        OmegaConf.update(settings, key.replace("__", "."), value)
    parts = dict.fromkeys(("legs", "arms", "trunk", "head"), 1.0)
    settings.proportions = {**parts, **(settings.get("proportions") or {})}
    return Layout.of(Character.build(settings))


def spread_out(name: str, value: float | tuple[float, ...]) -> dict[str, float]:
    """A gene, or a row of them that are numbered from 1."""
    if isinstance(value, tuple):
        return {f"{name}_{k}": number for k, number in enumerate(value, 1)}
    return {name: value}


def values_of(name: str) -> dict[str, float]:
    """Every gene of a movement by name, in the units above."""
    found: dict[str, float] = {}
    for key, value in (START | CHANGES[name]).items():
        found |= spread_out(key, value)
    return found


def genes_of(name: str, count: int = 1, wobble: float = 0.0) -> dict[str, Tensor]:
    """Genes (count,) of a movement in SI units and rad, the first as above, the others off by `wobble` box widths."""
    problem = plain_problem()
    table = problem.table
    physical = values_of(name)
    scale = dict(zip(table.names, table.scale.tolist(), strict=True))
    if "step_time" in CHANGES[name]:
        scale["step_time"] = 1.0
    if "step_width" in CHANGES[name]:
        scale["step_width"] = 1.0
    noise = torch.randn(count, table.dimension, generator=torch.Generator().manual_seed(4), dtype=DTYPE) * wobble
    noise[0] = 0.0
    ranges = (table.high - table.low) * table.scale
    return {gene: physical[gene] * scale[gene] + noise[:, k] * ranges[k] for k, gene in enumerate(table.names)}


def movement_of(
    name: str, genes: dict[str, Tensor], layout: Layout | None = None, speed: Tensor | None = None
) -> Movement:
    """The movement of a plan, not yet solved; a limp of a fifth on the left leg."""
    character = plain_problem().character
    count = len(genes["step_time"])
    speed = torch.full((count,), SPEEDS[name], dtype=DTYPE) if speed is None else speed
    if name == "limp":
        return BodyModel.limping(character, ROUNDS, 8, "left", LIMP_AMOUNT).movement(genes, speed)
    plan = PLANS[name]
    return Movement(layout or plain_problem().model.layout, plan, genes, speed, plan.durations(genes))


class Solved(NamedTuple):
    movement: Movement
    body: Body
    moved: Tensor


@cache
def solved(name: str, count: int = 1, wobble: float = 0.0) -> Solved:
    """A movement after 30 rounds."""
    movement = movement_of(name, genes_of(name, count, wobble))
    state, moved = movement.solve(ROUNDS)
    return Solved(movement, movement.body(state), moved)


def axis_turn(axis: int, angle: Tensor) -> Tensor:
    """(..., 3, 3) right-handed rotation matrix about axis 0 (left), 1 (up) or 2 (forward)."""
    one, none, c, s = torch.ones_like(angle), torch.zeros_like(angle), angle.cos(), angle.sin()
    rows = {
        0: (one, none, none, none, c, -s, none, s, c),
        1: (c, none, s, none, one, none, -s, none, c),
        2: (c, -s, none, s, c, none, none, none, one),
    }[axis]
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def matrices(frames: Tensor) -> Tensor:
    """(P, S, M, 3, 3) rotation matrices from frames (P, S, 3, 3, M) that hold an axis a row."""
    return frames.permute(0, 1, 4, 3, 2)


def spins(movement: Movement, frames: Tensor) -> Tensor:
    """(P, S, M, 3) angular velocities of frames, from the rate of their rotation matrices: R' R^T is its matrix."""
    rates = matrices(movement.grid.derivative(frames))
    skew = rates @ matrices(frames).transpose(-1, -2)
    return torch.stack((skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]), dim=-1)


def centre_of(movement: Movement, body: Body) -> Tensor:
    """(P, 3, M) the centre of mass of the segments."""
    masses = movement.layout.masses
    return (masses[:, None, None] * body.centres).sum(1) / masses.sum()


def degrees(angle: Tensor) -> float:
    return math.degrees(float(angle))
