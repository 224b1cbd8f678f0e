"""FBX, made by Blender."""

from __future__ import annotations

from hopdiff.export.fbx import find_blender, write_fbx
from hopdiff.export.format import Format
from hopdiff.export.glb import glb_bytes

FORMAT = Format(
    ".fbx",
    # Blender leaves the frames of joints as they are, and importers of FBX swap none of their axes.
    lambda path, takes, settings: write_fbx(path, glb_bytes(takes, settings.axes, swapped=False), settings.blender),
    together=True,
    axes=True,
    check=lambda settings: find_blender(settings.blender),
)
