"""VRM animation."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.vrm_animation import write_vrma

FORMAT = Format(".vrma", lambda path, takes, _: write_vrma(path, takes[0]))
