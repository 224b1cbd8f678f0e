"""A page that plays takes in a browser."""

from collections.abc import Sequence
from pathlib import Path

from hopdiff.errors import HopdiffError
from hopdiff.export.take import Take


def write_player(path: Path, takes: Sequence[Take], together: str = "side_by_side") -> None:
    raise HopdiffError(f"{path}: the player is not built yet")
