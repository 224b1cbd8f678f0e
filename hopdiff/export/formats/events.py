"""Contacts, sync markers and root motion of clips as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hopdiff.export.contact_events import told
from hopdiff.export.format import Format
from hopdiff.export.take import Take
from hopdiff.io.record import write_json


def _write(path: Path, takes: Sequence[Take], _: Any) -> None:
    clips = [
        {
            "name": take.name,
            "loop": take.loop,
            "duration": take.clip.duration,
            "frame_time": take.clip.frame_time,
            "keys": take.frames,
            **told(take),
        }
        for take in takes
    ]
    write_json(path, {"clips": clips})


FORMAT = Format(".json", _write, together=True)
