"""The checker of finished runs on captured clips: small ones that are made up, a run of our own, and two of people."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hopdiff.export.anatomy import renamed
from hopdiff.export.full_body import full_body
from hopdiff.io.bvh import write_bvh
from tests.experiments.physics_motions import GRAVITY
from tests.export.takes import own
from tests.people import captured_file

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def bone(name: str, offset: str, *children: str) -> str:
    channels = "Zrotation Yrotation Xrotation"
    kind = f"ROOT {name}" if name == "Hips" else f"JOINT {name}"
    channels = f"6 Xposition Yposition Zposition {channels}" if name == "Hips" else f"3 {channels}"
    below = "\n".join(children) or "End Site\n{\nOFFSET 0 10 5\n}"
    return f"{kind}\n{{\nOFFSET {offset}\nCHANNELS {channels}\n{below}\n}}"


def bvh(heights: np.ndarray, speed: float) -> str:
    """A body in T-pose whose hips move straight ahead at some heights [m], 120 frames/s, centimetres."""
    limbs = {}
    for side, s in (("Left", 1), ("Right", -1)):
        foot = bone(f"{side}Foot", "0 -42 0", bone(f"{side}ToeBase", "0 -6 14"))
        limbs[side] = bone(f"{side}UpLeg", f"{9 * s} -5 0", bone(f"{side}Leg", "0 -42 0", foot))
        hand = bone(f"{side}ForeArm", f"{28 * s} 0 0", bone(f"{side}Hand", f"{26 * s} 0 0"))
        limbs[f"{side}Arm"] = bone(f"{side}Arm", f"{18 * s} 14 0", hand)
    chest = bone("Spine1", "0 20 0", bone("Neck", "0 20 0", bone("Head", "0 8 0")), limbs["LeftArm"], limbs["RightArm"])
    head = f"HIERARCHY\n{bone('Hips', '0 0 0', limbs['Left'], limbs['Right'], bone('Spine', '0 12 0', chest))}"
    angles = " ".join(["0"] * 3 * head.count("CHANNELS"))
    lines = [f"0 {100 * y:.6f} {100 * speed * i / 120:.6f} {angles}" for i, y in enumerate(heights)]
    return "\n".join([head, "MOTION", f"Frames: {len(lines)}", "Frame Time: 0.00833333", *lines, ""])


def test_a_captured_body_that_is_thrown_has_no_force_on_it(tmp_path: Path) -> None:
    from experiments.physics.captured import read_clip
    from experiments.physics.check import check

    times = np.arange(100) / 120
    (tmp_path / "thrown.bvh").write_text(bvh(1.5 + 4 * times - 0.5 * GRAVITY * times**2, 3.0))
    recording = read_clip(tmp_path / "thrown.bvh")
    assert recording.mass == pytest.approx(70.0)
    figures = check(recording)
    assert figures["flight_share"] == 1.0
    assert figures["flight_force_max_bw"] < 0.02
    assert figures["flight_moment_max_nm"] < 0.1
    (tmp_path / "hovers.bvh").write_text(bvh(np.full(100, 1.5), 3.0))
    assert check(read_clip(tmp_path / "hovers.bvh"))["flight_force_y_max_bw"] == pytest.approx(1.0, abs=1e-3)


def test_clips_that_cannot_be_compared_say_why(tmp_path: Path) -> None:
    from experiments.physics.captured import read_clip
    from experiments.physics.recording import UnfitError

    (tmp_path / "slow.bvh").write_text(bvh(np.full(100, 1.0), 1.0))
    (tmp_path / "bare.bvh").write_text(bvh(np.full(100, 1.0), 3.0).replace("RightHand", "RightHook"))
    (tmp_path / "broken.bvh").write_text("HIERARCHY")
    for name, reason in (("slow", "no run: 1.0 m/s"), ("bare", "no righthand"), ("broken", "cannot be read as BVH")):
        with pytest.raises(UnfitError, match=reason):
            read_clip(tmp_path / f"{name}.bvh")


def test_a_run_of_our_own_that_is_read_as_captured_is_near_the_laws_of_motion(tmp_path: Path) -> None:
    from experiments.physics.captured import read_clip
    from experiments.physics.check import check

    clip = full_body(own().repeated(4)).clip
    write_bvh(tmp_path / "own.bvh", replace(clip, skeleton=renamed(clip.skeleton, "mixamo")), "ZYX", 100.0)
    figures = check(read_clip(tmp_path / "own.bvh"))
    assert own().contact is not None
    flight = 1.0 - float(own().contact.any(dim=-1).double().mean())
    assert figures["flight_share"] == pytest.approx(flight, abs=0.05)
    assert figures["flight_force_rms_bw"] < 0.3
    assert 2.0 < figures["vertical_peak_bw"] < 4.0


@pytest.mark.parametrize("name", ["run_cmu_16_35", "run_turn_left90_cmu_16_42"])
def test_people_who_run_are_near_the_laws_of_motion(name: str) -> None:
    from experiments.physics.captured import read_clip
    from experiments.physics.check import check

    figures = check(read_clip(captured_file(name)))
    assert 0.1 < figures["flight_share"] < 0.5
    assert figures["flight_force_rms_bw"] < 0.5
    assert 2.0 < figures["vertical_peak_bw"] < 3.5
