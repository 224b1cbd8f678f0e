"""What a search remembers: the states that it met, and the ways to the goal that it found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hopdiff.graph.graph import Complexes, Floats, Ints

COLUMNS = {
    "frame": np.int64,
    "place": np.complex128,
    "yaw": np.float64,
    "gone": np.float64,
    "parent": np.int64,
    "move": np.int64,
    "key": np.int64,
}


@dataclass(frozen=True)
class End:
    """A way to the goal: the node and move that it ends with, the frames of that move and where all of it would end."""

    node: int
    move: int
    passed: int
    gap: tuple[float, float]
    place: complex


class Nodes:
    """States that a search has met, as columns that grow."""

    def __init__(self) -> None:
        self.count = 0
        self._room(1024)

    def _room(self, size: int) -> None:
        for name, kind in COLUMNS.items():
            column: NDArray[Any] = np.empty(size, dtype=kind)
            column[: self.count] = getattr(self, name)[: self.count] if self.count else 0
            setattr(self, name, column)

    frame: Ints
    place: Complexes
    yaw: Floats
    gone: Floats
    parent: Ints
    move: Ints
    key: Ints

    def add(self, *values: NDArray[Any]) -> Ints:
        """Append rows, given by column; returns their numbers."""
        end = self.count + len(values[0])
        if end > len(self.frame):
            self._room(2 * end)
        for name, value in zip(COLUMNS, values, strict=True):
            getattr(self, name)[self.count : end] = value
        start, self.count = self.count, end
        return np.arange(start, end)
