"""How a BVH file is written, byte for byte, so that what is not changed in it stays so."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice

import numpy as np

from hopdiff.io.bvh_numbers import Array, exact, written

LINE_END = re.compile(rb"\r\n|\r|\n")
FRAMES = re.compile(rb"\s*frames\s*[:\s]\s*([^\s:]+)\s*", re.IGNORECASE)
FRAME_TIME = re.compile(rb"\s*frame\s*time\s*[:\s]\s*([^\s:]+)\s*", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Layout:
    """The text of a file, without its byte order if it has one.

    before: all up to the number of frames. between: from there to the frame time. time: as written. after: the rest of
    that line. line_end: of that line. rows: all below. values: (T, C), what the rows say. frame_time: what time says
    [s]. codec: of a file of two bytes a letter, whose byte order stands first.
    """

    before: bytes
    between: bytes
    time: bytes
    after: bytes
    line_end: bytes
    rows: bytes
    values: Array
    frame_time: float
    codec: str | None

    def text(self, values: Array, frame_time: float, decimals: int) -> bytes:
        """The whole file with other numbers (T, C) and frame time [s]; rows that say what they said stay as they are.

        decimals: of the numbers that change.
        """
        time = self.time if frame_time == self.frame_time else exact(frame_time, 0).encode()
        head = self.before + str(len(values)).encode() + self.between + time + self.after
        end = self.line_end if self.rows.endswith((b"\r", b"\n")) else b""
        whole = head + self.line_end.join(self._lines(values, decimals)) + end
        if self.codec is None:
            return whole
        return ("\ufeff" + whole.decode()).encode(self.codec)

    def _lines(self, values: Array, decimals: int) -> list[bytes]:
        lines = [line for line in self.rows.splitlines() if line.strip()]
        if values.shape != self.values.shape or len(lines) != len(values):
            return [line.encode() for line in written(values, decimals)]
        changed = np.flatnonzero((values != self.values).any(axis=1))
        for at, line in zip(changed.tolist(), written(values[changed], decimals), strict=True):
            lines[at] = line.encode()
        return lines


def layout_of(
    raw: bytes, frames_line: int, time_line: int, values: Array, frame_time: float, mended: bool, codec: str | None
) -> Layout | None:
    """How a file is written; None where its words for frames and frame time are too odd.

    raw: all of it. frames_line, time_line: where these stand, counted from 1. mended: whether rows say what no other
    reader takes from them, so that they must be written anew.
    """
    ends = [match.span() for match in islice(LINE_END.finditer(raw), time_line)]
    if len(ends) < time_line:
        return None
    start = ends[frames_line - 2][1]
    count = FRAMES.fullmatch(raw, start, ends[frames_line - 1][0])
    time = FRAME_TIME.fullmatch(raw, ends[time_line - 2][1], ends[time_line - 1][0])
    if count is None or time is None:
        return None
    first, last = ends[time_line - 1]
    return Layout(
        raw[: count.start(1)],
        raw[count.end(1) : time.start(1)],
        time.group(1),
        raw[time.end(1) : last],
        raw[first:last],
        raw[last:] if not mended else raw[last:][-1:],
        values,
        frame_time,
        codec,
    )
