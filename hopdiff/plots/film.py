"""Moving pictures in files: GIF and WebP by Pillow, MP4 by an ffmpeg where there is one: it is no part of hopdiff."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, combinations
from pathlib import Path

import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from hopdiff.io.files import whole_file, write_whole
from hopdiff.messages import choose
from hopdiff.plots import style
from hopdiff.plots.view import Array
from hopdiff.types import HopdiffError

try:  # brings an ffmpeg along
    import imageio_ffmpeg
except ImportError:
    imageio_ffmpeg = None

KINDS = ("gif", "webp", "mp4", "none")
ENCODERS = ("libx264", "libopenh264")  # what every browser and editor shows, the better one first
WIDTHS = {"gif": 480, "webp": 480, "mp4": 720}  # pixels
LONGEST = {"gif": 12.0, "webp": 12.0, "mp4": 60.0}  # seconds shown of what is no loop
_QUALITY = {"libx264": ("-crf", "20", "-preset", "veryfast"), "libopenh264": ("-b:v", "4M")}
_TOLERANCE = 0.005  # of the playing time
_LEAST_VIDEO = 5.0  # seconds: players do not go round by themselves
_LINE, _SMALL, _LEAST_LETTERS = 1 / 26, 0.8, 11  # heights of letters: of the width, of the other lines, and pixels


@dataclass(frozen=True)
class Film:
    """Pictures of something that moves, at true speed.

    duration: [s]; loops: whether its end is its start. pace: seconds from one picture to the next in a GIF or WebP, and
    in a video, about. colours: "#rrggbb" that the pictures are made of, besides white; shares: of one in another, at
    their edges. draw: pictures at moments (T,) [s], so many pixels wide. caption: lines over them, the first one bold.
    """

    duration: float
    loops: bool
    pace: tuple[float, float]
    colours: tuple[str, ...]
    shares: tuple[float, ...]
    draw: Callable[[Array, int], Iterable[Image.Image]]
    caption: tuple[str, ...] = ()


def write_film(path: str | os.PathLike[str], film: Film, width: int | None = None) -> None:
    """Write a film in the format that its file name ends in: gif, webp or mp4.

    width: of the pictures [pixels]. GIF and WebP go round for ever; an MP4 has as many rounds of a loop as fill 5 s. Of
    what is no loop only a minute is shown in an MP4, and 12 s elsewhere. A GIF has a few rounds of a loop where the
    whole hundredths of a second of the format would put one round off by more than half a percent.
    Raises HopdiffError for an unknown ending, where nothing can encode it, and if the file cannot be written.
    """
    kind = Path(path).suffix.lstrip(".").lower()
    if kind not in KINDS[:-1]:
        raise HopdiffError(f"cannot write {path}: a film's name must end in .{', .'.join(KINDS[:-1])}.")
    check_film(kind)
    shown = film.duration if film.loops else min(film.duration, LONGEST[kind])
    wide = WIDTHS[kind] if width is None else width
    if kind == "mp4":
        _write_mp4(path, film, shown, wide)
    elif kind == "webp":
        delays = spread(shown, 0.001, film.pace[0])
        _write_pillow(path, "WEBP", [*_pictures(film, shown, 0.001, delays, wide)], delays, lossless=True)
    else:
        rounds, delays = gif_timing(shown, film.pace[0], film.loops)
        palette = _palette(film)
        pictures = _pictures(film, rounds * shown, 0.01, delays, wide)
        frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
        _write_pillow(path, "GIF", frames, [10 * delay for delay in delays], disposal=1)


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


def spread(duration: float, unit: float, pace: float) -> list[int]:
    """Delays after each picture in whole units, whose sum is the duration within half a unit. unit, pace: [s]."""
    total = max(2, round(duration / unit))
    # The remainder is spread over all of them, so no single moment stutters.
    count = max(2, round(duration / pace))
    edges = [round(total * picture / count) for picture in range(count + 1)]
    return np.diff(edges).tolist()


def gif_timing(duration: float, pace: float, loops: bool = True) -> tuple[int, list[int]]:
    """How many rounds a GIF takes, and the delay after each of its pictures [1/100 s]. duration, pace: [s]."""
    rounds = 1
    while loops and rounds < 9 and abs(round(100.0 * rounds * duration) / (100.0 * rounds * duration) - 1) > _TOLERANCE:
        rounds += 1
    return rounds, spread(rounds * duration, 0.01, pace)


def _programs() -> Iterator[str]:
    if (found := shutil.which("ffmpeg")) is not None:
        yield found
    if imageio_ffmpeg is not None:
        try:
            yield imageio_ffmpeg.get_ffmpeg_exe()
        except RuntimeError:
            return


def _pictures(film: Film, duration: float, unit: float, delays: list[int], width: int) -> Iterator[Image.Image]:
    """Every picture belongs to the moment when it comes up; the end of a loop is its start again, so not drawn."""
    share = np.cumsum([0, *delays[:-1]]) / sum(delays)
    return _captioned(film, duration * share, duration, width)


def _captioned(film: Film, moments: Array, duration: float, width: int) -> Iterator[Image.Image]:
    lines = film.caption
    if not film.loops and duration < film.duration and lines:
        lines = (*lines[:-1], f"{lines[-1]}; the first {duration:g} s")
    strip = caption(lines, width)
    for picture in film.draw(moments, width):
        # Encoders of video want even sides.
        tall = strip.height + picture.height
        whole = Image.new("RGB", (picture.width + picture.width % 2, tall + tall % 2), "white")
        whole.paste(strip, (0, 0))
        whole.paste(picture, (0, strip.height))
        yield whole


def caption(lines: tuple[str, ...], width: int) -> Image.Image:
    """Lines of text on white, the first one bold; smaller letters where they would not fit the width [pixels]."""
    size = max(_LEAST_LETTERS, round(_LINE * width))
    edge = round(0.6 * size)
    rows = []
    for number, line in enumerate(lines):
        wanted = size if number == 0 else max(_LEAST_LETTERS, round(_SMALL * size))
        rows.append((line, _font(line, wanted, number == 0, width - 2 * edge)))
    heights = [round(1.35 * font.size) for _, font in rows]
    strip = Image.new("RGB", (width, edge + sum(heights) if rows else 0), "white")
    canvas = ImageDraw.Draw(strip)
    y = edge
    for (line, font), height in zip(rows, heights, strict=True):
        canvas.text((edge, y), line, font=font, fill=style.INK)
        y += height
    return strip


def _font(line: str, size: int, bold: bool, width: int) -> ImageFont.FreeTypeFont:
    face = font_manager.findfont(font_manager.FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal"))
    while (font := ImageFont.truetype(face, size)).getlength(line) > width and size > 1:
        size -= 1
    return font


def _palette(film: Film) -> Image.Image:
    """White, the colours of the film and what lies between them at smoothed edges: the same for all pictures."""
    inks = ["#FFFFFF", *film.colours]
    mixed = [style.mix(a, b, share) for a, b in combinations(inks, 2) for share in film.shares]
    letters = [style.mix(style.INK, "#FFFFFF", share) for share in (0.0, 0.25, 0.5, 0.75)] if film.caption else []
    image = Image.new("P", (1, 1))
    image.putpalette(b"".join(bytes.fromhex(colour[1:]) for colour in dict.fromkeys((*inks, *mixed, *letters))))
    return image


def _write_pillow(
    path: str | os.PathLike[str], form: str, frames: list[Image.Image], milliseconds: list[int], **options: object
) -> None:
    with whole_file(path, "wb") as file:
        frames[0].save(
            file, format=form, save_all=True, append_images=frames[1:], duration=milliseconds, loop=0, **options
        )


def _write_mp4(path: str | os.PathLike[str], film: Film, duration: float, width: int) -> None:
    program, encoder = find_ffmpeg()
    count = max(2, round(duration / film.pace[1]))
    rounds = math.ceil(_LEAST_VIDEO / duration) if film.loops else 1
    moments = duration * np.arange(count) / count
    pictures = _captioned(film, moments, duration, width)
    first = next(pictures)
    following: Iterable[Image.Image] = chain([first], pictures)
    if rounds > 1:
        following = [*following] * rounds
    rate = f"{1_000_000 * count}/{round(1e6 * duration)}"  # so that a round lasts what it lasts
    with tempfile.TemporaryDirectory(prefix="hopdiff_film_") as folder:
        target = Path(folder, "film.mp4")
        command = [program, "-hide_banner", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24"]
        command += ["-video_size", f"{first.width}x{first.height}", "-framerate", rate, "-i", "-"]
        command += ["-c:v", encoder, *_QUALITY[encoder], "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(target)]
        done, said = _feed(command, following)
        if not done or not target.is_file():
            raise HopdiffError(f"cannot write {path}: {program} made no film{f' ({said})' if said else ''}.")
        write_whole(path, target.read_bytes())


def _feed(command: list[str], pictures: Iterable[Image.Image]) -> tuple[bool, str]:
    """Run an encoder on the pictures; returns whether it ended well, and the last line that it said, if any."""
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said)
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError):
                for picture in pictures:
                    process.stdin.write(picture.tobytes())
                process.stdin.close()
            process.wait()
        finally:
            with suppress(OSError):
                process.stdin.close()
            process.kill()
            process.wait()
        said.seek(0)
        lines = said.read().decode(errors="replace").split("\n")
    return process.returncode == 0, next((line.strip().rstrip(".") for line in reversed(lines) if line.strip()), "")
