"""Takes that tests of exports start from."""

from __future__ import annotations

from functools import cache

from hopdiff.export.take import Take
from tests.builders import make_character
from tests.editing.walks import stride_motion
from tests.people import clip_of

WALKS = ("walk", "walk without toes", "walk_straight_cmu_16_15", "walk_straight_snu_30hz")


@cache
def own() -> Take:
    """One stride of a run of our own on its eleven joints."""
    body = make_character()
    masses = dict(zip(body.skeleton.names, body.masses.tolist(), strict=True))
    return Take.of_motion("run", stride_motion(), masses, {"speed": 3.0, "beta": 0.2})


@cache
def walked(name: str = WALKS[0]) -> Take:
    """Of one who is made up, or captured: nothing but the clip is known."""
    return Take.of_clip(name, clip_of(name), {})
