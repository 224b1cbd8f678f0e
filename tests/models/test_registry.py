"""Models by name, and the bounds of their settings."""

from __future__ import annotations

import pytest

from hopdiff.choices import build_model
from hopdiff.models import MODELS, AnyModel
from hopdiff.models.limp import LimpSettings
from hopdiff.models.smooth import SmoothModel
from hopdiff.models.thesis import ThesisModel
from hopdiff.types import HopdiffError
from hopdiff.whole_body.model import BodyModel
from tests.builders import limp_settings, make_character, settings_of

KINDS = {"body": BodyModel, "smooth": SmoothModel, "thesis": ThesisModel}


def model(name: str, limp: LimpSettings | None = None, **changed: float) -> AnyModel:
    plain = settings_of("model", name if name in MODELS else "smooth") | changed | {"name": name}
    return build_model(plain, make_character(), limp or limp_settings())


def test_every_name_builds_its_model_with_its_settings() -> None:
    assert sorted(KINDS) == sorted(MODELS)
    for name, kind in KINDS.items():
        assert type(model(name)) is kind
    smooth = model("smooth", nodes=20, sweeps=3)
    assert isinstance(smooth, SmoothModel)
    assert (smooth.nodes, smooth.sweeps) == (20, 3)
    thesis = model("thesis", step=0.002, strides=5)
    assert isinstance(thesis, ThesisModel)
    assert (thesis.step, thesis.strides) == (0.002, 5)
    with pytest.raises(HopdiffError, match=r"Unknown model\.name 'robot': choose one of body, smooth, thesis"):
        model("robot")


@pytest.mark.parametrize(
    ("setting", "low", "high"),
    [
        ("rounds", 4, 100),
        ("adjoint_rounds", 1, 100),
        ("nodes", 4, 64),
        ("sweeps", 1, 100),
        ("step", 1e-4, 0.02),
        ("strides", 0, 1000),
    ],
)
def test_settings_reach_to_their_bounds_and_no_further(setting: str, low: float, high: float) -> None:
    more = 1e-5 if setting == "step" else 1
    (name,) = (name for name in MODELS if setting in settings_of("model", name))
    for value in (low, high):
        model(name, **{setting: value})
    for value in (low - more, high + more):
        with pytest.raises(HopdiffError, match=rf"^model\.{setting} must lie between"):
            model(name, **{setting: value})


@pytest.mark.parametrize("name", ["smooth", "thesis"])
def test_a_limp_of_nothing_is_none(name: str) -> None:
    lame = model(name, limp=limp_settings("right", 0.3))
    assert isinstance(lame, SmoothModel | ThesisModel)
    assert lame.limp == limp_settings("right", 0.3)
    assert lame.sound.limp is None
    sound = model(name, limp=limp_settings("right", 0.0))
    assert isinstance(sound, SmoothModel | ThesisModel)
    assert sound.limp is None
    with pytest.raises(HopdiffError, match=r"limp\.amount"):
        model(name, limp=limp_settings("right", 0.9))


@pytest.mark.parametrize(("setting", "low", "high"), [("amount", 0.0, 0.8), ("haste", 0.0, 1.0)])
def test_a_limp_reaches_to_its_bounds(setting: str, low: float, high: float) -> None:
    for value in (low, high):
        limp_settings(**{setting: value}).check()
    for value in (low - 1e-6, high + 1e-6):
        with pytest.raises(HopdiffError, match=rf"^limp\.{setting} must lie between"):
            limp_settings(**{setting: value}).check()
