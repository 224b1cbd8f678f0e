"""The run moving: a GIF that loops without a seam, at true speed."""

from __future__ import annotations

import os

import numpy as np
from PIL import Image, ImageDraw

from hopdiff.io.files import whole_file
from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.body import Array, Body
from hopdiff.plots.poses import sample
from hopdiff.plots.strip import FILL

_RATE = 33.0  # frames a second, about
_SUPERSAMPLE = 2
_MARK = 0.5  # metres between marks on the ground


def write_gif(path: str | os.PathLike[str], motion: Motion, width: int = 480) -> None:
    """Draw one stride seen from the runner's right, the camera beside the runner, as an endless GIF.

    width: of the picture [pixels]. GIF knows hundredths of a second only, so single frames are shown a hundredth
    longer or shorter and the stride keeps its time to half a hundredth. Raises HopdiffError if the file cannot be
    written.
    """
    stride = float(motion.times[-1] - motion.times[0])
    frames = _frames(motion, stride, width)
    edges = np.round(100.0 * stride * np.arange(len(frames) + 1) / len(frames)).astype(int)
    delays = (10 * np.maximum(np.diff(edges), 2)).tolist()
    with whole_file(path, "wb") as file:
        frames[0].save(file, format="GIF", save_all=True, append_images=frames[1:], duration=delays, loop=0, disposal=1)


def _frames(motion: Motion, stride: float, width: int) -> list[Image.Image]:
    body = Body(motion.clip.skeleton)
    times = motion.times.detach().cpu().double().numpy()
    points = body.points(motion.clip)
    root = motion.clip.root_position.detach().cpu().double().numpy()
    travel = float(root[-1, 2] - root[0, 2])
    count = max(4, round(stride * _RATE))
    # The last frame is the first of the next stride: it is left to the loop.
    moments = times[0] + stride * np.arange(count) / count
    poses = sample(times, points, moments)
    camera = root[0, 2] + travel * np.arange(count) / count
    top = float(points[..., 1].max()) + 0.12
    reach = float(np.abs(poses[..., 2] - camera[:, None]).max()) + 0.2
    # A whole number of marks passes in a stride, or the ground would jump at the seam.
    mark = travel / max(1, round(travel / _MARK))
    pictures = [_draw(body, pose, z, top, reach, mark, width) for pose, z in zip(poses, camera, strict=True)]
    palette = pictures[0].quantize(32, dither=Image.Dither.NONE)
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def _draw(body: Body, pose: Array, camera: float, top: float, reach: float, mark: float, width: int) -> Image.Image:
    scale = _SUPERSAMPLE * width / (2.0 * reach)
    below = 0.1
    size = (_SUPERSAMPLE * width, round((top + below) * scale))
    image = Image.new("RGB", size, "white")
    canvas = ImageDraw.Draw(image)

    def pixels(outline: Array) -> list[tuple[float, float]]:
        return [((z - camera + reach) * scale, (top - y) * scale) for z, y in outline]

    line = max(1, round(0.012 * scale))
    canvas.line(pixels(np.array([[camera - reach, 0.0], [camera + reach, 0.0]])), fill=style.GROUND, width=line)
    for k in range(int(np.floor((camera - reach) / mark)), int(np.ceil((camera + reach) / mark)) + 1):
        canvas.line(pixels(np.array([[k * mark, 0.0], [k * mark - 0.05, -0.06]])), fill=style.GROUND, width=line)
    for part in body.parts(pose):
        canvas.polygon(pixels(part.outline), fill=FILL[part.side], outline="white", width=_SUPERSAMPLE)
    return image.resize((width, round(size[1] / _SUPERSAMPLE)), Image.Resampling.LANCZOS)
