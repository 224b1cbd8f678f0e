"""Numbers of a picture, and cameras: from where it is seen."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

Array = NDArray[np.float64]


def numbers(values: Tensor | ArrayLike) -> Array:
    """A tensor, wherever it is, or anything like an array, in float64."""
    return np.asarray(values.detach().cpu() if isinstance(values, Tensor) else values, dtype=np.float64)


@dataclass(frozen=True)
class Camera:
    """An orthographic camera: no vanishing point, so equal lengths stay equal wherever they are.

    azimuth: where it stands around the runner [rad]: 0 in front (towards +z), pi/2 to the left (+x), pi behind,
    -pi/2 to the right. elevation: how far above the horizon [rad]; pi/2 looks straight down.
    """

    azimuth: float
    elevation: float = 0.0

    @property
    def axes(self) -> Array:
        """(3, 3) rows: the world's directions that point right and up in the picture, and towards the viewer."""
        sin_a, cos_a = math.sin(self.azimuth), math.cos(self.azimuth)
        sin_e, cos_e = math.sin(self.elevation), math.cos(self.elevation)
        return np.array(
            (
                (cos_a, 0.0, -sin_a),
                (-sin_e * sin_a, cos_e, -sin_e * cos_a),
                (cos_e * sin_a, sin_e, cos_e * cos_a),
            )
        )

    def project(self, points: Array) -> Array:
        """World points (..., 3) as (..., 3): right and up in the picture, and how near to the viewer [m]."""
        return np.asarray(points @ self.axes.T)

    def nearness(self, points: Array) -> Array:
        """How near the viewer points (..., 3) are, measured along the ground (...) [m].

        What covers what among upright things: where two of them meet in the picture, the one nearer along the ground
        is the nearer one, whatever their heights.
        """
        return np.asarray(points @ np.array((math.sin(self.azimuth), 0.0, math.cos(self.azimuth))))


FRONT = Camera(0.0)
BEHIND = Camera(math.pi)
RIGHT = Camera(-math.pi / 2)
