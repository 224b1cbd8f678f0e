"""What encodes moving pictures on this machine. Draws nothing, and loads nothing that draws."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator

from PIL import Image

from hopdiff.messages import choose
from hopdiff.types import HopdiffError

try:  # brings an ffmpeg along
    import imageio_ffmpeg
except ImportError:
    imageio_ffmpeg = None

KINDS = ("gif", "webp", "mp4", "none")
ENCODERS = ("libx264", "libopenh264")  # what every browser and editor shows, the better one first


def check_film(kind: str, wanted: bool = True) -> None:
    """Raises HopdiffError if the setting `animation` is unknown or, where films are wanted, nothing here encodes it."""
    choose("animation", kind, KINDS)
    if kind == "webp" and wanted:
        Image.init()
        if "WEBP" not in Image.SAVE_ALL:
            raise HopdiffError("animation=webp needs a Pillow that was built with WebP: set animation=gif, or mp4.")
    if kind == "mp4" and wanted:
        find_ffmpeg()


def find_ffmpeg() -> tuple[str, str]:
    """An ffmpeg that writes H.264 and its encoder: that on PATH, else the one of the package imageio-ffmpeg.

    Raises HopdiffError, saying how to get one, where there is none.
    """
    for program in _programs():
        try:
            known = subprocess.run(
                [program, "-hide_banner", "-encoders"], capture_output=True, text=True, errors="replace", timeout=60
            ).stdout.split()
        except (OSError, subprocess.TimeoutExpired):
            continue
        for encoder in ENCODERS:
            if encoder in known:
                return program, encoder
    raise HopdiffError(
        f"animation=mp4 needs an ffmpeg with {' or '.join(ENCODERS)}, and none was found: put one on PATH, or"
        " `pip install imageio-ffmpeg`."
    )


def _programs() -> Iterator[str]:
    if (found := shutil.which("ffmpeg")) is not None:
        yield found
    if imageio_ffmpeg is not None:
        try:
            yield imageio_ffmpeg.get_ffmpeg_exe()
        except RuntimeError:
            return
