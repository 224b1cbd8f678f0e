"""Galleries: pages of pictures and numbers, each made by one command whose run folder is kept."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image
from tqdm import tqdm

from experiments.report import markdown, read_table, words

CLIPS = "{clips}"  # in a command: the folder of captured clips
Numbers = Mapping[str, Mapping[str, Any]]  # shot name -> what its metrics.json holds


@dataclass(frozen=True)
class Shot:
    """One command and the picture that is taken from its run folder.

    overrides: what follows `python -m hopdiff`; "{NAME}" stands for the run folder of another shot of the gallery.
    picture: file in the run folder, None for a shot of which only the numbers are used; a pattern such as
    "*/strip.png" puts the pictures of a sweep below each other, and so do several names with blanks. width: there.
    """

    name: str
    overrides: tuple[str, ...]
    caption: str
    picture: str | None = "strip.png"
    width: int = 900


@dataclass(frozen=True)
class Entry:
    """A figure. shows: what the original shows; seen: what ours measures; differs: where and why ours does.

    seen gets the metrics of the gallery's shots by name.
    """

    figure: str
    title: str
    shows: str
    shots: tuple[Shot, ...]
    seen: Callable[[Numbers], str]
    differs: str = ""
    table: tuple[tuple[str, str, str], ...] = ()  # metric, heading, format: a column each


@dataclass(frozen=True)
class Gallery:
    """name: the module, and the folder below outputs/ of its run folders. head: of the page; source: what it shows.

    needs_clips: whether its commands take captured clips, "{clips}/NAME.bvh", from a folder that the user gives.
    """

    name: str
    head: str
    source: str
    entries: tuple[Entry, ...]
    home: Path
    needs_clips: bool = False

    @property
    def runs(self) -> Path:
        return Path("outputs") / self.name


def build(gallery: Gallery, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line of a gallery: makes the runs that lack, then README.md and pictures/. Returns what was typed."""
    parser = argparse.ArgumentParser(
        prog=f"python -m experiments.{gallery.name}",
        description="Build the gallery: makes the runs that lack, then README.md and pictures/.",
    )
    parser.add_argument("--figures", type=words, help="only these, such as 3.4,5.1; the gallery then holds no others")
    parser.add_argument("--keep", action="store_true", help="leave all other figures as they are on the page")
    parser.add_argument("--runs", type=Path, default=gallery.runs, help="folder of the runs; finished ones are kept")
    parser.add_argument("--out", type=Path, default=gallery.home, help="folder of the gallery")
    if gallery.needs_clips:
        parser.add_argument("--clips", type=Path, help="folder of the captured clips; without it what needs none")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="settings put to every command")
    given = parser.parse_args(arguments)
    clips: Path | None = getattr(given, "clips", None)
    entries = [entry for entry in gallery.entries if not given.figures or entry.figure in given.figures]
    if unknown := set(given.figures or ()) - {entry.figure for entry in entries}:
        known = ", ".join(entry.figure for entry in gallery.entries)
        parser.error(f"no figure {', '.join(sorted(unknown))}; there are {known}")
    if gallery.needs_clips and clips is None:
        # A run of our own takes the place of a clip; a way through rooms needs more than that.
        entries = [entry for entry in entries if not any(word.startswith("clips=") for word in _words(entry))]
    folders: dict[str, Path] = {}
    for shot in tqdm([shot for entry in entries for shot in entry.shots], unit="run", disable=None):
        folders[shot.name] = make(shot, given.runs, given.set, clips)
    write_gallery(given.out, gallery, entries, folders, given.keep)
    print(f"{len(entries)} figures from {len(folders)} commands: {given.out / 'README.md'}")
    return given


def _words(entry: Entry) -> list[str]:
    return [word for shot in entry.shots for word in shot.overrides]


def make(shot: Shot, runs: Path, settings: Sequence[str] = (), clips: Path | None = None) -> Path:
    """The run folder of a shot; runs its command unless it is there and whole."""
    folder = runs / shot.name
    if not (folder / "done").is_file():
        wanted = [word for word in shot.overrides if clips is not None or CLIPS not in word]
        overrides = [word.format_map(_Folders(runs, clips)) for word in wanted]
        places = [f"hydra.run.dir={folder}", f"hydra.sweep.dir={folder}"]
        command = [sys.executable, "-m", "hopdiff", *overrides, *settings, *places]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{shot.name}: python -m hopdiff {' '.join(overrides)}\n{done.stderr.strip()}")
        (folder / "summary.txt").write_text(done.stdout, encoding="utf-8")
        (folder / "done").touch()
    return folder


class _Folders(dict[str, str]):
    """The run folder of a shot by its name, and the folder of the clips."""

    def __init__(self, runs: Path, clips: Path | None) -> None:
        super().__init__(clips=str(clips))
        self.runs = runs

    def __missing__(self, name: str) -> str:
        return str(self.runs / name)


def write_gallery(
    out: Path, gallery: Gallery, entries: Sequence[Entry], folders: Mapping[str, Path], keep: bool = False
) -> None:
    """Write README.md and pictures/ into a folder. folders: run folder by shot. keep: the other figures of the page."""
    (out / "pictures").mkdir(parents=True, exist_ok=True)
    page = out / "README.md"
    before = sections(page.read_text(encoding="utf-8")) if keep and page.is_file() else {}
    shown = [entry for entry in gallery.entries if entry in entries or anchor(entry) in before]
    numbers = {name: read_numbers(folder) for name, folder in folders.items()}
    made = f"Made at {commits(folders.values())}."
    if old := before.get("", ""):
        only = ", ".join(entry.figure for entry in entries)
        made = f"{old.removesuffix('.')}; {only} at {commits(folders.values())}."
    parts = [gallery.head, made, "\n".join(f"- [{e.figure} {e.title}](#{anchor(e)})" for e in shown)]
    for entry in shown:
        if entry not in entries:
            parts.append(before[anchor(entry)])
            continue
        for shot in entry.shots:
            if shot.picture:
                patterns = shot.picture.split()
                found = [file for pattern in patterns for file in sorted(folders[shot.name].glob(pattern))]
                shrink(found, out / "pictures" / f"{shot.name}.png", shot.width)
        parts.append(section(gallery, entry, {shot.name: numbers[shot.name] for shot in entry.shots}))
    (out / "README.md").write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")


def sections(page: str) -> dict[str, str]:
    """The sections of a page by their anchors; under "" the line that names the commits."""
    head, *rest = page.split("\n## ")
    found = {"": next((line for line in head.splitlines() if line.startswith("Made at ")), "")}
    for part in rest:
        found[heading_anchor(part.splitlines()[0])] = f"## {part.strip()}"
    return found


def commits(folders: Iterable[Path]) -> str:
    """The commits that runs, or sweeps of them, were made at, as their git.json tells it."""
    found: dict[str, None] = {}
    for folder in folders:
        for path in sorted(folder.rglob("git.json")):
            state = json.loads(path.read_text(encoding="utf-8"))
            changed = " with changes" if state.get("dirty") else ""
            found[f"{state['commit'][:7]}{changed}" if state["checkout"] else "no commit"] = None
    return ", ".join(found)


def read_numbers(folder: Path) -> dict[str, Any]:
    """metrics.json of a run; of a sweep the rows of its comparison, as {"rows": [...]}, without failed runs."""
    if (folder / "metrics.json").is_file():
        numbers: dict[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        return numbers
    rows = read_table(folder / "compare" / "comparison.csv")
    return {"rows": [row for row in rows if row["status"] == "complete"]}


def anchor(entry: Entry) -> str:
    """What a Markdown page makes of the entry's heading."""
    return heading_anchor(f"{entry.figure} {entry.title}")


def heading_anchor(heading: str) -> str:
    return "".join(c for c in heading.lower() if c.isalnum() or c in " -").replace(" ", "-")


def section(gallery: Gallery, entry: Entry, numbers: Mapping[str, Mapping[str, Any]]) -> str:
    parts = [f"## {entry.figure} {entry.title}"]
    for shot in entry.shots:
        if shot.picture:
            parts.append(f"![{shot.caption}](pictures/{shot.name}.png)")
        parts.append(f"{shot.caption}\n\n```\n{command(shot, gallery.runs)}\n```")
    parts.append(f"**{gallery.source}:** {entry.shows}")
    parts.append(f"**Here:** {entry.seen(numbers)}")
    if entry.table:
        parts.append(table(entry, numbers))
    if entry.differs:
        parts.append(f"**Different:** {entry.differs}")
    return "\n\n".join(part.strip() for part in parts)


def command(shot: Shot, runs: Path) -> str:
    """The command as a reader would type it. runs: the folder of the run folders."""
    bare = [word.replace(f"{CLIPS}/", "") for word in shot.overrides]
    overrides = [word.replace("{", f"{runs}/").replace("}", "") for word in bare]
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
        picture = opened(source)
        pictures.append(scaled(picture, width) if picture.width > width else picture)
    write_small(laid_out(pictures), target)


def opened(source: Path) -> Image.Image:
    with Image.open(source) as image:
        return image.convert("RGB")


def scaled(picture: Image.Image, width: int) -> Image.Image:
    """A picture at another width, as high as that makes it."""
    return picture.resize((width, round(picture.height * width / picture.width)), Image.Resampling.LANCZOS)


def laid_out(pictures: Sequence[Image.Image], beside: bool = False) -> Image.Image:
    """Pictures on one sheet, below each other or beside each other."""
    wide, high = (sum if beside else max), (max if beside else sum)
    sheet = Image.new("RGB", (wide(p.width for p in pictures), high(p.height for p in pictures)), "white")
    left = top = 0
    for picture in pictures:
        sheet.paste(picture, (left, top))
        left, top = (left + picture.width, top) if beside else (left, top + picture.height)
    return sheet


def write_small(sheet: Image.Image, target: Path) -> None:
    """Write a picture in few colours."""
    # The octree keeps thin lines of different colours apart, which the other palettes merge.
    palette = sheet.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette.save(target, optimize=True)
