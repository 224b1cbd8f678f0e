"""An animated PNG."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.picture_files import apng_pictures, write_apng

FORMAT = Format(".png", write_apng, pictures=apng_pictures)
