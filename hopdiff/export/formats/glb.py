"""Binary glTF."""

from __future__ import annotations

from hopdiff.export.format import Format
from hopdiff.export.glb import write_glb

FORMAT = Format(".glb", lambda path, takes, settings: write_glb(path, takes, settings.axes), together=True, axes=True)
