"""Shaded pictures of triangles with a transparent background, drawn by NumPy alone.

What draws meshes in Python otherwise needs a graphics card or OpenGL, or is larger than all of hopdiff. A z-buffer of
OVER x OVER samples a pixel is all that a figure needs: a picture of 128 pixels takes about 0.04 s on one core.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hopdiff.export.colours import GAMMA

Floats = NDArray[np.float64]

OVER = 4  # samples along a side of a pixel
SAMPLES = 500_000  # that are drawn at once, which bounds the memory
LIGHT = np.array([0.40, 0.72, 0.57])  # towards the lamp: right, up, towards the eye
LAMP, SKY, GROUND, RIM = 0.75, 0.42, 0.16, 0.15  # shares of light from it, from above, from below, and along the rim
BLEED = 2  # pixels by which colours reach into what is transparent


def drawn(
    points: Floats, normals: Floats, faces: NDArray[np.int64], colours: Floats, width: int, height: int
) -> NDArray[np.uint8]:
    """(height, width, 4) red, green, blue and alpha, not multiplied by alpha.

    points: (V, 3) of vertices: pixels to the right, pixels down, nearness in pixels. normals: (V, 3) to the right, up
    and towards the eye. faces: (F, 3), counter-clockwise for who sees their outside; others are not drawn. colours:
    (V, 3) linear. Colours go on for BLEED pixels beyond the edge, where alpha is 0, so that programs that mix
    neighbouring pixels find no dark fringe.
    """
    rows = max(1, SAMPLES // (width * OVER**2))
    bands = []
    for top in range(0, height, rows):
        moved = (points - np.array([0.0, top, 0.0])) * OVER
        size = width * OVER, min(rows, height - top) * OVER
        bands.append(_band(moved, normals, faces, colours, *size))
    return _encoded(np.concatenate(bands))


def _band(
    points: Floats, normals: Floats, faces: NDArray[np.int64], colours: Floats, width: int, height: int
) -> Floats:
    """(height / OVER, width / OVER, 4) linear colours times coverage, and coverage; all lengths in samples."""
    corners = points[faces]
    low = np.ceil(corners[..., :2].min(axis=1) - 0.5).clip(0)
    high = np.floor(corners[..., :2].max(axis=1) - 0.5).clip(-1, (width - 1, height - 1))
    side = corners[:, 1:, :2] - corners[:, :1, :2]
    area = side[:, 0, 0] * side[:, 1, 1] - side[:, 0, 1] * side[:, 1, 0]
    # Rows count downwards: what faces us turns clockwise.
    kept = (area < -1e-9) & (high >= low).all(axis=-1)
    faces, corners, side, area = faces[kept], corners[kept], side[kept], area[kept]
    low, high = low[kept].astype(np.int64), high[kept].astype(np.int64)
    # Shares of the second and third corner are linear over the picture: x * slope[0] + y * slope[1] + start.
    slope = np.stack((side[:, 1, [1, 0]] * [1.0, -1.0], side[:, 0, [1, 0]] * [-1.0, 1.0]), axis=1) / area[:, None, None]
    start = -(slope * corners[:, :1, :2]).sum(axis=-1)

    def shares(face: NDArray[np.int64], x: NDArray[np.int64], y: NDArray[np.int64]) -> list[Floats]:
        b, c = ((x + 0.5) * slope[face, k, 0] + (y + 0.5) * slope[face, k, 1] + start[face, k] for k in (0, 1))
        return [1.0 - b - c, b, c]

    wide, tall = (high - low + 1).T
    count = wide * tall
    face = np.repeat(np.arange(len(faces)), count)
    within = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    x, y = low[face, 0] + within % wide[face], low[face, 1] + within // wide[face]
    parts = shares(face, x, y)
    inside = np.minimum(np.minimum(parts[0], parts[1]), parts[2]) >= -1e-9
    face, x, y = face[inside], x[inside], y[inside]
    near = sum(part[inside] * corners[face, k, 2] for k, part in enumerate(parts))
    found = np.full(width * height, -1, dtype=np.int64)
    if len(face):
        # The nearest face of a sample wins: nearness above, number of the face below.
        rank = (near - near.min()) / max(float(np.ptp(near)), 1e-9) * 2.0**30
        np.maximum.at(found, y * width + x, (rank.astype(np.int64) << 32) | face)
    at = np.flatnonzero(found >= 0)
    face = found[at] & 0xFFFFFFFF
    parts = shares(face, at % width, at // width)
    normal, colour = (
        sum(part[:, None] * values[faces[face, k]] for k, part in enumerate(parts)) for values in (normals, colours)
    )
    whole = np.zeros((width * height, 4))
    whole[at, :3], whole[at, 3] = _shaded(np.asarray(normal), np.asarray(colour)), 1.0
    rows: Floats = whole.reshape(height // OVER, OVER, -1).sum(axis=1)
    blocks: Floats = rows.reshape(height // OVER, width // OVER, OVER, 4).sum(axis=2) / OVER**2
    return blocks


def _shaded(normals: Floats, colours: Floats) -> Floats:
    """Linear colours of a dull surface (Lambert) between bright sky and dark ground, lighter where it turns away."""
    normals = normals / np.linalg.norm(normals, axis=-1, keepdims=True).clip(1e-12)
    lamp = (normals @ (LIGHT / np.linalg.norm(LIGHT))).clip(0.0)
    above = 0.5 + 0.5 * normals[:, 1]
    light = LAMP * lamp + GROUND + (SKY - GROUND) * above
    rim = RIM * above * (1.0 - normals[:, 2].clip(0.0)) ** 4
    lit: Floats = (colours * light[:, None] + rim[:, None]).clip(0.0, 1.0)
    return lit


def _encoded(whole: Floats) -> NDArray[np.uint8]:
    """As files hold it, with colours that reach into what is transparent."""
    total = whole
    for _ in range(BLEED):
        padded = np.pad(total, ((1, 1), (1, 1), (0, 0)))
        around = sum(
            padded[1 + dy : padded.shape[0] - 1 + dy, 1 + dx : padded.shape[1] - 1 + dx]
            for dy in (-1, 0, 1)
            for dx in (-1, 0, 1)
        )
        total = np.where(total[..., 3:] > 0.0, total, around)
    colour = (total[..., :3] / total[..., 3:].clip(1e-12)).clip(0.0, 1.0) ** (1.0 / GAMMA)
    picture: NDArray[np.uint8] = np.round(255.0 * np.concatenate((colour, whole[..., 3:]), axis=-1)).astype(np.uint8)
    return picture
