"""The rows of numbers of a BVH file: read fast, and slowly only to find what is wrong."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdiff.messages import plural
from hopdiff.types import HopdiffError

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

LARGEST = 1e12  # beyond it a number is a mistake, whatever the unit
MOST = 15  # decimals that a file may be said to have
SPARE = 1  # frames that may be there more or less than said
BLOCK = 4 << 20  # bytes read at a time
COMMENT = (b"#", b"//", b";")
NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
# A number with a point, up to its end or to the sign of the next one, where the blank between them is missing.
PIECE = re.compile(rb"[+-]?(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?(?=[+-]|$)")


@dataclass(frozen=True)
class Table:
    """Rows of numbers (T, C) and the most decimals that one of them is written with. notes: for the user, on what was
    mended. mended: whether numbers were."""

    values: Array
    decimals: int
    notes: tuple[str, ...]
    mended: bool


@dataclass(frozen=True)
class Rows:
    """Numbers in a row, the lines that hold any, how many each of these holds, the most decimals, and for the user what
    was mended."""

    numbers: Array
    lines: Whole
    counts: Whole
    decimals: int
    notes: tuple[str, ...] = ()


def read_rows(text: bytes, line: int, frames: int, said: int, channels: int, where: str) -> Table:
    """All numbers below the head of a motion.

    text: what follows the line of the frame time, lines ended by newlines. line: number of its first line. frames:
    how many rows there shall be, as line `said` has it. channels: how many numbers in a row. where: the file's name,
    for errors. A frame may be spread over several lines, or several frames stand on one.
    One frame more or less than said is read as it is there, and two numbers without a blank between them as two where
    the frame lacks one. Raises HopdiffError, naming the line, for anything else.
    """
    rows = _fast(text, line)
    if rows is None or not (np.abs(rows.numbers) <= LARGEST).all():
        rows = _slow(text, line, channels, where)
    found, rest = divmod(len(rows.numbers), channels)
    if found and not rest and abs(found - frames) <= SPARE and _in_order(rows.counts, channels):
        notes = rows.notes
        if found != frames:
            notes = (
                *notes,
                f"line {said} says that there are {plural(frames, 'frame')}, but {found} were found and read.",
            )
        return Table(rows.numbers.reshape(found, channels), rows.decimals, notes, bool(rows.notes))
    if (odd := np.flatnonzero(rows.counts != channels)).size:
        at, count = rows.lines[odd[0]], rows.counts[odd[0]]
        raise HopdiffError(f"{where}, line {at}: {count} numbers stand here, but a frame has {channels}.")
    held = f"{plural(frames, 'frame')}, but holds {len(rows.lines)}"
    raise HopdiffError(f"{where}, line {said}: the file says that it has {held}.")


def _in_order(counts: Whole, channels: int) -> bool:
    """Whether lines and frames fit into each other, or all lines but the last are equally long."""
    ends, goals = np.cumsum(counts), np.arange(channels, counts.sum() + 1, channels)
    return bool(not (ends % channels).any() or np.isin(goals, ends).all() or (counts[:-1] == counts[0]).all())


def _fast(text: bytes, line: int) -> Rows | None:
    """The rows, or None where something is odd."""
    numbers, lines, counts = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0, np.int64)]
    decimals, start = 0, 0
    while start < len(text):
        end = text.find(b"\n", start + BLOCK) + 1 or len(text)
        block = text[start:end]
        start = end
        raw = np.frombuffer(block, dtype=np.uint8)
        inside = np.concatenate(([False], raw > 32, [False]))
        edges = np.flatnonzero(inside[1:] != inside[:-1])
        first, behind = edges[::2], edges[1::2]  # characters of each word
        breaks = np.flatnonzero(raw == 10)
        if len(first):
            part = _parsed(block)
            # As many numbers as words: then each word is one number.
            if part is None or len(part) != len(first):
                return None
            held = np.diff(np.searchsorted(first, np.append(breaks, len(raw))), prepend=0)
            numbers.append(part)
            lines.append(line + np.flatnonzero(held))
            counts.append(held[held > 0])
            decimals = max(decimals, _decimals(block, raw, behind))
        line += len(breaks)
    return Rows(np.concatenate(numbers), np.concatenate(lines), np.concatenate(counts), decimals)


def _parsed(block: bytes) -> Array | None:
    with warnings.catch_warnings():
        # What numpy warns of in one version, it raises in the next.
        warnings.simplefilter("error")
        try:
            return np.fromstring(block, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _decimals(block: bytes, raw: NDArray[np.uint8], ends: NDArray[np.intp]) -> int:
    """The most decimals of any number in a block of good ones."""
    if b"e" in block or b"E" in block:
        return max(decimals_of(word) for word in set(block.split()))
    points = np.flatnonzero(raw == ord("."))
    if not len(points):
        return 0
    behind = ends if len(ends) == len(points) else ends[np.searchsorted(ends, points)]
    return min(int((behind - points).max()) - 1, MOST)


def decimals_of(word: bytes) -> int:
    """Digits behind the point of a number as written, a power of ten left aside."""
    return min(len(word.lower().partition(b"e")[0].partition(b".")[2]), MOST)


def _slow(text: bytes, line: int, channels: int, where: str) -> Rows:
    """The rows, word by word; comments are left out. Raises HopdiffError for a word that is not a sensible number."""
    numbers: list[float] = []
    lines: list[int] = []
    counts: list[int] = []
    mended: list[tuple[int, bytes]] = []
    decimals = 0
    for at, row in enumerate(text.split(b"\n"), start=line):
        words = row.split()
        if not words or words[0].startswith(COMMENT):
            continue
        if len(words) < channels and len(apart := [piece for word in words for piece in _pieces(word)]) == channels:
            mended += [(at, word) for word in words if len(_pieces(word)) > 1]
            words = apart
        numbers += [number(word, at, where) for word in words]
        lines.append(at)
        counts.append(len(words))
        decimals = max(decimals, *map(decimals_of, words))
    return Rows(np.array(numbers), np.array(lines, np.int64), np.array(counts, np.int64), decimals, _told(mended))


def _pieces(word: bytes) -> list[bytes]:
    """The numbers that a word is put together from, each with a point; the word itself if it is not."""
    if NUMBER.fullmatch(word):
        return [word]
    pieces: list[bytes] = PIECE.findall(word)
    return pieces if b"".join(pieces) == word else [word]


def _told(mended: list[tuple[int, bytes]]) -> tuple[str, ...]:
    """What the user is told of numbers without blanks between them."""
    if not mended:
        return ()
    at, word = mended[0]
    more = f", and {len(mended) - 1} more like it" if len(mended) > 1 else ""
    return (f"line {at} lacks a blank: {shown(word)} was read as {len(_pieces(word))} numbers{more}.",)


def number(word: bytes, line: int, where: str) -> float:
    """The number that a word is. Raises HopdiffError, naming the line, if it is none or not a sensible one."""
    if not NUMBER.fullmatch(word):
        raise HopdiffError(f"{where}, line {line}: {shown(word)} is not a number.")
    value = float(word)
    if not abs(value) <= LARGEST:
        raise HopdiffError(f"{where}, line {line}: {shown(word)} is too large.")
    return value


def shown(word: bytes | str) -> str:
    """A word as an error quotes it: short, and on one line."""
    text = word.decode("utf-8", "replace") if isinstance(word, bytes) else word
    return repr(text if len(text) <= 40 else f"{text[:40]}...")


def written(rows: Array, decimals: int) -> list[str]:
    """One line of text for each row of finite numbers (T, C), such that reading gives the same numbers again.

    decimals: how many to write; a number that needs more gets more.
    """
    rows = rows + 0.0  # turns -0.0 into 0.0
    line = " ".join([f"%.{decimals}f"] * rows.shape[1])
    enough = (np.round(rows, decimals) == rows).all(axis=1)
    return [
        line % tuple(row) if fits else " ".join(exact(value, decimals) for value in row)
        for row, fits in zip(rows.tolist(), enough.tolist(), strict=True)
    ]


def exact(value: float, decimals: int) -> str:
    """A number with so many decimals, or as many as it takes to read it back unchanged."""
    text = f"{value + 0.0:.{decimals}f}"
    return text if float(text) == value else repr(value)
