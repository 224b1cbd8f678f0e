"""Longer legs, shorter arms: what a factor changes, and what it leaves alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf
from torch import Tensor

from hopdiff.character import Character
from hopdiff.cli import main
from hopdiff.proportions import PROPORTIONS
from hopdiff.types import HopdiffError
from tests.builders import make_character, settings_of

PARTS = {
    "legs": {"left_hip", "left_knee", "right_hip", "right_knee"},
    "arms": {"left_shoulder", "left_elbow", "right_shoulder", "right_elbow"},
    "trunk": {"pelvis", "waist"},
    "head": {"neck"},
}
BODIES = ("human", "child", "cartoon")
FACTORS = (0.7, 1.3)


def changed(name: str = "human", /, **factors: float) -> Character:
    proportions = dict.fromkeys(PARTS, 1.0) | factors
    return Character.build(OmegaConf.create(settings_of("character", name) | {"proportions": proportions}))


def lengths(body: Character) -> dict[str, float]:
    """From every joint to those that hang on it and to its end [m], without the way to the side."""
    skeleton = body.skeleton
    found = {}
    for name, parent, offset in zip(skeleton.names, skeleton.parents, skeleton.offsets, strict=True):
        if parent >= 0:
            found[f"{skeleton.names[parent]} to {name}"] = float(offset[1:].norm())
    return found | {f"{name} to its end": float(end.norm()) for name, end in skeleton.end_sites.items()}


def standing(body: Character) -> tuple[Tensor, dict[str, Tensor]]:
    """Places of joints and ends in the rest pose."""
    still = torch.eye(3, dtype=torch.float64).expand(len(body.skeleton.names), 3, 3)
    positions, orientations = body.skeleton.forward(body.skeleton.offsets[0], still)
    return positions, body.skeleton.end_positions(positions, orientations)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", BODIES)
def test_a_factor_changes_the_lengths_of_its_part_and_no_others(name: str, part: str, factor: float) -> None:
    before, after = make_character(name), changed(name, **{part: factor})
    grown = lengths(after)
    for between, length in lengths(before).items():
        wanted = factor if between.split(" to ")[0] in PARTS[part] else 1.0
        assert grown[between] == pytest.approx(wanted * length, rel=1e-12), between
    widths = [body.skeleton.offsets[:, 0] for body in (before, after)]
    assert torch.equal(*widths)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("part", PARTS)
def test_leg_length_and_standing_height_follow(part: str, factor: float) -> None:
    before, after = make_character(), changed(**{part: factor})
    legs = factor if part == "legs" else 1.0
    for name in ("leg_length", "thigh", "shank"):
        assert getattr(after, name) == pytest.approx(legs * getattr(before, name), rel=1e-12)
    assert after.hip_half_width == before.hip_half_width
    joints, ends = standing(before)
    hips, head = float(joints[0, 1]), float((ends["neck"] - joints[before.skeleton.index("neck")])[1])
    tall = {"legs": before.leg_length, "arms": 0.0, "trunk": before.height - hips - head, "head": head}[part]
    assert after.height - before.height == pytest.approx((factor - 1.0) * tall, abs=1e-12)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("name", BODIES)
def test_a_changed_body_stands_on_the_ground(name: str, part: str, factor: float) -> None:
    body = changed(name, **{part: factor})
    _, ends = standing(body)
    for side in ("left", "right"):
        assert float(ends[f"{side}_knee"][1]) == pytest.approx(0.0, abs=1e-9)
    assert float(ends["neck"][1]) == pytest.approx(body.height, abs=1e-12)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("part", PARTS)
def test_mass_goes_with_length_and_the_whole_keeps_its_mass(part: str, factor: float) -> None:
    before, after = make_character(), changed(**{part: factor})
    assert after.mass == before.mass
    assert float(after.masses.sum()) == pytest.approx(before.mass, rel=1e-12)
    ratios = (after.masses / before.masses).tolist()
    inside = {ratio for joint, ratio in zip(before.skeleton.names, ratios, strict=True) if joint in PARTS[part]}
    outside = {ratio for joint, ratio in zip(before.skeleton.names, ratios, strict=True) if joint not in PARTS[part]}
    assert max(inside) == pytest.approx(min(inside), rel=1e-12)
    assert max(outside) == pytest.approx(min(outside), rel=1e-12)
    assert max(inside) == pytest.approx(factor * max(outside), rel=1e-12)


def test_a_limb_turns_as_a_longer_one_does() -> None:
    """Moments of inertia go with mass times length squared; the mass of the whole is shared out anew."""
    before, after = make_character(), changed(legs=1.2)
    hip = before.skeleton.index("left_hip")
    heavier = float(after.masses[hip] / before.masses[hip])
    assert torch.allclose(after.inertias[hip], 1.2**2 * heavier * before.inertias[hip])
    assert torch.allclose(after.coms[hip], 1.2 * before.coms[hip])
    elbow = before.skeleton.index("left_elbow")
    assert torch.allclose(after.coms[elbow], before.coms[elbow])


@pytest.mark.parametrize("part", PARTS)
def test_both_sides_stay_alike(part: str) -> None:
    body = changed(**{part: 1.3})
    mirror = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    for joint in ("shoulder", "elbow", "hip", "knee"):
        left, right = (body.skeleton.index(f"{side}_{joint}") for side in ("left", "right"))
        assert torch.equal(body.skeleton.offsets[left] * mirror, body.skeleton.offsets[right])
        assert torch.equal(body.coms[left] * mirror, body.coms[right])
        assert torch.equal(body.masses[left], body.masses[right])
        assert torch.allclose(body.inertias[left], body.inertias[right])


@pytest.mark.parametrize("name", BODIES)
def test_factors_of_one_are_the_body_without_them(name: str) -> None:
    plain = settings_of("character", name)
    plain["proportions"] = dict.fromkeys(PARTS, 1)
    same, body = Character.build(OmegaConf.create(plain)), make_character(name)
    assert (same.height, same.mass, same.leg_length) == (body.height, body.mass, body.leg_length)
    assert same.height == pytest.approx(plain["height"], abs=1e-12)
    for what in ("masses", "coms", "inertias"):
        assert torch.equal(getattr(same, what), getattr(body, what))
    assert torch.equal(same.skeleton.offsets, body.skeleton.offsets)


def test_all_factors_alike_make_a_larger_body_of_the_same_shape() -> None:
    """But for its widths, which no factor changes."""
    before, after = make_character(), changed(**dict.fromkeys(PARTS, 1.25))
    assert after.height == pytest.approx(1.25 * before.height)
    assert torch.allclose(after.masses, before.masses)
    assert torch.allclose(after.skeleton.offsets[:, 1:], 1.25 * before.skeleton.offsets[:, 1:])


@pytest.mark.parametrize("factor", PROPORTIONS)
@pytest.mark.parametrize("part", PARTS)
def test_the_ends_of_the_range_are_allowed(part: str, factor: float) -> None:
    body = changed(**{part: factor})
    assert body.leg_length / make_character().leg_length == pytest.approx(factor if part == "legs" else 1.0)


@pytest.mark.parametrize("factor", [0.49, 2.01, 0.0, -1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("part", PARTS)
def test_a_factor_out_of_range_names_its_setting(part: str, factor: float) -> None:
    with pytest.raises(HopdiffError) as caught:
        changed(**{part: factor})
    assert str(caught.value) == f"character.proportions.{part} must lie between 0.5 and 2, not {factor:g}."


@pytest.mark.few(5)
@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("legs=2.5", "character.proportions.legs must lie between 0.5 and 2, not 2.5."),
        ("arms=0.4", "character.proportions.arms must lie between 0.5 and 2, not 0.4."),
        ("trunk=nan", "character.proportions.trunk must lie between 0.5 and 2, not nan."),
        ("head=inf", "character.proportions.head must lie between 0.5 and 2, not inf."),
        ("legs=long", "character.proportions.legs must be a number, not 'long'."),
        ("leg=1.2", "Unknown setting 'character.proportions.leg'. Did you mean 'character.proportions.legs'?"),
    ],
)
@pytest.mark.parametrize("task", ["run", "body"])
def test_a_wrong_factor_typed_is_one_sentence_and_leaves_nothing(
    task: str,
    override: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hopdiff", f"task={task}", f"character.proportions.{override}"])
    assert main() == 1
    assert capsys.readouterr() == ("", f"hopdiff: {said}\n")
    assert list(tmp_path.iterdir()) == []


def test_a_run_follows_its_legs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    metrics: list[dict[str, Any]] = []
    for legs in (1.0, 1.2):
        words = ["model=smooth", "search=ordinary", "pictures=false", f"character.proportions.legs={legs}"]
        monkeypatch.setattr("sys.argv", ["hopdiff", *words, f"hydra.run.dir={tmp_path / str(legs)}"])
        assert main() == 0
        metrics.append(json.loads((tmp_path / str(legs) / "metrics.json").read_text()))
    plain, long = metrics
    assert long["leg_length"] == pytest.approx(1.2 * plain["leg_length"])
    assert long["froude"] == pytest.approx(plain["froude"] / math.sqrt(1.2))
    assert long["speed"] == plain["speed"]
    assert (plain["character"], long["character"]) == ("human", "human+legs=1.2")
