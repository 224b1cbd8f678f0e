"""FBX, made by Blender."""

from __future__ import annotations

from hopdiff.export.fbx import find_blender, write_fbx
from hopdiff.export.format import Format
from hopdiff.export.glb import glb_bytes

FORMAT = Format(
    ".fbx",
    lambda path, takes, settings: write_fbx(path, glb_bytes(takes), settings.blender),
    together=True,
    check=lambda settings: find_blender(settings.blender),
)
