"""What a browser without a screen makes of a page that plays motions, against those motions."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from hopdiff.export.take import Take
from hopdiff.geometry.quaternion import slerp
from hopdiff.types import HopdiffError

VARIABLE = "HOPDIFF_CHROMIUM"
PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
# Without a graphics card and without a sandbox, which containers do not allow.
FLAGS = (
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
SIZE = (1280, 800)
LOOKS = 4  # at a page while it plays
PATIENCE = 60_000  # ms
COUNT = """(seconds) => new Promise((done) => {
  const [begun, before] = [performance.now(), hopdiff.drawn];
  setTimeout(() => done(1000 * (hopdiff.drawn - before) / (performance.now() - begun)), 1000 * seconds);
})"""


@dataclass(frozen=True)
class Played:
    """What a page did. shades: different colours in the picture of the figure. moved: of any joint while it played [m].

    shown: the frame that the slider was set to, and what the page then said. worst: farthest that a joint of any motion
    was from ours at the frames that were set [m]. errors: of the console. requests: that left the page.
    """

    shades: int
    moved: float
    shown: tuple[tuple[int, int], ...]
    worst: float
    errors: tuple[str, ...]
    requests: tuple[str, ...]
    version: str


def find_chromium() -> str:
    """The browser that HOPDIFF_CHROMIUM names, or one on PATH. Raises HopdiffError without one, or Playwright."""
    try:
        import playwright.sync_api  # noqa: F401
    except ImportError as error:
        raise HopdiffError("Playwright is missing: pip install -c constraints.txt -e '.[browser]'.") from error
    for program in (os.environ.get(VARIABLE), *PROGRAMS):
        if program and (found := shutil.which(program)):
            return found
    raise HopdiffError(f"there is no Chromium: set {VARIABLE} to one.")


@contextmanager
def opened(
    file: Path, size: tuple[int, int] = SIZE, dark: bool = False, still: bool = False
) -> Iterator[tuple[Any, list[str], list[str]]]:
    """A page that is ready, its console errors and the requests that left it; both lists grow. Yields all three.

    still: whether the browser asks for less motion, so that the page does not begin to play.
    """
    from playwright.sync_api import sync_playwright

    errors: list[str] = []
    requests: list[str] = []
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=find_chromium(), args=list(FLAGS))
        wide, high = size
        page = browser.new_page(
            viewport={"width": wide, "height": high},
            color_scheme="dark" if dark else "light",
            reduced_motion="reduce" if still else "no-preference",
        )
        page.set_default_timeout(PATIENCE)
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        own = file.resolve().as_uri()
        page.on("request", lambda request: None if _inside(request.url, own) else requests.append(request.url))
        page.goto(own)
        page.wait_for_function("window.hopdiff && window.hopdiff.ready")
        try:
            yield page, errors, requests
        finally:
            browser.close()


def frames_per_second(file: Path, seconds: float = 4.0) -> float:
    """Pictures a second that a page draws while it plays, once it has found how fine they may be."""
    with opened(file) as (page, _, _):
        page.evaluate("hopdiff.play()")
        page.wait_for_timeout(3000)
        return float(page.evaluate(COUNT, seconds))


def _inside(url: str, own: str) -> bool:
    return url == own or url.startswith(("data:", "blob:"))


def played(file: Path, takes: Sequence[Take], frames: Sequence[int], picture: Path | None = None) -> Played:
    """Open a page, let it play, set its slider to some frames of the longest take, and compare all joints.

    picture: a PNG file for what the page then shows.
    """
    with opened(file) as (page, errors, requests):
        page.evaluate("hopdiff.pause(); hopdiff.setFrame(0)")
        before = _positions(page, takes)
        page.click("#play")
        moved = 0.0
        # Now and then: a loop may just be where it began.
        for _ in range(LOOKS):
            page.wait_for_timeout(150)
            moved = max(
                moved,
                *(float((a - b).norm(dim=-1).max()) for a, b in zip(_positions(page, takes), before, strict=True)),
            )
        page.click("#play")
        shown, worst = [], 0.0
        longest = max(takes, key=lambda take: take.clip.duration)
        for frame in frames:
            # As a hand would: the slider tells the page itself.
            page.eval_on_selector(
                "#frame", "(slider, n) => { slider.value = n; slider.dispatchEvent(new Event('input')); }", frame
            )
            shown.append((frame, page.evaluate("hopdiff.frame")))
            time = frame * longest.clip.frame_time
            for take, found in zip(takes, _positions(page, takes), strict=True):
                worst = max(worst, float((found - _at(take, time)).norm(dim=-1).max()))
        page.wait_for_timeout(200)
        shot = page.locator("#canvas").screenshot()
        pixels = np.asarray(Image.open(BytesIO(shot)).convert("RGB")).reshape(-1, 3)
        if picture is not None:
            page.screenshot(path=str(picture))
        version = page.context.browser.version
    return Played(len(np.unique(pixels, axis=0)), moved, tuple(shown), worst, tuple(errors), tuple(requests), version)


def in_colour(page: Any) -> NDArray[np.bool_]:
    """Which pixels of the picture are strongly coloured: left and right sides of bodies, their footprints and ways."""
    shot = page.locator("#canvas").screenshot()
    pixels = np.asarray(Image.open(BytesIO(shot)).convert("RGB")).astype(int)
    return np.ptp(pixels, axis=-1) > 90


def _positions(page: Any, takes: Sequence[Take]) -> list[torch.Tensor]:
    """(J, 3) of every take, as the page has them [m]."""
    found = []
    for k, take in enumerate(takes):
        places = page.evaluate("k => hopdiff.positions(k)", k)
        found.append(torch.tensor([places[name] for name in take.clip.skeleton.names], dtype=torch.float64))
    return found


def _at(take: Take, time: float) -> torch.Tensor:
    """(J, 3) of a take at a time, of a loop in its lap [m]."""
    duration = take.clip.duration
    if take.loop:
        # The last frame is of the lap that it ends.
        time -= max(0, int(np.ceil(time / duration - 1e-9)) - 1) * duration
    place = min(max(time, 0.0), duration) / take.clip.frame_time
    first = min(int(place), take.frames - 2)
    share, clip = torch.tensor(place - first, dtype=torch.float64), take.clip
    between = replace(
        clip,
        root_position=torch.lerp(clip.root_position[first], clip.root_position[first + 1], share)[None],
        rotations=slerp(clip.rotations[first : first + 1], clip.rotations[first + 1 : first + 2], share[None, None]),
        offsets=None if clip.offsets is None else torch.lerp(clip.offsets[first], clip.offsets[first + 1], share)[None],
    )
    return between.joint_positions()[0]
