"""The run moving: a GIF that loops without a seam, at true speed."""

from __future__ import annotations

import os
from itertools import combinations

import numpy as np
from PIL import Image, ImageDraw

from hopdiff.io.files import whole_file
from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.body import Array, Body
from hopdiff.plots.poses import sample
from hopdiff.plots.strip import EDGE, FILL

_DELAY = 3  # hundredths of a second between frames, about
_TOLERANCE = 0.005  # of the playing time
_SUPERSAMPLE = 2
_MARK = 0.5  # metres between marks on the ground, about
_ABOVE, _BESIDE, _BELOW = 0.12, 0.2, 0.1  # metres of paper around the runner
_COLOURS = (style.GROUND, *FILL.values())


def write_gif(path: str | os.PathLike[str], motion: Motion, width: int = 480) -> None:
    """Draw the run seen from the runner's right, the camera beside the runner, as an endless GIF.

    width: of the picture [pixels]. The loop is one stride long, or a few where the whole hundredths of a second of
    the format would put one stride off by more than half a percent. Raises HopdiffError if the file cannot be
    written.
    """
    strides, delays = loop_timing(float(motion.times[-1] - motion.times[0]))
    frames = _frames(motion, strides, delays, width)
    milliseconds = [10 * delay for delay in delays]
    with whole_file(path, "wb") as file:
        frames[0].save(
            file, format="GIF", save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, disposal=1
        )


def loop_timing(stride: float) -> tuple[int, list[int]]:
    """How many strides a loop takes, and the delay after each of its frames [1/100 s]. stride: its time [s]."""
    for strides in range(1, 10):
        total = max(2, round(100.0 * strides * stride))
        if abs(total / (100.0 * strides * stride) - 1.0) <= _TOLERANCE:
            break
    # The remainder is spread over the loop, so no single moment stutters.
    count = max(2, round(total / _DELAY))
    edges = [round(total * frame / count) for frame in range(count + 1)]
    return strides, np.diff(edges).tolist()


def _frames(motion: Motion, strides: int, delays: list[int], width: int) -> list[Image.Image]:
    body = Body(motion.clip.skeleton)
    times = motion.times.detach().cpu().double().numpy()
    root = motion.clip.root_position[:, 2].detach().cpu().double().numpy()
    travel = root[-1] - root[0]
    points = body.points(motion.clip)
    # Every pose belongs to the moment when its frame comes up; the end of the loop is its start again, so not drawn.
    share = strides * np.cumsum([0, *delays[:-1]]) / sum(delays)
    poses = sample(times, points, times[0] + (times[-1] - times[0]) * (share % 1.0))
    poses[..., 2] -= (root[0] + travel * (share % 1.0))[:, None]

    top = float(points[..., 1].max()) + _ABOVE
    reach = float(np.abs(poses[..., 2]).max()) + _BESIDE
    # A whole number of marks passes in a loop, or the ground would jump at the seam.
    mark = strides * travel / max(1, round(strides * travel / _MARK))
    palette = _palette()
    pictures = (
        _draw(body, pose, -z % mark, top, reach, mark, width) for pose, z in zip(poses, share * travel, strict=True)
    )
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def _draw(body: Body, pose: Array, first: float, top: float, reach: float, mark: float, width: int) -> Image.Image:
    """One frame. pose: z from the camera; first: a mark on the ground, from the camera; all in metres."""
    scale = _SUPERSAMPLE * width / (2.0 * reach)
    height = round((top + _BELOW) * scale / _SUPERSAMPLE)
    image = Image.new("RGB", (_SUPERSAMPLE * width, _SUPERSAMPLE * height), "white")
    canvas = ImageDraw.Draw(image)

    def pixels(outline: Array) -> list[tuple[float, float]]:
        return [((z + reach) * scale, (top - y) * scale) for z, y in outline]

    line = max(1, round(0.012 * scale))
    canvas.line(pixels(np.array([[-reach, 0.0], [reach, 0.0]])), fill=style.GROUND, width=line)
    count = int(np.ceil((reach + mark) / mark))
    for z in first + mark * np.arange(-count, count + 1):
        canvas.line(pixels(np.array([[z, 0.0], [z - 0.05, -0.06]])), fill=style.GROUND, width=line)
    for part in body.parts(pose):
        canvas.polygon(pixels(part.outline), fill=FILL[part.side], outline=EDGE[part.side], width=_SUPERSAMPLE)
    return image.resize((width, height), Image.Resampling.BOX)


def _palette() -> Image.Image:
    """White, the colours of the picture and what lies between them at smoothed edges: the same for all frames."""
    colours = ["#FFFFFF", *_COLOURS]
    mixed = [style.mix(a, b, share) for a, b in combinations(colours, 2) for share in (0.25, 0.5, 0.75)]
    image = Image.new("P", (1, 1))
    image.putpalette(b"".join(bytes.fromhex(colour[1:]) for colour in (*colours, *mixed)))
    return image
