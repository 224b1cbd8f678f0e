"""A page that plays the motions."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.player import write_player

FORMAT = Format(".html", lambda path, takes, settings: write_player(path, takes, settings.together), together=True)
