"""The run moving, at true speed: one stride as a GIF that loops without a seam, and a run along a path."""

from __future__ import annotations

import math
import os
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter1d

from hopdiff.io.files import whole_file
from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.body import Array, Body
from hopdiff.plots.ground import ground_points, shadow
from hopdiff.plots.poses import sample
from hopdiff.plots.scene import Footprint, footprints, ground_track, side_camera
from hopdiff.plots.strip import EDGE, FILL
from hopdiff.plots.view import Camera

_DELAY = 3  # hundredths of a second between frames, about
_TOLERANCE = 0.005  # of the playing time
_SUPERSAMPLE = 2
_MARK = 0.5  # metres between marks on the ground, about
_ABOVE, _BESIDE, _BELOW = 0.12, 0.2, 0.1  # metres of paper around the runner
_COLOURS = (style.GROUND, *FILL.values())
_PALE = style.pale(style.GROUND, 0.68)  # the grid and the runner's shadow

_LONGEST = 12.0  # seconds shown of a run along a path
_BRIEF = 6.0  # seconds up to which it gets 25 frames a second, beyond 17: the file stays below 2 MB
_ELEVATION = math.radians(25.0)
_AROUND = 1.7  # metres of ground to either side of the runner
_FOLLOW = 0.15  # seconds over which the camera follows (standard deviation), so that it does not shake


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


def write_path_gif(
    path: str | os.PathLike[str], motion: Motion, width: int = 480, curve: ArrayLike | None = None
) -> None:
    """Draw a run along a path as a GIF: a camera of fixed direction, above and beside, goes along with the runner.

    width: of the picture [pixels]. At true speed; of a longer run only the first 12 seconds. The ground carries a
    grid of metres, the path and the footprints made so far. curve: (L, 2) points [x, z] close together on the path
    [m]; without it the track of the hips is drawn. Raises HopdiffError if the file cannot be written.
    """
    shown = min(float(motion.times[-1] - motion.times[0]), _LONGEST)
    delay = 4 if shown <= _BRIEF else 6  # hundredths of a second
    line = ground_points(curve) if curve is not None else ground_track(motion)[0]
    since = 0.01 * delay * np.arange(max(2, round(100.0 * shown / delay)), dtype=np.float64)
    frames = _path_frames(motion, line, width, since)
    with whole_file(path, "wb") as file:
        frames[0].save(
            file, format="GIF", save_all=True, append_images=frames[1:], duration=10 * delay, loop=0, disposal=1
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
    palette = _palette(_COLOURS)
    pictures = (
        _draw(body, pose, -z % mark, top, reach, mark, width) for pose, z in zip(poses, share * travel, strict=True)
    )
    return [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]


def _path_frames(motion: Motion, line: Array, width: int, since: Array) -> list[Image.Image]:
    body = Body(motion.clip.skeleton)
    camera = side_camera(motion, _ELEVATION)
    times = motion.times.detach().cpu().double().numpy()
    at = times[0] + since
    track, _ = ground_track(motion)
    poses = sample(times, body.points(motion.clip), at)
    followed = gaussian_filter1d(track, _FOLLOW / motion.clip.frame_time, axis=0, mode="nearest")
    centres = sample(times, followed, at)
    top = float((camera.project(poses)[..., 1] - camera.project(centres)[:, None, 1]).max()) + _ABOVE
    prints = footprints(motion)
    palette = _palette((*_COLOURS, style.LEFT, _PALE), shares=(0.5,))
    pictures = []
    for time, pose, centre in zip(at, poses, centres, strict=True):
        made = [step for step in prints if step.time <= time]
        picture = _draw_ground(body, camera, pose, centre, line, made, top, width)
        pictures.append(picture.quantize(palette=palette, dither=Image.Dither.NONE))
    return pictures


def _draw_ground(
    body: Body,
    camera: Camera,
    pose: Array,
    centre: Array,
    line: Array,
    prints: list[Footprint],
    top: float,
    width: int,
) -> Image.Image:
    """One frame around `centre` (3,) on the ground; top: of the picture above it [m]."""
    scale = _SUPERSAMPLE * width / (2.0 * _AROUND)
    bottom = -0.45 * _AROUND
    height = round((top - bottom) * scale / _SUPERSAMPLE)
    image = Image.new("RGB", (_SUPERSAMPLE * width, _SUPERSAMPLE * height), "white")
    canvas = ImageDraw.Draw(image)
    middle = camera.project(centre)[:2]

    def pixels(seen: Array) -> list[tuple[float, float]]:
        return [((x + _AROUND) * scale, (top - y) * scale) for x, y in seen[:, :2] - middle]

    far = 1.0 + max(_AROUND, max(top, -bottom) / math.sin(_ELEVATION)) * math.sqrt(2.0)
    for axis in (0, 2):
        for value in np.arange(math.ceil(centre[axis] - far), centre[axis] + far):
            bar = np.stack((centre - far, centre + far)) * np.array([1.0, 0.0, 1.0])
            bar[:, axis] = value
            canvas.line(pixels(camera.project(bar)), fill=_PALE, width=_SUPERSAMPLE)
    canvas.line(pixels(camera.project(line)), fill=style.GROUND, width=2 * _SUPERSAMPLE)
    canvas.polygon(pixels(camera.project(shadow(pose))), fill=_PALE)
    for step in prints:
        canvas.polygon(pixels(camera.project(step.outline())), fill=style.SIDE_COLOURS[step.side])
    for part in body.parts(pose, camera):
        canvas.polygon(pixels(part.outline), fill=FILL[part.side], outline=EDGE[part.side], width=_SUPERSAMPLE)
    return image.resize((width, height), Image.Resampling.BOX)


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


def _palette(inks: tuple[str, ...], shares: tuple[float, ...] = (0.25, 0.5, 0.75)) -> Image.Image:
    """White, the colours of the picture and what lies between them at smoothed edges: the same for all frames."""
    colours = ["#FFFFFF", *inks]
    mixed = [style.mix(a, b, share) for a, b in combinations(colours, 2) for share in shares]
    image = Image.new("P", (1, 1))
    image.putpalette(b"".join(bytes.fromhex(colour[1:]) for colour in (*colours, *mixed)))
    return image
