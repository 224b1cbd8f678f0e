"""The run moving, at true speed: one stride as a loop without a seam, and a run along a path."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter1d

from hopdiff.motion import Motion
from hopdiff.plots import style
from hopdiff.plots.body import Body
from hopdiff.plots.film import Film
from hopdiff.plots.ground import ground_points, shadow
from hopdiff.plots.poses import sample
from hopdiff.plots.relief import laid, lying
from hopdiff.plots.scene import footprints, ground_track, side_camera
from hopdiff.plots.strip import EDGE, FILL
from hopdiff.plots.view import Array, Camera, numbers
from hopdiff.terrain.ground import Ground

_PACE = 0.03  # seconds from one picture of a stride to the next, about
_SUPERSAMPLE = 2
_MARK = 0.5  # metres between marks on the ground, about
_ABOVE, _BESIDE, _BELOW = 0.12, 0.2, 0.1  # metres of paper around the runner
_COLOURS = (style.GROUND, *FILL.values())
_PALE = style.pale(style.GROUND, 0.68)  # the grid and the runner's shadow

_BRIEF = 6.0  # seconds up to which a run along a path gets 25 pictures a second, beyond 17: the file stays below 2 MB
_BRISK, _CALM = 0.04, 0.06  # seconds from one of them to the next
_ELEVATION = math.radians(25.0)
_AROUND = 1.7  # metres of ground to either side of the runner
_BENDS = 160  # points of a line of the grid on uneven ground
_FOLLOW = 0.15  # seconds over which the camera follows (standard deviation), so that it does not shake


def stride_film(motion: Motion, caption: tuple[str, ...] = ()) -> Film:
    """One stride seen from the runner's right, the camera beside the runner, as a loop without a seam.

    caption: lines over the pictures; the last one goes on with how long the stride is.
    """
    body = Body(motion.clip.skeleton)
    times, points = numbers(motion.times), body.points(motion.clip)
    root = numbers(motion.clip.root_position)[:, 2]
    travel, duration = root[-1] - root[0], float(times[-1] - times[0])
    relative = points[..., 2] - (root[0] + travel * (times - times[0]) / duration)[:, None]
    top = float(points[..., 1].max()) + _ABOVE
    reach = float(np.abs(relative).max()) + _BESIDE
    # A whole number of marks passes in a stride, or the ground would jump at the seam.
    mark = travel / max(1, round(travel / _MARK))

    def draw(moments: Array, width: int) -> Iterator[Image.Image]:
        share = moments / duration
        poses = sample(times, points, times[0] + duration * (share % 1.0))
        poses[..., 2] -= (root[0] + travel * (share % 1.0))[:, None]
        for pose, z in zip(poses, share * travel, strict=True):
            yield _draw(body, pose, -z % mark, top, reach, mark, width)

    lines = (*caption[:-1], f"{caption[-1]}; a stride of {duration:.3f} s at true speed") if caption else ()
    return Film(duration, True, (_PACE, 1 / 60), _COLOURS, (0.25, 0.5, 0.75), draw, lines)


def path_film(
    motion: Motion, curve: ArrayLike | None = None, caption: tuple[str, ...] = (), ground: Ground | None = None
) -> Film:
    """A run along a path: a camera of fixed direction, above and beside, goes along with the runner.

    The ground carries a grid of metres, the path and the footprints made so far. curve: (L, 2) points [x, z] close
    together on the path [m]; without it the track of the hips is drawn. caption: lines over the pictures. ground: what
    the runner stands on.
    """
    body = Body(motion.clip.skeleton)
    camera = side_camera(motion, _ELEVATION)
    times, points = numbers(motion.times), body.points(motion.clip)
    duration = float(times[-1] - times[0])
    track = laid(ground_track(motion)[0], ground)
    followed = gaussian_filter1d(track, _FOLLOW / motion.clip.frame_time, axis=0, mode="nearest")
    line = laid(ground_points(curve), ground) if curve is not None else track
    top = float((camera.project(points)[..., 1] - camera.project(followed)[:, None, 1]).max()) + _ABOVE
    prints = [(step, lying(step.outline(), ground)) for step in footprints(motion)]

    def draw(moments: Array, width: int) -> Iterator[Image.Image]:
        at = times[0] + moments
        for time, pose, centre in zip(at, sample(times, points, at), sample(times, followed, at), strict=True):
            made = [(step.side, outline) for step, outline in prints if step.time <= time]
            yield _draw_ground(body, camera, pose, centre, line, made, top, width, ground)

    pace = _BRISK if duration <= _BRIEF else _CALM
    return Film(duration, False, (pace, 1 / 30), (*_COLOURS, style.LEFT, _PALE), (0.5,), draw, caption)


def _draw_ground(
    body: Body,
    camera: Camera,
    pose: Array,
    centre: Array,
    line: Array,
    prints: list[tuple[str, Array]],
    top: float,
    width: int,
    ground: Ground | None,
) -> Image.Image:
    """One frame around `centre` (3,) on the ground; top: of the picture above it [m]. prints: side and outline."""
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
            bar = np.linspace(centre - far, centre + far, 2 if ground is None or ground.flat else _BENDS)
            bar[:, axis] = value
            canvas.line(pixels(camera.project(laid(bar, ground))), fill=_PALE, width=_SUPERSAMPLE)
    canvas.line(pixels(camera.project(line)), fill=style.GROUND, width=2 * _SUPERSAMPLE)
    canvas.polygon(pixels(camera.project(shadow(pose, ground))), fill=_PALE)
    for side, outline in prints:
        canvas.polygon(pixels(camera.project(outline)), fill=style.SIDE_COLOURS[side])
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
