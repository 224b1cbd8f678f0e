"""Write a figure to a file, whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib.figure import Figure

from hopdiff.io.files import whole_file
from hopdiff.types import HopdiffError

FORMATS = ("png", "svg", "pdf")


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float = 140.0) -> None:
    """Save a figure in the format that its file name ends in.

    dpi: dots an inch of a PNG. Raises HopdiffError for an unknown ending or a file that cannot be written.
    """
    ending = Path(path).suffix.lstrip(".").lower()
    if ending not in FORMATS:
        raise HopdiffError(f"cannot write {path}: a picture's name must end in .{', .'.join(FORMATS)}.")
    with whole_file(path, "wb") as file:
        figure.savefig(file, format=ending, dpi=dpi)
