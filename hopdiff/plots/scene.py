"""What the pictures of a run over the ground share: figures seen by a camera, headings, footprints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from hopdiff.motion import Motion
from hopdiff.plots.body import Body
from hopdiff.plots.ground import BESIDE, camera_beside, on_ground
from hopdiff.plots.poses import contact_points
from hopdiff.plots.strip import EDGE, FILL
from hopdiff.plots.view import Array, Camera

FOOT = (0.26, 0.10)  # length and width of a footprint [m]
_GLANCE = 0.05  # seconds before and after a moment that tell where it heads


@dataclass(frozen=True)
class Footprint:
    """side: "left" or "right"; time: of touchdown [s]; place: (3,) on the ground [m]; heading: of the run [rad]."""

    side: str
    time: float
    place: Array
    heading: float

    def outline(self, scale: float = 1.0, corners: int = 20) -> Array:
        """An ellipse (K, 3) on the ground that points where the run goes; scale: how much larger than a foot."""
        angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
        along, across = (0.5 * scale * size * f(angle) for size, f in zip(FOOT, (np.cos, np.sin), strict=True))
        return self.place + on_ground(along, across, self.heading)


def ground_track(motion: Motion) -> tuple[Array, Array]:
    """The root over the ground (T, 3) [m], and where it heads (T,) [rad], without jumps by a whole turn."""
    track = motion.clip.root_position.detach().cpu().double().numpy() * np.array([1.0, 0.0, 1.0])
    half = max(1, round(_GLANCE / motion.clip.frame_time))
    frames = np.arange(len(track))
    step = track[np.minimum(frames + half, len(track) - 1)] - track[np.maximum(frames - half, 0)]
    return track, np.unwrap(np.arctan2(step[:, 0], step[:, 2]))


def footprints(motion: Motion) -> list[Footprint]:
    """Where the feet stand, in order of time."""
    times = motion.times.detach().cpu().double().numpy()
    _, heading = ground_track(motion)
    return [
        Footprint(
            phase.side,
            phase.start,
            place * np.array([1.0, 0.0, 1.0]),
            float(np.interp(0.5 * (phase.start + phase.end), times, heading)),
        )
        for phase, place in contact_points(motion)
    ]


def side_camera(motion: Motion, elevation: float, turn: float = BESIDE) -> Camera:
    """A fixed camera above a run; see `camera_beside`."""
    track, heading = ground_track(motion)
    return camera_beside(track, float(heading[0]), elevation, turn)


def draw_seen(axes: Axes, body: Body, pose: Array, camera: Camera, at: Array | None = None, order: float = 3.0) -> None:
    """Fill one figure as the camera sees it. pose: (J + E, 3) [m]; at: (2,) where the origin goes; order: z-order."""
    parts = body.parts(pose, camera)
    shift = np.zeros(2) if at is None else at
    figure = PolyCollection(
        [part.outline + shift for part in parts],
        facecolors=[FILL[part.side] for part in parts],
        edgecolors=[EDGE[part.side] for part in parts],
        linewidths=0.6,
        zorder=order,
    )
    axes.add_collection(figure, autolim=False)
