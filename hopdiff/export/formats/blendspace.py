"""A blend space: GLB with a clip for each crossing, an index of them as JSON, and a page that blends them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hopdiff.export.blend_page import blend_page
from hopdiff.export.blend_space import BlendSpace
from hopdiff.export.format import Format
from hopdiff.export.glb import glb_bytes
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.io.files import write_whole
from hopdiff.io.record import write_json
from hopdiff.types import HopdiffError


def _check(settings: ExportSettings) -> None:
    if settings.keys is None or settings.cycles != 1:
        raise HopdiffError(
            "clips of kind blendspace are single strides of as many keys: set keys, and leave cycles at 1."
        )


def _write(path: Path, takes: Sequence[Take], settings: ExportSettings) -> None:
    space = BlendSpace.of(takes)
    index = space.index()
    content, page = glb_bytes(takes, settings.axes), blend_page(space, index)
    write_whole(path, content)
    write_json(path.with_suffix(".json"), {"file": path.name, **index})
    write_whole(path.with_suffix(".html"), page)


FORMAT = Format(".glb", _write, together=True, axes=True, beside=(".json", ".html"), check=_check)
