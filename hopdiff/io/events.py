"""TensorBoard events of a run: scalars a step, the settings with what they reached, and the pictures."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from torch.utils.tensorboard import SummaryWriter

from hopdiff.types import HopdiffError


def write_events(
    folder: Path,
    scalars: Sequence[Mapping[str, float]] = (),
    settings: Mapping[str, Any] | None = None,
    metrics: Mapping[str, float] | None = None,
    pictures: Mapping[str, Path] | None = None,
) -> None:
    """Write event files into a folder; they appear there when they are complete.

    scalars: one table of tag -> value a step. settings, metrics: the run's row of the HParams table.
    pictures: tag -> image file. Raises HopdiffError if the folder cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix=".events-", dir=folder) as draft:
            with SummaryWriter(draft) as writer:
                for step, row in enumerate(scalars):
                    for tag, value in row.items():
                        writer.add_scalar(tag, value, step)
                for tag, path in (pictures or {}).items():
                    with Image.open(path) as image:
                        writer.add_image(tag, np.asarray(image.convert("RGB")), dataformats="HWC")
                if settings:
                    writer.add_hparams(dict(settings), dict(metrics or {}), run_name=".")
            for file in Path(draft).iterdir():
                os.replace(file, folder / file.name)
    except OSError as error:
        raise HopdiffError(f"cannot write TensorBoard events to {folder}: {error.strerror or error}.") from error
