"""The judge of edits: it knows nothing of hopdiff, passes a clip against itself, and sees what is done to one."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import torch

from experiments.bvh_reading import Body, Floats, body, read
from experiments.edits.asks import KINDS, NOT_YET, Way
from experiments.edits.judge import Bound, Verdict, contacts, judge, stands
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.bvh import read_bvh, write_bvh
from tests.people import file_of, made

ROOT = Path(__file__).resolve().parents[2]
WALK = "walk"


@cache
def source() -> Body:
    with TemporaryDirectory() as folder:
        return body(file_of(WALK, Path(folder)))


def edited(change: Callable[[Clip], Clip], folder: Path) -> Verdict:
    """What the judge says of a walk after a change."""
    path = folder / "edited.bvh"
    write_bvh(path, change(made(WALK)), "ZYX", 100.0)
    return judge(source(), body(path, source()), ())


def turned(clip: Clip, joint: str, axis: str, degrees: torch.Tensor) -> Clip:
    """A joint turned in every frame by some degrees (T,) before what it does."""
    rotations = clip.rotations.clone()
    k = clip.skeleton.index(joint)
    rotations[:, k] = rotations[:, k] @ axis_rotation(axis, torch.deg2rad(degrees)).to(rotations)
    return replace(clip, rotations=rotations)


def moved(clip: Clip, shift: torch.Tensor) -> Clip:
    return replace(clip, root_position=clip.root_position + shift.to(clip.root_position))


def bump(clip: Clip, low: int, high: int) -> torch.Tensor:
    """(T,) from 0 to 1 and back between two frames, without a corner."""
    times = torch.arange(clip.frames, dtype=torch.float64)
    return torch.sin(np.pi * ((times - low) / (high - low)).clamp(0.0, 1.0)) ** 2


@pytest.mark.parametrize("name", ["bvh_reading.py", "edits/judge.py", "edits/joints.py", "edits/asks.py"])
def test_the_judge_shares_nothing_with_what_it_judges(name: str) -> None:
    tree = ast.parse((ROOT / "experiments" / name).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module))
    assert not {one for one in found if one.split(".")[0] in ("hopdiff", "torch")}
    assert {one for one in found if one.startswith("experiments")} <= {
        "experiments.bvh_reading",
        "experiments.edits.joints",
        "experiments.edits.judge",
    }


@pytest.mark.parametrize("name", ["07_01", "16_35", "snu_30hz", "snu_93s", None])
def test_places_are_those_that_hopdiff_reads(name: str | None, tmp_path: Path) -> None:
    captured = ROOT.parent / "shared" / "mocap"
    if name is None:
        path = file_of(WALK, tmp_path)
    else:
        path = next(iter(captured.glob(f"*{name}*.bvh")), captured)
        if not path.is_file():
            pytest.skip("more of the same with a captured clip, which is not part of the project")
    own, clip = body(path), read_bvh(path).clip()
    positions, turns = clip.forward()
    assert own.bvh.names == tuple(clip.skeleton.names)
    assert np.abs(own.places[:, : len(own.bvh.names)] - positions.numpy()).max() < 1e-4
    assert np.abs(own.turns - turns.numpy()).max() < 1e-4


def test_a_file_passes_against_itself(tmp_path: Path) -> None:
    verdict = edited(lambda clip: clip, tmp_path)
    assert verdict.passed, verdict.words()
    assert verdict.words() == "pass"
    assert verdict.numbers["speed"] == verdict.numbers["jerk"] == 1.0
    assert 0.5 < verdict.others["share"] <= 1.0


def test_a_walk_carried_elsewhere_and_turned_as_a_whole_passes_but_for_frame_0(tmp_path: Path) -> None:
    def carried(clip: Clip) -> Clip:
        turn = axis_rotation("Y", torch.tensor(0.7, dtype=torch.float64))
        rotations = clip.rotations.clone().double()
        rotations[:, 0] = turn @ rotations[:, 0]
        return replace(clip, root_position=clip.root_position.double() @ turn.T + 1.0, rotations=rotations)

    def flat(clip: Clip) -> Clip:
        return moved(carried(clip), torch.tensor([0.0, -1.0, 0.0]))

    assert set(edited(flat, tmp_path).failed) == {"frame 0"}


def test_a_shifted_frame_0_is_seen(tmp_path: Path) -> None:
    def shifted(clip: Clip) -> Clip:
        shift = torch.zeros(clip.frames, 3)
        shift[0, 0] = 0.002
        return moved(clip, shift)

    assert edited(shifted, tmp_path).numbers["frame 0"] == pytest.approx(0.002, abs=1e-5)
    assert "frame 0 2 mm" in edited(shifted, tmp_path).words()


def test_a_foot_moved_by_3_cm_while_it_stands_drifts(tmp_path: Path) -> None:
    feet = contacts(source())
    inside = np.flatnonzero(feet[:, 0]).tolist()
    first = next(k for k in inside if k > 5 and not feet[k - 1, 0])
    last = next(k for k in range(first, source().frames) if not feet[k, 0])
    heel = source().places[first:last, source().legs[0].ankle, ::2]
    away = (heel[-1] - heel[0]) / np.hypot(*(heel[-1] - heel[0]))

    def dragged(clip: Clip) -> Clip:
        wave = bump(clip, first, 2 * last - first)  # all the way until the foot is lifted
        return moved(clip, 0.03 * wave[:, None] * torch.tensor([away[0], 0.0, away[1]]))

    verdict = edited(dragged, tmp_path)
    assert verdict.numbers["drift"] > 0.02
    assert "drift" in verdict.failed
    assert verdict.others["skid"] > 0.01


def test_a_lowered_body_drops_and_sinks(tmp_path: Path) -> None:
    def lowered(clip: Clip) -> Clip:
        return moved(clip, bump(clip, 10, clip.frames - 10)[:, None] * torch.tensor([0.0, -0.1, 0.0]))

    verdict = edited(lowered, tmp_path)
    assert verdict.numbers["root drop"] == pytest.approx(0.1, abs=1e-3)
    assert {"root drop", "height"} <= set(verdict.failed)


def test_a_knee_bent_backwards_is_seen_whichever_way_its_axis_points(tmp_path: Path) -> None:
    names = source().bvh.names
    knee = names[source().legs[0].knee]

    def broken(sign: float) -> Callable[[Clip], Clip]:
        return lambda clip: turned(clip, knee, "X", sign * 60.0 * bump(clip, 10, clip.frames - 10))

    more = [edited(broken(sign), tmp_path).numbers["knee"] for sign in (1.0, -1.0)]
    assert min(more) < 1.0 < 20.0 < max(more)


def test_a_jump_of_one_frame_is_jerk(tmp_path: Path) -> None:
    hip = source().bvh.names[source().legs[1].hip]

    def jumped(clip: Clip) -> Clip:
        degrees = torch.zeros(clip.frames, dtype=torch.float64)
        degrees[clip.frames // 2] = 15.0
        return turned(clip, hip, "X", degrees)

    assert {"jerk"} <= set(edited(jumped, tmp_path).failed)


def test_a_body_that_skates_slides(tmp_path: Path) -> None:
    def skating(clip: Clip) -> Clip:
        times = clip.frame_time * torch.arange(clip.frames, dtype=torch.float64)
        return moved(clip, 0.1 * times[:, None] * torch.tensor([0.0, 0.0, 1.0]))

    assert {"slide", "drift"} <= set(edited(skating, tmp_path).failed)


def test_an_arm_held_otherwise_at_the_end_is_another_last_pose(tmp_path: Path) -> None:
    shoulder = next(name for name in source().bvh.names if "shoulder" in name.lower() or "arm" in name.lower())

    def raised(clip: Clip) -> Clip:
        degrees = torch.zeros(clip.frames, dtype=torch.float64)
        degrees[-1] = 1.0
        return turned(clip, shoulder, "X", degrees)

    assert "last pose" in edited(raised, tmp_path).failed


def test_a_leg_that_shakes_is_too_fast(tmp_path: Path) -> None:
    knee = source().bvh.names[source().legs[0].knee]

    def shaking(clip: Clip) -> Clip:
        times = clip.frame_time * torch.arange(clip.frames, dtype=torch.float64)
        return turned(clip, knee, "Y", 40.0 * torch.sin(2.0 * np.pi * 6.0 * times))

    assert "speed" in edited(shaking, tmp_path).failed


def test_a_turn_of_the_whole_body_is_no_speed_of_its_joints(tmp_path: Path) -> None:
    def turning(clip: Clip) -> Clip:
        angles = 3.0 * clip.frame_time * torch.arange(clip.frames, dtype=torch.float64)
        rotations = clip.rotations.double().clone()
        rotations[:, 0] = axis_rotation("Y", angles) @ rotations[:, 0]
        return replace(clip, rotations=rotations)

    numbers = edited(turning, tmp_path).numbers
    assert numbers["speed"] == pytest.approx(1.0, abs=1e-3)
    assert numbers["jerk"] == pytest.approx(1.0, abs=1e-2)


def test_hovering_is_no_way_to_pass(tmp_path: Path) -> None:
    def hovering(clip: Clip) -> Clip:
        middle = slice(10, clip.frames - 10)
        times = torch.arange(clip.frames, dtype=torch.float64)
        shift = torch.zeros(clip.frames, 3, dtype=torch.float64)
        shift[middle, 1] = 0.12 * torch.sin(times[middle] * 0.9) ** 2
        return moved(clip, shift)

    assert {"contact"} <= set(edited(hovering, tmp_path).failed)


def test_arrival_is_measured_where_it_was_asked_for() -> None:
    own = source()
    x, z = own.places[-1, own.mover, ::2]
    there = Bound(own.frames - 1, (float(x), float(z) + 0.005), 2.0)
    numbers = judge(own, own, (there,)).numbers
    assert numbers["arrival"] == pytest.approx(0.005)
    assert numbers["turn"] == pytest.approx(2.0)


def test_on_a_slope_feet_are_high_over_the_floor_and_not_over_the_ground(tmp_path: Path) -> None:
    def downhill(clip: Clip) -> Clip:
        rise = -0.01 * clip.root_position[:, 2]
        return moved(clip, torch.stack((torch.zeros_like(rise), rise, torch.zeros_like(rise)), dim=1))

    path = tmp_path / "edited.bvh"
    write_bvh(path, downhill(made(WALK)), "ZYX", 100.0)
    numbers = judge(source(), body(path, source()), (), lambda x, z: -0.01 * z).numbers
    assert numbers["height"] < 0.01
    assert abs(numbers["root drop"]) < 0.005
    assert judge(source(), body(path, source()), ()).numbers["height"] > 0.01


@pytest.mark.parametrize(
    "names",
    [
        ("mixamorig:LeftUpLeg", "mixamorig:LeftLeg", "mixamorig:LeftFoot", "mixamorig:LeftToeBase"),
        ("LeftHip", "LeftKnee", "LeftAnkle", "LeftToe"),
        ("thigh_l", "calf_l", "foot_l", "ball_l"),
        ("Bip01 L Thigh", "Bip01 L Calf", "Bip01 L Foot", "Bip01 L Toe0"),
        ("lThigh", "lShin", "lFoot", "lToe"),
    ],
)
def test_legs_of_other_names_are_found(names: tuple[str, ...], tmp_path: Path) -> None:
    path = file_of(WALK, tmp_path)
    text, own = path.read_text(), source().bvh.names
    leg = source().legs[0]
    assert leg.toe is not None
    swap = [(own[k], new) for k, new in zip((leg.hip, leg.knee, leg.ankle, leg.toe), names, strict=True)]
    right = {"Left": "Right", "_l": "_r", " L ": " R ", "l": "r"}
    mark = next(one for one in right if one in names[0])
    leg = source().legs[1]
    assert leg.toe is not None
    for k, new in zip((leg.hip, leg.knee, leg.ankle, leg.toe), names, strict=True):
        other = new[::-1].replace(mark[::-1], right[mark][::-1], 1)[::-1] if mark == "_l" else new
        swap.append((own[k], other if mark == "_l" else new.replace(mark, right[mark], 1)))
    for old, new in swap:
        text = text.replace(f"JOINT {old}\n", f"JOINT {new}\n")
    (tmp_path / "named.bvh").write_text(text)
    found = body(tmp_path / "named.bvh")
    assert found.legs == source().legs
    assert found.bvh.names[found.legs[0].knee] == names[1]


def test_a_file_of_another_length_than_declared_is_none(tmp_path: Path) -> None:
    path = file_of(WALK, tmp_path)
    lines = path.read_text().rstrip().splitlines()
    (tmp_path / "short.bvh").write_text("\n".join(lines[:-1]))
    with pytest.raises(ValueError, match="declared"):
        read(tmp_path / "short.bvh")


def test_every_kind_of_edit_says_what_it_is_bound_to() -> None:
    way = Way.of(source())
    assert set(NOT_YET) < set(KINDS)
    for kind, make in KINDS.items():
        ask = make(way)
        assert ask.words, kind
        assert any(one.place is not None for one in ask.bound), kind
        assert (ask.ground is not None) == (kind in NOT_YET), kind


def test_a_heel_that_comes_up_sooner_while_the_toes_stand_slides_on_level_ground_alone(tmp_path: Path) -> None:
    """Where ground rises it must."""
    own = source()
    feet = contacts(own)
    leg = own.legs[0]
    (first, last) = next((a, b) for k, a, b in stands(feet) if k == 1 and a > 5)

    def lifted(clip: Clip) -> Clip:
        """The foot turned about its ball, and the body so that this stays: seen from the foot alone."""
        turns = bump(clip, first, 2 * last - first)
        return turned(clip, "LeftFoot", "X", 45.0 * turns)

    path = tmp_path / "edited.bvh"
    write_bvh(path, lifted(made(WALK)), "ZYX", 100.0)
    made_body = body(path, own)
    # As if the body had been put where the ball of the foot is again.
    off = made_body.places[:, leg.feet[1]] - own.places[:, leg.feet[1]]
    there = replace(made_body, places=made_body.places - off[:, None])
    level = judge(own, there, ())
    uneven = judge(own, there, (), lambda x, z: np.zeros_like(x))
    assert level.numbers["drift"] > uneven.numbers["drift"] + 0.01
    # One that drags its toes along does slide there too.
    drag = np.zeros_like(there.places)
    drag[first:last, :, 0] = np.linspace(0.0, 0.05, last - first)[:, None]
    dragged = judge(own, replace(there, places=there.places + drag), (), lambda x, z: np.zeros_like(x))
    assert "drift" in dragged.failed


def test_a_body_may_be_as_low_as_a_foot_that_stands_lower_asks_and_no_lower() -> None:
    own = source()
    x = own.places[:, own.mover, ::2]
    middle, ahead = x[own.frames // 2], (x[-1] - x[0]) / np.hypot(*(x[-1] - x[0]))

    def step(p: Floats, q: Floats) -> Floats:
        """A tread of .17 m in the middle of the way."""
        return np.where((p - middle[0]) * ahead[0] + (q - middle[1]) * ahead[1] > 0.0, 0.17, 0.0)

    low = judge(own, own, (), step).numbers["root drop"]
    # All of the walk is left on the lower floor: past the step nothing stands lower.
    assert low == pytest.approx(0.17, abs=1e-6)
    climbed = own.places.copy()
    climbed[..., 1] += np.convolve(np.pad(step(x[:, 0], x[:, 1]), 15, mode="edge"), np.ones(31) / 31, mode="valid")[
        :, None
    ]
    assert judge(own, replace(own, places=climbed), (), step).numbers["root drop"] < 0.08
