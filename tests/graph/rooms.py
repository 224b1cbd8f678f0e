"""Small scenes for tests of ways."""

from __future__ import annotations

import numpy as np

from hopdiff.graph.scene import Passage, Scene, Wall, check_scene


def rectangle(x: float, z: float, wide: float, long: float) -> np.ndarray:
    return np.array([[x, z], [x + wide, z], [x + wide, z + long], [x, z + long]], dtype=float)


def hall(wide: float = 6.0, long: float = 14.0, **more: object) -> Scene:
    """One long room."""
    scene = Scene("hall", {"hall": rectangle(0.0, 0.0, wide, long)}, **more)  # type: ignore[arg-type]
    check_scene(scene)
    return scene


def two_rooms(width: float = 1.2, door: bool = True) -> Scene:
    """Rooms of 4 x 4 m with a metre of wall between them and a door in its middle."""
    rooms = {"near": rectangle(0.0, 0.0, 4.0, 4.0), "far": rectangle(0.0, 5.0, 4.0, 4.0)}
    passages = {"door": Passage(("near", "far"), (2.0, 4.0), (2.0, 5.0), width)} if door else {}
    scene = Scene("rooms", rooms, passages)
    check_scene(scene)
    return scene


def split_hall() -> Scene:
    """A hall with a wall across it that leaves 1.5 m free at one side, and a table."""
    walls = {"across": Wall((0.0, 6.0), (4.5, 6.0), 0.2)}
    return hall(6.0, 12.0, walls=walls, furniture={"table": rectangle(2.0, 8.5, 1.0, 1.0)})
