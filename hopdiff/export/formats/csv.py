"""A table of places and rotations as text."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.tables import write_csv

FORMAT = Format(".csv", lambda path, takes, _: write_csv(path, takes[0]))
