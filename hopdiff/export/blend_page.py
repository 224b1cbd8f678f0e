"""A page that blends the clips of a blend space live, where a point of a pad is: one file that needs no network."""

from __future__ import annotations

import base64
import html
import json
import re
from typing import Any

from hopdiff.export.blend_space import BlendSpace
from hopdiff.export.glb import glb_bytes
from hopdiff.export.player import _library, _part
from hopdiff.io.record import finite

STYLES = ("page.css", "blend.css")
SCRIPTS = ("camera.js", "walker.js", "stage.js", "blend.js")  # in the order in which they run


def blend_page(space: BlendSpace, index: dict[str, Any]) -> str:
    """The text of the page. index: of the space. Raises HopdiffError if the drawing library is not where it was."""
    takes = list(space.clips.values())
    body = {
        "glb": base64.b64encode(glb_bytes(takes)).decode("ascii"),
        "joints": list(takes[0].clip.skeleton.names),
        "height": round(float(takes[0].clip.joint_positions()[..., 1].max()), 3),
    }
    parts = {
        "title": html.escape("Blend space"),
        "style": "\n".join(_part(name) for name in STYLES),
        "library": _library(),
        # Nothing in the data can end the element that it stands in.
        "data": json.dumps(finite({**index, "body": body}), separators=(",", ":"), allow_nan=False).replace(
            "<", "\\u003c"
        ),
        "script": "\n".join(_part(name) for name in SCRIPTS),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _part("blend.html"))
