"""The gallery's README and pictures, from the run folders."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from experiments.kang1999.entries import Entry, Shot
from experiments.report import markdown, read_table

HEAD = """# Kang (1999), figure by figure

Every figure and use of Young-Min Kang's thesis, made again with hopdiff: what it took, what the thesis shows, what
comes out here, and where the two differ. Written by `python -m experiments.kang1999` from the run folders that it
makes; edit `entries.py`, not this page. Each command stands under its picture and works by itself; the settings are in
`conf/experiment/kang1999/`.

`model=thesis` steps the equations as printed, with the misprints put right; beside it, where both apply, stands
`model=smooth`, the same ideas made periodic and differentiable. The thesis leaves open the vertical speed at
touchdown, the path of the swinging leg, the masses of the body and which numbers its search was free to choose, and
prints no table: its pictures cannot be met line by line, only in what they show.
"""


def write_gallery(out: Path, entries: Sequence[Entry], folders: Mapping[str, Path]) -> None:
    """Write README.md and pictures/ into a folder. folders: run folder by shot."""
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    numbers = {name: read_numbers(folder) for name, folder in folders.items()}
    parts = [HEAD, "\n".join(f"- [{e.figure} {e.title}](#{anchor(e)})" for e in entries)]
    for entry in entries:
        for shot in entry.shots:
            if shot.picture:
                found = sorted(folders[shot.name].glob(shot.picture))
                shrink(found, out / "pictures" / f"{shot.name}.png", shot.width)
        parts.append(section(entry, {shot.name: numbers[shot.name] for shot in entry.shots}))
    (out / "README.md").write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")


def read_numbers(folder: Path) -> dict[str, Any]:
    """metrics.json of a run; of a sweep the rows of its comparison, as {"rows": [...]}."""
    if (folder / "metrics.json").is_file():
        numbers: dict[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        return numbers
    return {"rows": read_table(folder / "compare" / "compare.csv")}


def anchor(entry: Entry) -> str:
    """What a Markdown page makes of the entry's heading."""
    heading = f"{entry.figure} {entry.title}".lower()
    return "".join(c for c in heading if c.isalnum() or c in " -").replace(" ", "-")


def section(entry: Entry, numbers: Mapping[str, Mapping[str, Any]]) -> str:
    parts = [f"## {entry.figure} {entry.title}"]
    for shot in entry.shots:
        if shot.picture:
            parts.append(f"![{shot.caption}](pictures/{shot.name}.png)")
        parts.append(f"{shot.caption}\n\n```\n{command(shot)}\n```")
    parts.append(f"**The thesis:** {entry.thesis}")
    parts.append(f"**Here:** {entry.seen(numbers)}")
    if entry.table:
        parts.append(table(entry, numbers))
    if entry.differs:
        parts.append(f"**Different:** {entry.differs}")
    return "\n\n".join(part.strip() for part in parts)


def command(shot: Shot) -> str:
    """The command as a reader would type it."""
    overrides = [word.replace("{", "outputs/kang1999/").replace("}", "") for word in shot.overrides]
    return " ".join(("python -m hopdiff", *(f"'{word}'" if "[" in word or " " in word else word for word in overrides)))


def table(entry: Entry, numbers: Mapping[str, Mapping[str, Any]]) -> str:
    """A row for every single run among the shots."""
    rows = [
        [shot.name, *(_cell(numbers[shot.name].get(metric), form) for metric, _, form in entry.table)]
        for shot in entry.shots
        if "rows" not in numbers[shot.name]
    ]
    return markdown(["run", *(heading for _, heading, _ in entry.table)], rows)


def _cell(value: Any, form: str) -> str:
    return "-" if value is None else format(value, form)


def shrink(sources: Sequence[Path], target: Path, width: int) -> None:
    """Pictures made smaller, for a page, one below the other."""
    pictures = []
    for source in sources:
        with Image.open(source) as image:
            picture = image.convert("RGB")
        if picture.width > width:
            height = round(picture.height * width / picture.width)
            picture = picture.resize((width, height), Image.Resampling.LANCZOS)
        pictures.append(picture)
    sheet = Image.new("RGB", (max(p.width for p in pictures), sum(p.height for p in pictures)), "white")
    top = 0
    for picture in pictures:
        sheet.paste(picture, (0, top))
        top += picture.height
    # The octree keeps thin lines of different colours apart, which the other palettes merge.
    palette = sheet.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette.save(target, optimize=True)
