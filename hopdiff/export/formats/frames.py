"""A folder of numbered PNG files."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.picture_files import pictures_of_views, write_frames

FORMAT = Format("", write_frames, pictures=pictures_of_views)
