"""A sprite sheet with its index."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.picture_files import pictures_of_views, write_sprites

FORMAT = Format(".png", write_sprites, together=True, beside=(".json",), pictures=pictures_of_views)
