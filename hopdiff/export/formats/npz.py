"""The same numbers as a NumPy archive."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.tables import write_npz

FORMAT = Format(".npz", lambda path, takes, _: write_npz(path, takes[0]))
