"""Text of a BVH file to joints and numbers: forgiving about how it is written, strict about what it says."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from hopdiff.io.bvh_channels import BvhJoint, channel_kind
from hopdiff.io.bvh_layout import FRAME_TIME, FRAMES, Layout, layout_of
from hopdiff.io.bvh_numbers import COMMENT, LARGEST, Array, decimals_of, number, read_rows, shown
from hopdiff.types import HopdiffError

MOTION = re.compile(rb"^[ \t]*MOTION\b", re.IGNORECASE | re.MULTILINE)
WORD = re.compile(r"[{}]|[^\s{}]+")
BLOCK_WORDS = ("{", "}", "ROOT", "JOINT", "END", "OFFSET", "CHANNELS", "HIERARCHY")


@dataclass(frozen=True)
class Parsed:
    """What a file says, units and axes left open.

    values: (T, C) in the file's units and degrees. notes: for the user, on what was mended. layout: see there.
    """

    joints: tuple[BvhJoint, ...]
    values: Array
    frame_time: float
    decimals: int
    offset_decimals: int
    encoding: str
    notes: tuple[str, ...]
    layout: Layout | None


@dataclass
class _Node:
    """A joint or end site while its block is being read."""

    name: str
    index: int
    parent: int
    line: int
    is_end: bool = False
    opened: bool = False
    offset: tuple[float, float, float] | None = None
    channels: tuple[str, ...] | None = None
    ends: list[tuple[float, float, float]] = field(default_factory=list)


def parse_bvh(data: bytes, where: str) -> Parsed:
    """Read the bytes of a BVH file; where is its name, for errors.

    Raises HopdiffError, naming the line where there is one, for anything that is not a whole, sensible BVH file.
    """
    codec = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}.get(data[:2])
    if codec is not None:
        data = data[2:].decode(codec, "replace").encode("utf-8", "replace")
    raw = data
    data = data.removeprefix(b"\xef\xbb\xbf")
    if not data.strip():
        raise HopdiffError(f"{where}: the file is empty.")
    if (at := data.find(b"\0")) >= 0:
        line = data.count(b"\n", 0, at) + 1
        raise HopdiffError(f"{where}, line {line}: this is binary data, not a BVH file.")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    motion = MOTION.search(data)
    head, encoding = _decoded(data[: motion.start()] if motion else data)
    parser = _Hierarchy(head, where)
    if motion is None:
        raise HopdiffError(f"{where}, line {parser.line}: the file ends before its MOTION.")
    line = data.count(b"\n", 0, motion.start()) + 1
    joints = parser.joints(line)
    frames, said, frame_time, timed, start = _motion_head(data, motion.end(), line, where)
    channels = sum(len(joint.channels) for joint in joints)
    rows = read_rows(data[start:], timed + 1, frames, said, channels, where)
    layout = layout_of(raw, said, timed, rows.values, frame_time, rows.mended, codec)
    return Parsed(joints, rows.values, frame_time, rows.decimals, parser.decimals, encoding, rows.notes, layout)


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """The bytes of a file. Raises HopdiffError, naming it, where it cannot be read."""
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise HopdiffError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error


def _decoded(data: bytes) -> tuple[str, str]:
    """Text and encoding: names in old files are often in some code page, of which latin-1 loses nothing."""
    try:
        return data.decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


class _Hierarchy:
    """The words of the first part of a file, one after the other, and the tree that they tell."""

    def __init__(self, text: str, where: str) -> None:
        self.where = where
        self.line = 1  # of the last word taken
        self.decimals = 0
        self._lines = text.split("\n")
        self._words = [
            (at, match.group(), match.end())
            for at, line in enumerate(self._lines, start=1)
            if not line.lstrip().encode().startswith(COMMENT)
            for match in WORD.finditer(line)
        ]
        self._next = 0
        self._nodes: list[_Node] = []
        self._open: list[_Node] = []
        self._read()

    def joints(self, motion_line: int) -> tuple[BvhJoint, ...]:
        """What was read. motion_line: the line on which the hierarchy must have ended."""
        if self._open:
            raise self._wrong(f"MOTION begins before {self._called(self._open[-1])} is closed by }}", motion_line)
        if not self._nodes:
            raise self._wrong("MOTION begins, but there was no ROOT", motion_line)
        if not any(node.channels for node in self._nodes):
            raise self._wrong("no joint has CHANNELS, so there is no motion", motion_line)
        return tuple(
            BvhJoint(node.name, node.parent, node.offset or (0.0, 0.0, 0.0), node.channels or (), tuple(node.ends))
            for node in self._nodes
        )

    def _read(self) -> None:
        word = self._take()
        if word.upper() != "HIERARCHY":
            raise self._wrong(f"this is not a BVH file, which begins with HIERARCHY and not with {shown(word)}")
        while self._next < len(self._words):
            word = self._take()
            match word.upper():
                case "ROOT" | "JOINT":
                    self._begin(word.upper())
                case "END" | "ENDSITE":
                    self._begin_end()
                case "{":
                    self._open_block()
                case "}":
                    self._close_block()
                case "OFFSET":
                    self._offset()
                case "CHANNELS":
                    self._channels()
                case _:
                    raise self._wrong(f"{shown(word)} is no word of a BVH hierarchy")

    def _begin(self, keyword: str) -> None:
        name = self._rest_of_line()
        inside = self._block(keyword) if keyword == "JOINT" else None
        if inside is None and (self._nodes or self._open):
            raise self._wrong("a second ROOT begins, but only files with one skeleton can be read")
        if inside is not None and inside.is_end:
            raise self._wrong("an end site cannot hold a JOINT")
        if not name:
            raise self._wrong(f"{keyword} has no name")
        node = _Node(name, len(self._nodes), -1 if inside is None else inside.index, self.line)
        self._nodes.append(node)
        self._open.append(node)

    def _begin_end(self) -> None:
        self._rest_of_line()  # "Site", sometimes with a name
        if self._block("End Site").is_end:
            raise self._wrong("an end site cannot hold another")
        self._open.append(_Node("", -1, -1, self.line, is_end=True))

    def _open_block(self) -> None:
        if not self._open or self._open[-1].opened:
            raise self._wrong("{ stands where no joint begins")
        self._open[-1].opened = True

    def _close_block(self) -> None:
        node = self._block("}")
        if node.offset is None:
            raise self._wrong(f"{self._called(node)} has no OFFSET")
        self._open.pop()
        if node.is_end:
            self._open[-1].ends.append(node.offset)

    def _offset(self) -> None:
        node = self._block("OFFSET")
        if node.offset is not None:
            raise self._wrong(f"{self._called(node)} has a second OFFSET")
        values = [self._number("OFFSET needs three numbers") for _ in range(3)]
        if self._same_line() and self._peek().upper() not in BLOCK_WORDS:
            raise self._wrong("OFFSET needs three numbers, but there are more")
        node.offset = (values[0], values[1], values[2])

    def _channels(self) -> None:
        node = self._block("CHANNELS")
        if node.is_end or node.channels is not None:
            raise self._wrong(
                "an end site has no CHANNELS" if node.is_end else f"{self._called(node)} has CHANNELS twice"
            )
        said = self._take() if self._next < len(self._words) else ""
        if not (said.isascii() and said.isdigit() and len(said) < 10):
            raise self._wrong(f"CHANNELS needs a number, not {shown(said)}")
        found: list[str] = []
        line = self.line
        while self._next < len(self._words) and self._peek().upper() not in BLOCK_WORDS:
            if len(found) >= int(said) and not self._same_line():
                break
            found.append(self._take())
        for name in found:
            if channel_kind(name) is None:
                raise self._wrong(f"{shown(name)} is no channel (Xposition ... Zrotation)")
        if len(found) != int(said):
            raise self._wrong(f"CHANNELS says {int(said)}, but {len(found)} follow", line)
        places = [kind for kind in map(channel_kind, found) if kind and kind[0] == "position"]
        if len(set(places)) < len(places):
            raise self._wrong(f"{self._called(node)} has a position channel twice", line)
        node.channels = tuple(found)

    def _block(self, what: str) -> _Node:
        """The joint or end site whose block is open."""
        if not self._open:
            raise self._wrong(f"{what} stands outside of all joints")
        if not self._open[-1].opened:
            raise self._wrong(f"{what} stands where the {{ of {self._called(self._open[-1])} is missing")
        return self._open[-1]

    def _called(self, node: _Node) -> str:
        return f"the end site of line {node.line}" if node.is_end else f"joint {shown(node.name)}"

    def _take(self) -> str:
        if self._next >= len(self._words):
            raise self._wrong("the file ends in the middle of its hierarchy")
        self.line, word, _ = self._words[self._next]
        self._next += 1
        return word

    def _peek(self) -> str:
        return self._words[self._next][1]

    def _same_line(self) -> bool:
        """Whether the next word stands on the line of the last one."""
        return self._next < len(self._words) and self._words[self._next][0] == self.line

    def _rest_of_line(self) -> str:
        """What stands between the last word and a brace or the end of the line, blanks inside kept."""
        begin = end = self._words[self._next - 1][2]
        while self._same_line() and self._peek() not in "{}":
            end = self._words[self._next][2]
            self._next += 1
        return self._lines[self.line - 1][begin:end].strip()

    def _number(self, need: str) -> float:
        if self._next >= len(self._words) or self._peek().upper() in BLOCK_WORDS:
            raise self._wrong(need)
        word = self._take().encode("utf-8", "replace")
        value = number(word, self.line, self.where)
        self.decimals = max(self.decimals, decimals_of(word))
        return value

    def _wrong(self, what: str, line: int | None = None) -> HopdiffError:
        return HopdiffError(f"{self.where}, line {line or self.line}: {what}.")


def _motion_head(data: bytes, start: int, line: int, where: str) -> tuple[int, int, float, int, int]:
    """Frames and the line that says so, frame time [s] and its line, and where the numbers begin, a line below."""
    found: list[tuple[str, int]] = []
    wanted = ((FRAMES, "Frames: and a number"), (FRAME_TIME, "Frame Time: and a number"))
    end = data.find(b"\n", start)
    if data[start : end if end >= 0 else len(data)].strip():
        raise HopdiffError(f"{where}, line {line}: MOTION must stand alone on its line.")
    while len(found) < 2:
        start = data.find(b"\n", start) + 1
        if not start:
            raise HopdiffError(f"{where}, line {line}: the file ends before {wanted[len(found)][1]}.")
        line += 1
        end = data.find(b"\n", start)
        text = data[start : end if end >= 0 else len(data)]
        if not text.strip() or text.lstrip().startswith(COMMENT):
            continue
        pattern, what = wanted[len(found)]
        match = pattern.fullmatch(text)
        if not match:
            raise HopdiffError(f"{where}, line {line}: {what} should stand here, not {shown(text.strip())}.")
        found.append((match.group(1).decode("utf-8", "replace"), line))
    (count, count_line), (step, step_line) = found
    if not (count.isascii() and count.isdigit() and len(count) < 19):
        raise HopdiffError(f"{where}, line {count_line}: the number of frames cannot be {shown(count)}.")
    if int(count) == 0:
        raise HopdiffError(f"{where}, line {count_line}: the file says that it has no frames.")
    seconds = number(step.encode("utf-8", "replace"), step_line, where)
    if not 0.0 < seconds <= LARGEST:
        raise HopdiffError(f"{where}, line {step_line}: the time between frames must be positive, not {shown(step)}.")
    end = data.find(b"\n", start)
    return int(count), count_line, seconds, step_line, (end + 1 if end >= 0 else len(data))
