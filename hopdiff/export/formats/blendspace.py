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
from hopdiff.messages import plural
from hopdiff.types import HopdiffError

MOST_TOLD = 5  # crossings without a clip that are named


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


def _review(takes: Sequence[Take]) -> list[str]:
    missing = BlendSpace.of(takes).missing
    if not missing:
        return []
    places = [f"speed {speed:g}, beta {beta:g}, turn {turn:g}" for speed, beta, turn in missing[:MOST_TOLD]]
    more = f"; and {len(missing) - MOST_TOLD} more" if len(missing) > MOST_TOLD else ""
    return [f"the grid lacks {plural(len(missing), 'clip')}: {'; '.join(places)}{more}."]


FORMAT = Format(
    ".glb",
    _write,
    together=True,
    axes=True,
    beside=(".json", ".html"),
    check=_check,
    review=_review,
    strides=True,
)
