"""The colours of bodies, which tell left from right."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLOURS = {"left": "#0072B2", "right": "#D55E00", "middle": "#8C92A0"}  # those of the pictures
GAMMA = 2.2  # between linear colours, which files of bodies hold, and those on screen


def linear(side: str) -> NDArray[np.float64]:
    """(3,) red, green and blue of the colour of a side, 0 to 1, by how much light they are."""
    shares: NDArray[np.float64] = np.array([int(COLOURS[side][k : k + 2], 16) / 255.0 for k in (1, 3, 5)]) ** GAMMA
    return shares
