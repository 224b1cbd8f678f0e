"""Pictures of figures as files: numbered PNG files, an animated PNG, a sprite sheet with its index.

W3C, Portable Network Graphics, third edition (2025), for animated ones. The index has the form that TexturePacker calls
JSON (hash) and that Aseprite writes, too.
"""

from __future__ import annotations

import io
import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from hopdiff import __version__
from hopdiff.export.pictures import MOST, Figure, Picture, Stage, durations, shown
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.views import View, views_of
from hopdiff.export.write import plain
from hopdiff.io.files import whole_file, whole_folder, write_whole
from hopdiff.types import HopdiffError

WIDE = 4096  # pixels that a sheet is wide at most where nobody says how many columns it has


def write_frames(path: Path, takes: Sequence[Take], settings: ExportSettings) -> None:
    """Write a folder of PNG files, 0001.png and so on, with the view's name before the number if there are several.

    Raises HopdiffError for pictures that are too large, or a folder that cannot be written, or holds anything but
    pictures already.
    """
    if path.exists() and not (path.is_dir() and all(one.suffix == ".png" for one in path.iterdir())):
        raise HopdiffError(f"cannot write {path}: something else is there already.")
    stage = _stage(takes, settings)
    with whole_folder(path) as folder:
        for frame, pictures in enumerate(stage.pictures(stage.figures[0]), start=1):
            for view, picture in zip(stage.views, pictures, strict=True):
                before = f"{view.name}_" if len(stage.views) > 1 else ""
                (folder / f"{before}{frame:04d}.png").write_bytes(_png(picture))


def write_apng(path: Path, takes: Sequence[Take], settings: ExportSettings) -> None:
    """Write an animated PNG, whole or not at all, with several views side by side. A loop plays for ever, any other
    motion once. Raises HopdiffError for pictures that are too large, or a file that cannot be written."""
    stage = _stage(takes, settings)
    if stage.width * len(stage.views) > MOST:
        raise HopdiffError(f"pictures would be more than {MOST} pixels wide: set a smaller size, or fewer views.")
    [take] = takes
    first, *others = (Image.fromarray(np.hstack(pictures)) for pictures in stage.pictures(stage.figures[0]))
    data = io.BytesIO()
    first.save(
        data,
        "PNG",
        save_all=True,
        append_images=others,
        duration=durations(take),
        loop=0 if take.loop else 1,
    )
    write_whole(path, data.getvalue())


def write_sprites(path: Path, takes: Sequence[Take], settings: ExportSettings) -> None:
    """Write a sprite sheet and beside it the index, of the same name with .json.

    Each motion begins a new row in each view. The index has a duration [ms] and a pivot (0 to 1 from the upper left
    corner, the point on the ground) for every frame, and an animation and a tag for every motion and view. Raises
    HopdiffError for a sheet that is too large, or files that cannot be written.
    """
    stage = _stage(takes, settings)
    strips = [(figure, view) for figure in stage.figures for view in stage.views]
    longest = max(shown(take) for take in takes)
    columns = min(longest, settings.columns or max(1, WIDE // stage.width))
    rows = [-(-shown(figure.take) // columns) for figure, _ in strips]
    width, height = columns * stage.width, sum(rows) * stage.height
    if max(width, height) > MOST:
        raise HopdiffError(
            f"the sheet would be {width} x {height} pixels, more than {MOST}: set a smaller size or fps, fewer views,"
            " or other columns."
        )
    sheet = np.zeros((height, width, 4), dtype=np.uint8)
    firsts = dict(zip(strips, np.cumsum([0, *rows[:-1]]).tolist(), strict=True))
    for figure in stage.figures:
        for frame, pictures in enumerate(stage.pictures(figure)):
            for view, picture in zip(stage.views, pictures, strict=True):
                x, y = _corner(stage, firsts[figure, view], frame, columns)
                sheet[y : y + stage.height, x : x + stage.width] = picture
    index = _index(path.name, stage, firsts, columns, (width, height))
    # Neither is there before both are written.
    with whole_file(path, "wb") as picture_file, whole_file(path.with_suffix(".json")) as index_file:
        picture_file.write(_png(sheet))
        index_file.write(json.dumps(index, indent=1, allow_nan=False) + "\n")


def pictures_of_views(takes: Sequence[Take], settings: ExportSettings) -> int:
    """How many pictures there are where each view has its own."""
    return len(views_of(settings.view, "view")) * sum(shown(take) for take in takes)


def apng_pictures(takes: Sequence[Take], _: ExportSettings) -> int:
    """How many pictures an animated PNG has: all views are side by side in each."""
    return sum(shown(take) for take in takes)


def _stage(takes: Sequence[Take], settings: ExportSettings) -> Stage:
    return Stage.of(takes, views_of(settings.view, "view"), settings.size, centred=settings.root == "in_place")


def _corner(stage: Stage, first_row: int, frame: int, columns: int) -> tuple[int, int]:
    """Upper left corner of a frame in the sheet [pixels]."""
    return frame % columns * stage.width, (first_row + frame // columns) * stage.height


def _index(
    image: str, stage: Stage, firsts: dict[tuple[Figure, View], int], columns: int, size: tuple[int, int]
) -> dict[str, Any]:
    """What the index holds. firsts: the first row of each motion in each view."""
    box = {"w": stage.width, "h": stage.height}
    pivot = {"x": stage.pivot[0] / stage.width, "y": stage.pivot[1] / stage.height}
    frames: dict[str, Any] = {}
    animations: dict[str, list[str]] = {}
    tags: list[dict[str, Any]] = []
    names = dict(zip(stage.figures, _told_apart([plain(figure.take.name) for figure in stage.figures]), strict=True))
    for (figure, view), row in firsts.items():
        take = figure.take
        tag = names[figure] + (f"_{view.name}" if len(stage.views) > 1 else "")
        animations[tag] = [f"{tag}_{frame:04d}" for frame in range(1, shown(take) + 1)]
        tags.append(
            {"name": tag, "from": len(frames), "to": len(frames) + shown(take) - 1, "direction": "forward"}
            | ({} if take.loop else {"repeat": "1"})
            | _told(take, stage.scale)
        )
        for frame, (name, duration) in enumerate(zip(animations[tag], durations(take), strict=True)):
            x, y = _corner(stage, row, frame, columns)
            frames[name] = {
                "frame": {"x": x, "y": y, **box},
                "rotated": False,
                "trimmed": False,
                "spriteSourceSize": {"x": 0, "y": 0, **box},
                "sourceSize": box,
                "duration": duration,
                "pivot": pivot,
                "anchor": pivot,  # as PixiJS calls it
            }
    meta = {
        "app": "hopdiff",
        "version": __version__,
        "image": image,
        "format": "RGBA8888",
        "size": {"w": size[0], "h": size[1]},
        "scale": "1",
        "frameTags": tags,
        "pixels_per_metre": stage.scale,
    }
    return {"frames": frames, "animations": animations, "meta": meta}


def _told_apart(names: Sequence[str]) -> list[str]:
    """Names of which no two are alike: those that are get numbers that no other name has."""
    found: list[str] = []
    for name in names:
        numbered = (f"{name}_{number}" for number in itertools.count(1))
        free = (one for one in numbered if one not in found and one not in names)
        found.append(name if names.count(name) == 1 else next(free))
    return found


def _told(take: Take, scale: float) -> dict[str, Any]:
    """Whether a motion loops, and how fast to move its sprite in a view from the side, so that feet stand still."""
    speed = take.numbers.get("speed")
    return {"loop": take.loop} | ({"pixels_per_second": scale * speed} if isinstance(speed, int | float) else {})


def _png(picture: Picture) -> bytes:
    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG")
    return data.getvalue()
