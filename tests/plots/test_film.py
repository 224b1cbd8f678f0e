from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageSequence

from hopdiff.plots import film as film_module
from hopdiff.plots.film import (
    ENCODERS,
    LONGEST,
    WIDTHS,
    Film,
    caption,
    check_film,
    find_ffmpeg,
    gif_timing,
    spread,
    write_film,
)
from hopdiff.types import HopdiffError

Image.init()
webp = pytest.mark.skipif("WEBP" not in Image.SAVE_ALL, reason="this Pillow has no WebP")

FILL, EDGE = "#D55E00", "#0072B2"
# Says what encoders it has; asked to encode, it writes down what it was told and how many bytes it was given.
FAKE = """#!{python}
import sys
if "-encoders" in sys.argv:
    print(" V....D {encoder}   something")
else:
    given = len(sys.stdin.buffer.read())
    open(sys.argv[-1], "w").write("\\n".join([*sys.argv[1:-1], str(given)]))
"""
BROKEN = """#!{python}
import sys
if "-encoders" in sys.argv:
    print(" V....D libx264   something")
else:
    open(sys.argv[-1], "w").write("half a film")
    print("no room for a film.", file=sys.stderr)
    sys.exit(1)
"""


def dial(duration: float, loops: bool = True, lines: tuple[str, ...] = (), asked: list[float] | None = None) -> Film:
    """A hand that goes round once."""

    def draw(moments: np.ndarray, width: int) -> Iterator[Image.Image]:
        for moment in moments:
            if asked is not None:
                asked.append(float(moment))
            picture = Image.new("RGB", (width, width // 2 + 1), "white")
            angle = 2 * np.pi * moment / duration
            ends = [
                width / 2,
                width / 4,
                width / 2 + 0.2 * width * np.sin(angle),
                width / 4 - 0.2 * width * np.cos(angle),
            ]
            ImageDraw.Draw(picture).line(ends, fill=FILL, width=max(2, width // 20))
            yield picture

    return Film(duration, loops, (0.03, 1 / 60), (FILL, EDGE), (0.5,), draw, lines)


def shown(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Pictures, and how long each of them is shown [ms]."""
    pictures, delays = [], []
    with Image.open(path) as film:
        assert film.info["loop"] == 0
        for frame in ImageSequence.Iterator(film):
            pictures.append(np.asarray(frame.convert("RGB"), dtype=int))
            delays.append(frame.info["duration"])
    return pictures, delays


@settings(deadline=None)
@given(duration=st.floats(0.3, 60.0), unit=st.sampled_from([0.01, 0.001]), pace=st.sampled_from([0.03, 0.04, 0.06]))
def test_delays_add_up_to_the_true_duration_within_half_a_unit(duration: float, unit: float, pace: float) -> None:
    delays = spread(duration, unit, pace)
    assert abs(sum(delays) * unit - duration) <= 0.5 * unit + 1e-12
    assert max(delays) - min(delays) <= 1
    assert np.mean(delays) * unit == pytest.approx(pace, rel=0.2)


@settings(deadline=None)
@given(stride=st.floats(0.25, 2.0))
def test_a_gif_lasts_whole_strides(stride: float) -> None:
    rounds, delays = gif_timing(stride, 0.03)
    assert abs(sum(delays) - 100 * rounds * stride) <= 0.5 + 1e-9  # hundredths of a second
    assert sum(delays) / 100 == pytest.approx(rounds * stride, rel=0.005)
    assert rounds <= 4
    # Viewers slow a picture of less than two hundredths down to ten.
    assert set(delays) <= {2, 3, 4}
    assert 30 <= 100 * len(delays) / sum(delays) <= 50 or sum(delays) < 90


def test_one_round_where_one_will_do() -> None:
    assert gif_timing(0.60, 0.03)[0] == 1
    assert gif_timing(0.456, 0.03)[0] > 1
    assert gif_timing(0.456, 0.03, loops=False)[0] == 1


@pytest.mark.parametrize("duration", [0.6691, 0.5985, 0.456])
def test_a_gif_shows_every_moment_when_it_comes(tmp_path: Path, duration: float) -> None:
    asked: list[float] = []
    write_film(tmp_path / "film.gif", dial(duration, asked=asked))
    pictures, delays = shown(tmp_path / "film.gif")
    rounds = round(sum(delays) / 1000 / duration)
    assert sum(delays) == pytest.approx(1000 * rounds * duration, abs=5.0)
    stretch = 1000 * rounds * duration / sum(delays)
    np.testing.assert_allclose(asked, np.cumsum([0, *delays[:-1]]) * stretch / 1000, atol=1e-9)
    assert pictures[0].shape[1] == WIDTHS["gif"]


@webp
def test_a_webp_lasts_what_it_lasts_and_loses_nothing(tmp_path: Path) -> None:
    write_film(tmp_path / "film.webp", dial(0.6691), width=120)
    with Image.open(tmp_path / "film.webp") as film:
        assert film.n_frames == round(0.6691 / 0.03)
        assert film.info["loop"] == 0
        total = 0
        for number in range(film.n_frames):
            film.seek(number)
            film.load()
            total += film.info["duration"]
        film.seek(0)
        first = np.asarray(film.convert("RGB"))
    assert total == 669
    expected = np.asarray(next(iter(dial(0.6691).draw(np.zeros(1), 120))))
    np.testing.assert_array_equal(first[: len(expected), :120], expected)


@pytest.mark.parametrize("kind", ["gif", pytest.param("webp", marks=webp)])
def test_what_is_no_loop_is_cut_and_the_caption_says_so(tmp_path: Path, kind: str) -> None:
    asked: list[float] = []
    write_film(tmp_path / f"film.{kind}", dial(30.0, loops=False, lines=("a", "b"), asked=asked), width=40)
    assert max(asked) < LONGEST[kind] <= max(asked) + 0.05
    longer, whole = (
        next(iter(film_module._captioned(dial(d, loops=False, lines=("a", "b")), np.zeros(1), 12.0, 400)))
        for d in (30.0, 12.0)
    )
    ink = [(np.asarray(picture)[:60].min(axis=2) < 128).sum() for picture in (longer, whole)]
    assert ink[0] > ink[1] + 100, "nothing was added to the caption"


def test_the_caption_is_read_above_the_picture_and_fits(tmp_path: Path) -> None:
    write_film(tmp_path / "film.gif", dial(0.6, lines=("5 m/s, beta 0.7", "model body, gradient search")))
    with_words, _ = shown(tmp_path / "film.gif")
    write_film(tmp_path / "bare.gif", dial(0.6))
    bare, _ = shown(tmp_path / "bare.gif")
    extra = len(with_words[0]) - len(bare[0])
    assert 35 <= extra <= 80
    np.testing.assert_array_equal(with_words[3][extra : extra + 200], bare[3][:200])
    dark = np.argwhere(with_words[0][:extra].max(axis=2) < 120)
    assert len(dark) > 500
    rows, columns = dark.T
    assert np.ptp(rows) > 20, "letters of less than two lines"
    assert columns.min() >= 5
    assert columns.max() < WIDTHS["gif"] - 5


@pytest.mark.parametrize("width", [240, 480, 720])
def test_letters_are_large_enough_and_long_lines_stay_inside(width: int) -> None:
    strip = np.asarray(caption(("H", "H" * 12), width)).min(axis=2) < 128
    rows = np.flatnonzero(strip.any(axis=1))
    first = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)[0]
    assert len(first) >= 8, "capitals of less than eight pixels"
    long = np.asarray(caption(("W" * 80,), width)).min(axis=2) < 250
    assert not long[:, -3:].any()
    assert caption((), width).height == 0


@pytest.mark.parametrize(("kind", "message"), [("mpeg", "Unknown animation 'mpeg'"), ("", "Unknown animation ''")])
def test_kinds_that_are_none(kind: str, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        check_film(kind, wanted=False)


def test_a_pillow_without_webp(monkeypatch: pytest.MonkeyPatch) -> None:
    Image.init()
    monkeypatch.delitem(Image.SAVE_ALL, "WEBP", raising=False)
    with pytest.raises(HopdiffError, match=r"animation=webp needs a Pillow .*\.$"):
        check_film("webp")
    check_film("webp", wanted=False)


@pytest.fixture
def on_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Puts a program called ffmpeg, and nothing else, on PATH."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setattr(film_module, "imageio_ffmpeg", None)

    def put(script: str | None = None, **names: str) -> Path:
        program = folder / "ffmpeg"
        if script is not None:
            program.write_text(script.format(python=sys.executable, **names))
            program.chmod(0o755)
        return program

    return put


@pytest.mark.parametrize("encoder", [None, "mpeg2video"])
def test_without_an_encoder_the_sentence_says_how_to_get_one(on_path: Callable[..., Path], encoder: str | None) -> None:
    on_path(None if encoder is None else FAKE, encoder=encoder or "")
    with pytest.raises(HopdiffError, match=r"^animation=mp4 needs an ffmpeg .* `pip install imageio-ffmpeg`\.$"):
        check_film("mp4")
    check_film("mp4", wanted=False)


@pytest.mark.skipif(os.name == "nt", reason="scripts are no programs there")
@pytest.mark.parametrize("encoder", ENCODERS)
@pytest.mark.parametrize("lines", [("a", "b"), ()])
def test_an_encoder_is_given_every_picture_and_the_true_rate(
    tmp_path: Path, on_path: Callable[..., Path], encoder: str, lines: tuple[str, ...]
) -> None:
    program = on_path(FAKE, encoder=encoder)
    assert find_ffmpeg() == (str(program), encoder)
    write_film(tmp_path / "film.mp4", dial(0.6691, lines=lines), width=101)
    *words, given = (tmp_path / "film.mp4").read_text().splitlines()
    said = dict(pairwise(words))
    wide, tall = (int(size) for size in said["-video_size"].split("x"))
    assert (wide % 2, tall % 2) == (0, 0)
    count, micros = (int(part) for part in said["-framerate"].split("/"))
    assert count / micros * 0.6691 == pytest.approx(round(0.6691 * 60), rel=1e-6)
    rounds = int(given) / (3 * wide * tall * round(0.6691 * 60))
    assert rounds == 8  # the first whole number of strides beyond five seconds
    assert said["-c:v"] == encoder


@pytest.mark.skipif(os.name == "nt", reason="scripts are no programs there")
def test_an_encoder_that_fails_leaves_no_file(tmp_path: Path, on_path: Callable[..., Path]) -> None:
    on_path(BROKEN)
    with pytest.raises(HopdiffError, match=r"film\.mp4: .* made no film \(no room for a film\)\.$"):
        write_film(tmp_path / "film.mp4", dial(0.6), width=400)
    assert [path.name for path in tmp_path.iterdir()] == ["programs"]


def test_a_real_encoder_makes_a_film_of_whole_strides(tmp_path: Path) -> None:
    try:
        program, _ = find_ffmpeg()
    except HopdiffError as error:
        pytest.skip(str(error))
    write_film(tmp_path / "film.mp4", dial(0.6691, lines=("a", "b")), width=160)
    told = subprocess.run([program, "-i", str(tmp_path / "film.mp4")], capture_output=True, text=True).stderr
    assert "Video: h264" in told
    hours, minutes, seconds = told.split("Duration: ")[1].split(",")[0].split(":")
    assert 3600 * int(hours) + 60 * int(minutes) + float(seconds) == pytest.approx(8 * 0.6691, abs=0.02)


@pytest.mark.parametrize(("name", "message"), [("film.avi", r"must end in \.gif, \.webp, \.mp4"), ("film", "must end")])
def test_names_that_say_no_format(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        write_film(tmp_path / name, dial(0.6))


def test_a_place_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match=r"nowhere.film\.gif"):
        write_film(tmp_path / "nowhere" / "film.gif", dial(0.6), width=64)
