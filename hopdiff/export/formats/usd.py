"""Universal Scene Description."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.usd import ENDINGS, check_usd, write_usd

FORMAT = Format(
    ENDINGS[0], lambda path, takes, _: write_usd(path, takes[0]), check=lambda _: check_usd(), others=ENDINGS[1:]
)
