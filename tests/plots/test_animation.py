from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from hopdiff.motion import Motion
from hopdiff.plots.animation import stride_film
from hopdiff.plots.film import write_film


def frames_of(path: Path) -> tuple[list[np.ndarray], list[int]]:
    """Pictures as seen, and milliseconds each is shown."""
    with Image.open(path) as gif:
        shown = [
            (np.asarray(frame.convert("RGB"), dtype=int), frame.info["duration"])
            for frame in ImageSequence.Iterator(gif)
        ]
    return [picture for picture, _ in shown], [duration for _, duration in shown]


@pytest.fixture
def gif(motion: Motion, tmp_path: Path) -> Path:
    write_film(tmp_path / "run.gif", stride_film(motion))
    return tmp_path / "run.gif"


def test_it_runs_at_true_speed_forever(gif: Path, motion: Motion) -> None:
    _, delays = frames_of(gif)
    assert sum(delays) == pytest.approx(1000 * float(motion.times[-1]), abs=5.0)
    with Image.open(gif) as picture:
        assert picture.info["loop"] == 0
    assert gif.stat().st_size < 500_000


def test_the_loop_has_no_seam(gif: Path) -> None:
    pictures, _ = frames_of(gif)
    changes = [np.abs(b - a).mean() for a, b in zip(pictures, [*pictures[1:], pictures[0]], strict=True)]
    assert min(changes) > 0.1 * float(np.median(changes)), "a frame is shown twice"
    assert changes[-1] < 1.5 * max(changes[:-1]), "the end does not lead to the start"


def test_the_runner_stays_in_the_picture_and_above_the_ground(gif: Path) -> None:
    pictures, _ = frames_of(gif)
    height, width, _ = pictures[0].shape
    for picture in pictures:
        orange = (picture[..., 0] > 180) & (picture[..., 2] < 40)
        rows, columns = np.nonzero(orange)
        assert len(rows) > 0.01 * height * width, "the near side is not drawn"
        assert columns.min() > 0
        assert columns.max() < width - 1
        assert (picture[0] == 255).all(), "no air above the head"


def test_the_ground_moves_backwards_evenly_over_the_seam_too(gif: Path) -> None:
    pictures, delays = frames_of(gif)
    rows = [picture[-12] for picture in pictures]
    marks = [(row[:, 0] < 230) & (np.ptp(row, axis=1) < 40) for row in rows]  # grey, so no foot
    speeds = []
    for mark, following, delay in zip(marks, [*marks[1:], marks[0]], delays, strict=True):
        # How far the next picture must be pushed forward to fit this one.
        overlap = [int((mark[80:-80] & np.roll(following, shift)[80:-80]).sum()) for shift in range(-80, 81)]
        speeds.append((int(np.argmax(overlap)) - 80) / delay)
    assert min(speeds) > 0
    assert max(speeds) - min(speeds) < 0.1 * float(np.median(speeds)) + 2 / min(delays)


def test_the_caption_goes_on_with_how_long_the_stride_is(motion: Motion) -> None:
    film = stride_film(motion, ("4 m/s, beta 0.7", "model body"))
    assert film.caption == ("4 m/s, beta 0.7", "model body; a stride of 0.680 s at true speed")
    assert film.duration == pytest.approx(0.68)
    assert stride_film(motion).caption == ()
