"""Pelvis, waist, chest, shoulders and neck: one surface."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hopdiff.export.anatomy import SPINE
from hopdiff.export.body.build import DENSITY, SHORT, UP, Build, thickness, unit
from hopdiff.export.body.head import Skull
from hopdiff.export.body.limbs import THIGH, UPPER_ARM
from hopdiff.export.body.loft import Floats, Rings, Shape, around, eased, loft, moved

# Of a trunk: height above the hips in that of the base of the neck; half width as a mix of that of the hips and that of
# the chest; reach ahead and back in the half width of the hips; and how square its section is.
TRUNK = np.array(
    [
        (-0.125, 0.28, 0.0, 0.34, 0.36, 2.0),
        (-0.085, 0.54, 0.0, 0.45, 0.48, 2.1),
        (-0.04, 0.79, 0.0, 0.54, 0.58, 2.1),
        (0.02, 0.96, 0.0, 0.605, 0.65, 2.2),
        (0.08, 1.0, 0.0, 0.635, 0.66, 2.3),
        (0.16, 0.92, 0.0, 0.62, 0.57, 2.2),
        (0.25, 0.77, 0.02, 0.585, 0.5, 2.2),
        (0.34, 0.6, 0.12, 0.57, 0.47, 2.2),
        (0.43, 0.46, 0.3, 0.585, 0.49, 2.2),
        (0.53, 0.27, 0.58, 0.64, 0.55, 2.3),
        (0.63, 0.1, 0.86, 0.7, 0.61, 2.4),
        (0.72, 0.0, 1.0, 0.74, 0.65, 2.5),
        (0.79, 0.0, 1.02, 0.725, 0.66, 2.5),
        (0.86, 0.0, 1.04, 0.63, 0.66, 2.5),
        (0.92, 0.0, 1.08, 0.52, 0.61, 2.5),
    ]
)
RISE = 0.25  # of the base of a neck above the arms, in half the distance of those, at least
CHEST = 0.86  # half width of the chest in that of the shoulders' joints
# Bumps of the trunk: place to the side in the half width of the hips, height, ahead or back; how far it rises, in the
# same half width; its half width to the side in that, and in height.
BUMPS = (
    (0.47, 0.78, 1.0, 0.08, 0.33, 0.08),  # breast
    (0.46, 0.02, -1.0, 0.08, 0.36, 0.09),  # buttock
    (0.55, 0.76, -1.0, 0.05, 0.3, 0.1),  # shoulder blade
)
FURROW = 0.035  # depth of the furrow along it, in the half width of the hips
EASE = 0.4  # of the way from joint to joint of the spine in which the skin goes over, either way


def trunk(body: Build, skull: Skull | None) -> None:
    """The trunk with the neck, up into a head if there is one; if hips and shoulders are there."""
    parts = body.parts
    hips, tops = [f"{side}_hip" for side in ("left", "right")], [f"{side}_shoulder" for side in ("left", "right")]
    if "pelvis" not in parts or not all(part in parts for part in (*hips, *tops)):
        return
    low, shoulders = (0.5 * (body.at(pair[0]) + body.at(pair[1])) for pair in (hips, tops))
    top = neck_base(body)
    if top is None or (length := float(np.linalg.norm(top - low))) < 1e-3:
        return
    up = (top - low) / length
    aside = body.left - (body.left @ up) * up
    left = unit(aside)
    ahead = np.cross(left, up)
    wide = 0.5 * abs(float((body.at(tops[0]) - body.at(tops[1])) @ left))
    thighs = max(body.bone("left_hip", "left_knee"), 1e-3)
    thigh = thickness(body.masses[hips[0]], thighs, THIGH)
    hip = 0.5 * body.bone(*hips) + 0.94 * thigh
    if min(float(np.linalg.norm(aside)), wide, hip) < SHORT:
        return
    shoulder = float((shoulders - low) @ up) / length
    cap = thickness(body.masses[tops[0]], max(body.bone("left_shoulder", "left_elbow"), 1e-3), UPPER_ARM)
    # Up to the arms by the table, scaled to where they are; then over the shoulders and up the neck.
    outline = TRUNK.copy()
    above = outline[:, 0] > 0.0
    outline[above, 0] *= shoulder / 0.9
    chest = max(CHEST * wide, 0.7 * hip)
    half = outline[:, 1] * hip + outline[:, 2] * chest
    # Children have less of a waist.
    waist = above & (half < 0.92 * min(hip, chest))
    half[waist] += min(1.0, 3.5 * body.young) * (0.92 * min(hip, chest) - half[waist])
    rows = np.stack((half, outline[:, 3] * hip, outline[:, 4] * hip), axis=-1)
    area = np.trapezoid(math.pi * 0.5 * rows[:, 0] * (rows[:, 1] + rows[:, 2]), outline[:, 0] * length)
    deep = (body.masses["pelvis"] + body.masses["waist"]) / DENSITY / area
    # A trunk that is too light or too heavy is so in width as well.
    rows[:, 1:] *= np.clip(deep, 0.75, 1.35)
    rows[:, :1] *= np.clip(deep / np.clip(deep, 0.75, 1.35), 0.6, 1.7)
    centre = low + outline[:, :1] * length * up
    across, front, power = np.tile(left, (len(rows), 1)), np.tile(ahead, (len(rows), 1)), outline[:, 5]
    over = _shoulders(rows[-1], up, left, ahead, wide, cap, shoulders, top, skull)
    centre, across, front = (np.concatenate(pair) for pair in zip((centre, across, front), over[:3], strict=True))
    rows, power = np.concatenate((rows, over[3])), np.concatenate((power, over[4]))
    rings = Rings(centre, across, front, rows[:, [0, 0]], rows[:, 1:], np.stack((power, power), axis=-1))
    shape = loft(rings, around(22), 0.04 * length, 0.02 * length, (0.6,))
    _bumps(shape, low, up * length, left * hip, ahead, 1.0 - min(1.0, 8.0 * body.young))
    line = list(dict.fromkeys(parts[name] for name in SPINE if name in parts))
    body.made["middle"].append(moved(shape, _shares(body, shape, low, up, line, wide)))
    inside = {
        parts[part]
        for part in (*SPINE[:-1], *hips, *tops, *(f"{s}_collar" for s in ("left", "right")))
        if part in parts
    }
    # Whatever lies between them, too: a joint of the spine without a name of its own.
    body.covered |= inside | {joint for part in inside for joint in body.skeleton.above(part)}


def neck_base(body: Build) -> Floats | None:
    """(3,) where the neck begins: its joint, or a little above the arms where that is lower or not known."""
    neck = body.at("neck") if "neck" in body.parts else None
    if "left_shoulder" not in body.parts or "right_shoulder" not in body.parts:
        return neck
    shoulders = 0.5 * (body.at("left_shoulder") + body.at("right_shoulder"))
    found: Floats = shoulders + RISE * float(np.linalg.norm(body.at("left_shoulder") - shoulders)) * UP
    return found if neck is None or neck[1] < found[1] else neck


def _shoulders(
    last: Floats,
    up: Floats,
    left: Floats,
    ahead: Floats,
    wide: float,
    cap: float,
    shoulders: Floats,
    top: Floats,
    skull: Skull | None,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Sections over the shoulders and up the neck: centres, axes, reaches and exponents. last: reach of the section
    below; cap: thickness of the upper arms [m]."""
    neck = 0.3 * wide if skull is None else skull.neck
    # Heights above the base of the neck: the slope goes from the tops of the arms to the sides of the neck.
    arms = float((shoulders - top) @ up) + 0.88 * cap
    table = [
        # Share of the way from the arms' tops to the neck's side in height and width, reach ahead and back.
        (0.0, 0.0, 0.8, 0.88),
        (0.3, 0.22, 0.66, 0.76),
        (0.55, 0.46, 0.5, 0.64),
        (0.78, 0.72, 0.32, 0.48),
        (1.0, 0.9, 0.12, 0.3),
    ]
    high = max(0.55 * neck, arms + 0.6 * neck)
    start = 0.95 * wide
    rows, heights, power = [], [], []
    for rise, narrow, front, back in table:
        heights.append(arms + rise * (high - arms))
        rows.append(
            (
                start + narrow * (1.06 * neck - start),
                neck + front * (last[1] - neck),
                neck + back * (last[2] - neck),
            )
        )
        power.append(2.4 - 0.3 * rise)
    centre = top + np.array(heights)[:, None] * up
    if skull is not None:
        # Up into the skull, a little ahead.
        share = np.array([0.3, 0.65, 1.0])[:, None]
        target = skull.at(0.42, -0.12)
        centre = np.concatenate((centre, centre[-1] + share * (target - centre[-1])))
        rows += [
            (neck, 0.98 * neck, 0.97 * neck),
            (0.97 * neck, 0.95 * neck, 0.9 * neck),
            (0.9 * neck, 0.9 * neck, 0.7 * neck),
        ]
        power += [2.0] * 3
    else:
        centre = np.concatenate((centre, centre[-1:] + 0.4 * neck * up))
        rows.append((0.8 * neck, 0.8 * neck, 0.8 * neck))
        power.append(2.0)
    count = len(rows)
    return centre, np.tile(left, (count, 1)), np.tile(ahead, (count, 1)), np.array(rows), np.array(power)


def _bumps(shape: Shape, low: Floats, up: Floats, left: Floats, ahead: Floats, grown: float) -> None:
    """Raise what stands out of a trunk. up: (3,) from the hips to the base of the neck; left: half width of the hips
    [m]; grown: share of the bumps of a grown-up."""
    hip = float(np.linalg.norm(left))
    off = shape.vertices - low
    height, aside, front = off @ up / (up @ up), off @ left / hip**2, off @ ahead
    rise = np.zeros(len(off))
    for x, y, way, size, wide, tall in BUMPS:
        for sign in (1.0, -1.0):
            here = np.exp(-(((aside - sign * x) / wide) ** 2) - ((height - y) / tall) ** 2)
            rise += grown * way * size * here * eased(way * front / (0.3 * hip))
    furrow = np.exp(-((aside / 0.2) ** 2)) * eased((height + 0.02) / 0.1) * eased((0.95 - height) / 0.2)
    rise += FURROW * furrow * eased(-front / (0.3 * hip))
    shape.vertices[:] += (hip * rise)[:, None] * ahead


def _shares(body: Build, shape: Shape, low: Floats, up: Floats, line: Sequence[int], wide: float) -> dict[int, Floats]:
    """Shares of the joints of the spine in vertices: that of the highest joint below them, eased over at the joints;
    at the shoulders with the collarbones."""
    height = (shape.vertices - low) @ up
    heights = [float((body.places[joint] - low) @ up) for joint in line]
    shares: dict[int, Floats] = {line[0]: np.ones(len(height))}
    for k in range(1, len(line)):
        room = EASE * max(heights[k] - heights[k - 1], 1e-6)
        past = eased(0.5 + 0.5 * (height - heights[k]) / room)
        shares = {joint: share * (1.0 - past) for joint, share in shares.items()}
        shares[line[k]] = shares.get(line[k], np.zeros(len(height))) + past
    for side in ("left", "right"):
        if f"{side}_collar" not in body.parts:
            continue
        shoulder = body.at(f"{side}_shoulder")
        aside = (shape.vertices - low) @ body.outwards(side)
        near = eased((aside / wide - 0.35) / 0.5) * eased(
            1.0 - np.abs((shape.vertices - shoulder) @ up) / (0.75 * wide)
        )
        shares = {joint: share * (1.0 - 0.9 * near) for joint, share in shares.items()}
        shares[body.parts[f"{side}_collar"]] = 0.9 * near
    return shares
