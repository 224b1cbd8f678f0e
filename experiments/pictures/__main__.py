"""The pictures of the project's front pages: `python -m experiments.pictures --clips FOLDER`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from experiments.gallery import CLIPS, Shot, command, commits, laid_out, make, opened, scaled, write_small
from experiments.report import markdown

HERE = Path(__file__).parent
Share = tuple[float, float]


class Sheet(NamedTuple):
    """One picture: files of run folders side by side or below each other, at a width.

    ends: where in its height the upper part of a file ends, somewhere between two shares; of the others all is taken.
    """

    name: str
    shots: tuple[Shot, ...]
    width: int
    beside: bool = False
    ends: Mapping[str, Share] = {}


def beta(value: float) -> Shot:
    return Shot(f"beta_{value:g}", ("speed=3.5", f"beta={value:g}", "animation=none"), "")


SHEETS = (
    Sheet("brisk", (Shot("brisk", ("+experiment=brisk", "animation=none"), ""),), 1400),
    Sheet("beta", (beta(0.2), beta(0.5), beta(0.7)), 1300, ends={"strip.png": (0.36, 0.48)}),
    Sheet(
        "path",
        (
            Shot(
                "path", ("+experiment=path", "path.points=[[0,0],[2,6],[-2,12],[0,18]]", "path.time=5"), "", "along.png"
            ),
        ),
        1000,
    ),
    Sheet(
        "edit",
        (
            Shot(
                "edit",
                ("+experiment=kim2021/fig_2a", f"clip={CLIPS}/walk_straight_cmu_16_15.bvh"),
                "",
                "path.png strip.png",
            ),
        ),
        1100,
        beside=True,
        ends={"path.png": (0.6, 0.8)},
    ),
)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m experiments.pictures", description=__doc__)
    parser.add_argument("--clips", type=Path, required=True, help="folder of walk_straight_cmu_16_15.bvh")
    parser.add_argument("--runs", type=Path, default=Path("outputs/pictures"), help="run folders; finished ones stay")
    parser.add_argument("--out", type=Path, default=HERE, help="folder of the pictures and README.md")
    options = parser.parse_args(arguments)
    # All runs before any picture: a picture that is written changes the checkout that the next run would record.
    made = [[make(shot, options.runs, clips=options.clips) for shot in sheet.shots] for sheet in SHEETS]
    rows = []
    for sheet, folders in zip(SHEETS, made, strict=True):
        files = [name.split() for name in (shot.picture or "" for shot in sheet.shots)]
        paths = [folder / name for folder, names in zip(folders, files, strict=True) for name in names]
        save(sheet, paths, options.out / f"{sheet.name}.png")
        commands = [f"`{command(shot, options.runs)}`" for shot in sheet.shots]
        rows.append((f"{sheet.name}.png", ", ".join(commands), ", ".join(files[0]), commits(folders)))
    table = markdown(("picture", "command", "file", "at commit"), rows)
    (options.out / "README.md").write_text(f"{HEAD}\n{table}\n{TAIL}", encoding="utf-8")


HEAD = """# Pictures of the front pages

Written by `python -m experiments.pictures --clips FOLDER`, with FOLDER as in [kim2021](../kim2021/README.md); the files
of the runs made smaller, of `strip.png` in `beta.png` and `path.png` in `edit.png` the upper part.
"""
TAIL = """`export.png` are the two pictures of [exports](../exports/README.md) side by side, put together by hand.
"""


def upper(picture: Image.Image, ends: Share) -> Image.Image:
    """What is above the widest blank band of a picture between two shares of its height."""
    first, last = (round(picture.height * share) for share in ends)
    ink = (np.asarray(picture)[first:last] < 255).any((1, 2))
    rows = np.flatnonzero(np.concatenate(([True], ink, [True])))
    widest = int(np.diff(rows).argmax())
    return picture.crop((0, 0, picture.width, first + int(rows[widest] + rows[widest + 1]) // 2))


def save(sheet: Sheet, files: Sequence[Path], target: Path) -> None:
    """Lay pictures out and write them small."""
    pictures = [opened(file) for file in files]
    pictures = [
        upper(picture, sheet.ends[file.name]) if file.name in sheet.ends else picture
        for file, picture in zip(files, pictures, strict=True)
    ]
    if sheet.beside:
        height = min(picture.height for picture in pictures)
        pictures = [scaled(picture, round(picture.width * height / picture.height)) for picture in pictures]
    write_small(scaled(laid_out(pictures, sheet.beside), sheet.width), target)


if __name__ == "__main__":
    main()
