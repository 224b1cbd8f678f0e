"""The study of realism: its measures on motions that are written here and whose angles are known."""

from __future__ import annotations

import ast
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
STUDY = ROOT / "experiments" / "realism"
SPEED, STRIDE, CONTACT, MASS = 3.5, 0.7, 0.24, 70.0
FRAMES = 169  # 240 frames/s
Array = NDArray[np.float64]
Angle = Callable[[Array], Array]  # of the phase of the stride, 0 to 1, in deg

# Joint: parent, offset [m].
JOINTS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "pelvis": ("", (0.0, 0.0, 0.0)),
    "chest": ("pelvis", (0.0, 0.3, 0.0)),
    "neck": ("chest", (0.0, 0.2, 0.0)),
    "head": ("neck", (0.0, 0.1, 0.0)),
    **{
        f"{side}_{joint}": (f"{side}_{parent}" if parent not in ("pelvis", "chest") else parent, (sign * x, y, z))
        for side, sign in (("left", 1.0), ("right", -1.0))
        for joint, parent, x, y, z in (
            ("shoulder", "chest", 0.2, 0.15, 0.0),
            ("elbow", "shoulder", 0.0, -0.3, 0.0),
            ("wrist", "elbow", 0.0, -0.25, 0.0),
            ("hip", "pelvis", 0.09, 0.0, 0.0),
            ("knee", "hip", 0.0, -0.43, 0.0),
            ("ankle", "knee", 0.0, -0.43, 0.0),
            ("toe", "ankle", 0.0, -0.05, 0.14),
        )
    },
}


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def thigh(phase: Array) -> Array:
    return 5.0 + 30.0 * np.cos(2 * np.pi * (phase - 0.85))


def knee(phase: Array) -> Array:
    return 50.0 - 35.0 * np.cos(2 * np.pi * phase) - 10.0 * np.cos(4 * np.pi * phase)


def foot(phase: Array) -> Array:
    return -40.0 + 55.0 * np.cos(2 * np.pi * (phase - 0.05))


def arm(phase: Array) -> Array:
    """Opposite to the thigh of its side."""
    return -15.0 - 20.0 * np.cos(2 * np.pi * (phase - 0.85))


def still(phase: Array) -> Array:
    return 0.0 * phase


def write_motion(
    path: Path,
    *,
    arm: Angle = arm,
    pelvis_yaw: Angle = still,
    pelvis_roll: Angle = still,
    thorax_yaw: Angle = still,
    bounce: float = 0.08,
    force: float = 1.0,
    **numbers: Any,
) -> Path:
    """A stride whose right side does half a stride later what the left one does; one mass, at the pelvis, goes up and
    down as a cosine, and is held by the force that this takes (times `force`), shared by whichever foot is next."""
    phase = np.linspace(0.0, 1.0, FRAMES)
    turns = {joint: np.zeros((FRAMES, 3)) for joint in JOINTS}
    # A positive turn about x takes what hangs backwards; about y the left side back; about z the left side up.
    turns["pelvis"][:, 1], turns["pelvis"][:, 2] = -pelvis_yaw(phase), pelvis_roll(phase)
    turns["chest"][:, 1] = pelvis_yaw(phase) - thorax_yaw(phase)
    for side, late in (("left", 0.0), ("right", 0.5)):
        moment = phase + late
        turns[f"{side}_hip"][:, 0] = -thigh(moment)
        turns[f"{side}_knee"][:, 0] = knee(moment)
        turns[f"{side}_ankle"][:, 0] = thigh(moment) - knee(moment) - foot(moment)
        turns[f"{side}_shoulder"][:, 0] = -arm(moment)
        turns[f"{side}_elbow"][:, 0] = -90.0
    half = np.radians(np.stack([turns[joint] for joint in JOINTS], axis=1)) / 2
    # Only one axis turns at a time in these motions.
    rotations = np.concatenate((np.sin(half), np.cos(half).prod(axis=-1, keepdims=True)), axis=-1)
    time = phase * STRIDE
    rate = 4 * np.pi / STRIDE
    root = np.stack((still(phase), 1.0 - bounce / 2 * np.cos(rate * time), SPEED * time), axis=-1)
    upward = force * MASS * (9.81 + bounce / 2 * rate**2 * np.cos(rate * time))
    forces = np.zeros((FRAMES, 2, 3))
    forces[phase < 0.5, 0, 1], forces[phase >= 0.5, 1, 1] = upward[phase < 0.5], upward[phase >= 0.5]
    contact = np.stack(((phase % 1.0) * STRIDE < CONTACT, ((phase + 0.5) % 1.0) * STRIDE < CONTACT), axis=-1)
    names = list(JOINTS)
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        path,
        names=np.array(names),
        parents=np.array([names.index(parent) if parent else -1 for parent, _ in JOINTS.values()]),
        offsets=np.array([offset for _, offset in JOINTS.values()]),
        frame_time=np.array(STRIDE / (FRAMES - 1)),
        root_position=root,
        rotations=rotations,
        contact=contact,
        force=forces,
        segments=np.array(["pelvis"]),
        masses=np.array([MASS]),
        centres=np.zeros((1, 3)),
        numbers=np.array(json.dumps({"speed": SPEED, "beta": 0.2, "seed": 0, "model": "body"} | numbers)),
    )
    return path


def test_legs_come_back_as_they_were_written(tmp_path: Path) -> None:
    from experiments.realism.measure import SAMPLES, measured

    stride = measured(write_motion(tmp_path / "motion.npz"))
    phase = np.arange(SAMPLES) / SAMPLES
    ankle = foot(phase) - thigh(phase) + knee(phase)
    for name, known in (("thigh", thigh(phase)), ("knee", knee(phase)), ("foot", foot(phase)), ("ankle", ankle)):
        assert stride.curves[name] == pytest.approx(known, abs=0.05), name
    row = stride.row
    assert row["knee_touchdown"] == pytest.approx(5.0)
    end = CONTACT / STRIDE
    assert row["knee_take_off"] == pytest.approx(knee(np.array(end)), abs=1.5)  # of 1 deg a frame
    assert row["knee_swing"] == pytest.approx(knee(np.linspace(end, 1, 999)).max(), abs=0.01)
    assert row["foot_touchdown"] == pytest.approx(foot(np.array(0.0)), abs=0.01)
    assert row["speed"] == pytest.approx(SPEED)
    assert row["steps_per_second"] == pytest.approx(2 / STRIDE)
    assert row["contact_time"] == pytest.approx(CONTACT, abs=0.004)
    assert row["contact_time"] + row["flight_time"] == pytest.approx(STRIDE / 2)
    assert row["step_width"] == pytest.approx(0.18)
    assert row["elbow_mean"] == pytest.approx(90.0)
    assert row["lean"] == pytest.approx(0.0, abs=1e-6)


def test_a_contact_ends_where_its_force_does() -> None:
    from experiments.realism.strides import edge

    force = np.zeros((6, 2))
    force[:, 0] = [0.0, 1.0, 3.0, 5.0, 2.0, 0.0]
    assert edge(force, 0, 4, 1) == pytest.approx(4 + 2 / 3)
    assert edge(force, 0, 1, -1) == pytest.approx(0.5)
    assert edge(None, 0, 4, 1) == 4.5
    force[4, 0] = 9.0  # it was still growing
    assert edge(force, 0, 4, 1) == 5.0


def test_forces_are_held_against_the_motion_of_the_segments(tmp_path: Path) -> None:
    from experiments.realism.measure import measured

    row = measured(write_motion(tmp_path / "motion.npz")).row
    assert row["bounce"] == pytest.approx(0.08)
    assert row["force_gap"] == pytest.approx(0.0, abs=2e-3)
    peak = 1 + 0.04 * (4 * math.pi / STRIDE) ** 2 / 9.81
    assert row["peak_force"] == pytest.approx(peak)
    # Up twice a stride, at a steady speed.
    rate = 0.04 * 4 * math.pi / STRIDE
    sines = np.linspace(0, 4 * np.pi, 9999)
    energy = 9.81 * -0.04 * np.cos(sines) + (rate * np.sin(sines)) ** 2 / 2
    work = np.diff(energy).clip(min=0).sum() / (9.81 * SPEED * STRIDE)
    assert row["external_work"] == pytest.approx(work, rel=5e-3)
    wrong = measured(write_motion(tmp_path / "wrong.npz", force=1.1)).row
    assert wrong["force_gap"] > 0.1


def test_trunk_and_pelvis_have_signs(tmp_path: Path) -> None:
    from experiments.realism.bars import BARS
    from experiments.realism.measure import measured

    def turned(phase: Array) -> Array:
        return -6.0 * np.cos(2 * np.pi * phase)  # left side back when the left foot lands

    def hanging(phase: Array) -> Array:
        return 4.0 * np.cos(2 * np.pi * (phase - CONTACT / STRIDE / 2))  # left side high while it stands

    yaw = measured(write_motion(tmp_path / "yaw.npz", pelvis_yaw=turned, thorax_yaw=lambda p: -2 * turned(p))).row
    assert yaw["pelvis_yaw_range"] == pytest.approx(12.0, abs=0.01)
    assert yaw["pelvis_yaw_touchdown"] == pytest.approx(-6.0, abs=0.01)
    assert yaw["thorax_yaw_range"] == pytest.approx(24.0, abs=0.01)
    assert yaw["yaw_together"] == pytest.approx(-1.0)
    roll = measured(write_motion(tmp_path / "roll.npz", pelvis_roll=hanging)).row
    assert roll["pelvis_drop_range"] == pytest.approx(8.0, abs=0.01)
    assert 2.0 < roll["pelvis_drop"] < 4.0
    bars = {bar.column: bar for bar in BARS}
    assert bars["pelvis_yaw_touchdown"].met(yaw, SPEED)
    assert bars["pelvis_drop"].met(roll, SPEED)
    opposite = measured(write_motion(tmp_path / "walk.npz", pelvis_yaw=lambda phase: -turned(phase))).row
    assert opposite["pelvis_yaw_touchdown"] == pytest.approx(6.0, abs=0.01)
    assert not bars["pelvis_yaw_touchdown"].met(opposite, SPEED)
    hanging_other = measured(write_motion(tmp_path / "other.npz", pelvis_roll=lambda phase: -hanging(phase))).row
    assert not bars["pelvis_drop"].met(hanging_other, SPEED)


def test_arms_go_with_the_other_leg(tmp_path: Path) -> None:
    from experiments.realism.bars import BARS
    from experiments.realism.measure import measured

    bars = [bar for bar in BARS if bar.column in ("arm_same_leg", "arm_other_leg")]
    row = measured(write_motion(tmp_path / "arms.npz")).row
    assert row["arm_swing"] == pytest.approx(40.0, abs=0.01)
    assert row["arm_same_leg"] == pytest.approx(-1.0)
    assert row["arm_other_leg"] == pytest.approx(1.0)
    assert all(bar.met(row, SPEED) for bar in bars)
    mirrored = measured(write_motion(tmp_path / "mirrored.npz", arm=lambda phase: arm(phase + 0.5))).row
    assert mirrored["arm_swing"] == pytest.approx(40.0, abs=0.01)
    assert not any(bar.met(mirrored, SPEED) for bar in bars)


def test_files_that_are_no_stride_are_refused(tmp_path: Path) -> None:
    from experiments.realism.measure import measured

    path = write_motion(tmp_path / "motion.npz")
    with np.load(path) as file:
        data = dict(file)
    np.savez(path, **(data | {"contact": data["contact"][:, ::-1]}))
    with pytest.raises(ValueError, match="does not begin at a touchdown of the left foot"):
        measured(path)
    np.savez(path, **(data | {"names": np.array([str(name).replace("toe", "tip") for name in data["names"]])}))
    with pytest.raises(ValueError, match="has no joint left_toe"):
        measured(path)


def test_bvh_files_are_put_into_the_world(tmp_path: Path) -> None:
    from experiments.realism.recording import read

    path = tmp_path / "clip.bvh"
    path.write_text(
        "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\n"
        "CHANNELS 6 XPOSITION Yposition Zposition Zrotation Yrotation Xrotation\n"
        "JOINT LeftUpLeg\n{\nOFFSET 10 0 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n"
        "JOINT LeftLeg\n{\nOFFSET 0 -43 0\nCHANNELS 3 Zrotation Yrotation Xrotation\n"
        "JOINT LeftFoot\n{\nOFFSET 0 -43 0\nCHANNELS 3 Zrotation Yrotation Xrotation\nEnd Site\n{\nOFFSET 0 0 15\n}\n"
        "}\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.01\n"
        "0 100 0 0 0 0 0 0 0 0 0 0 0 0 0\n0 100 3 0 90 0 0 0 -90 0 0 30 0 0 0\n"
    )
    clip = read(path)
    assert clip.names == ("pelvis", "left_hip", "left_knee", "left_ankle")
    assert not clip.level_feet
    assert clip.point("left_ankle")[0] == pytest.approx((0.1, 0.14, 0.0))
    # The hips turn to the left, so that the left hip is behind them and "ahead" is +x, where the thigh is raised to.
    assert clip.point("left_hip")[1] == pytest.approx((0.0, 1.0, -0.07))
    assert clip.point("left_knee")[1] == pytest.approx((0.43, 1.0, -0.07))
    bent = (0.43 + 0.43 * math.cos(math.radians(30)), 1.0 - 0.43 * math.sin(math.radians(30)), -0.07)
    assert clip.point("left_ankle")[1] == pytest.approx(bent)


def test_a_curve_of_people_is_itself_and_may_be_a_little_late() -> None:
    from experiments.realism.measure import CURVES
    from experiments.realism.people import SPEEDS, curve, fit

    for speed in SPEEDS:
        for name in CURVES:
            people = curve(name, speed)
            assert fit(people, people) == pytest.approx((0.0, 1.0, 0.0))
            assert fit(np.roll(people, 3) + 7.0, people) == pytest.approx((0.0, 1.0, 0.06), abs=1e-9)
            assert fit(np.roll(people, -2), people) == pytest.approx((0.0, 1.0, -0.04), abs=1e-9)
            error, r, late = fit(np.roll(people, 6), people)
            assert error > 1.0
            assert r < 0.999
            assert abs(late) <= 0.06
    finer = np.interp(np.arange(200) / 4, np.arange(51), np.append(people, people[0]))
    assert fit(np.roll(finer, 5), people) == pytest.approx((0.0, 1.0, 0.025), abs=1e-9)


def test_people_are_as_published() -> None:
    from experiments.realism.people import curve, number

    for speed, at_landing, stance, swing in (
        (2.5, 9.4, 42.0, 89.8),
        (3.5, 10.3, 42.9, 105.2),
        (4.5, 11.8, 43.4, 116.8),
    ):
        flexion = curve("knee", speed)
        assert flexion[0] == pytest.approx(at_landing, abs=0.1)
        assert flexion[:15].max() == pytest.approx(stance, abs=0.3)
        assert flexion.max() == pytest.approx(swing, abs=0.3)
        assert number("contact_time", speed) + number("flight_time", speed) == pytest.approx(
            1 / number("steps_per_second", speed), abs=2e-3
        )
    assert curve("knee", 3.0) == pytest.approx((curve("knee", 2.5) + curve("knee", 3.5)) / 2)
    assert curve("knee", 9.0) == pytest.approx(curve("knee", 4.5))


def test_bars_fail_when_they_should() -> None:
    from experiments.realism.bars import BARS
    from experiments.realism.people import number

    people = {
        bar.column: number(bar.column, 3.5)
        for bar in BARS
        if bar.column in ("contact_time", "flight_time", "steps_per_second", "bounce", "peak_force")
        or bar.column.startswith("knee_")
    }
    good = people | {f"rmse_{name}": 3.0 for name in ("thigh", "knee", "ankle", "foot")}
    good |= {f"r_{name}": 0.98 for name in ("thigh", "knee", "ankle", "foot")}
    good |= {"pelvis_yaw_range": 12.0, "pelvis_yaw_touchdown": -3.0, "pelvis_drop_range": 9.0, "pelvis_drop": 3.0}
    good |= {"arm_other_leg": 0.9, "arm_same_leg": -0.9}
    assert all(bar.met(good, 3.5) for bar in BARS)
    bad = {
        "contact_time": 0.237 * 1.11,
        "flight_time": 0.115 * 0.89,
        "steps_per_second": 2.84 * 1.11,
        "bounce": 0.0785 * 1.21,
        "peak_force": 2.35 * 0.89,
        "knee_touchdown": 18.5,
        "knee_stance": 37.5,
        "knee_take_off": 22.5,
        "knee_swing": 90.0,
        "pelvis_yaw_range": 4.5,
        "pelvis_yaw_touchdown": 0.5,
        "pelvis_drop_range": 15.5,
        "pelvis_drop": -0.5,
        "arm_other_leg": 0.4,
        "arm_same_leg": -0.4,
        **{f"rmse_{name}": most + 0.1 for name, most in (("thigh", 6), ("knee", 6), ("ankle", 8), ("foot", 8))},
        **{f"r_{name}": 0.949 for name in ("thigh", "knee", "ankle", "foot")},
    }
    assert set(bad) == {bar.column for bar in BARS}
    for bar in BARS:
        assert bar.met(good | {bar.column: bad[bar.column]}, 3.5) is False, bar.text
        assert bar.met(good | {bar.column: math.nan}, 3.5) is None


def test_briskness_is_judged_step_by_step() -> None:
    from experiments.realism.bars import steps

    calm = {
        "asked_speed": 3.5,
        "beta": 0.2,
        "bounce": 0.08,
        "flight_share": 0.3,
        "contact_time": 0.24,
        "arm_swing": 40.0,
    }
    brisk = calm | {"beta": 0.5, "bounce": 0.1, "flight_share": 0.3, "contact_time": 0.242, "arm_swing": 30.0}
    rows = [brisk, calm, calm | {"seed": 1}, brisk | {"asked_speed": 6.0}]
    assert steps(rows, "bounce") == [(3.5, 0.2, 0.5, True)]
    assert [steps(rows, name)[0][-1] for name in ("flight_share", "contact_time", "arm_swing")] == [False, True, False]
    longer = [calm, brisk | {"contact_time": 0.243}]
    assert steps(longer, "contact_time")[0][-1] is False


def test_measuring_shares_no_code_with_the_models() -> None:
    for name in ("recording", "angles", "strides", "measure", "people", "bars"):
        tree = ast.parse((STUDY / f"{name}.py").read_text(encoding="utf-8"))
        modules = [node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        modules += [alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names]
        assert not [module for module in modules if str(module).startswith(("hopdiff", "torch"))], name


def test_folders_of_runs_become_tables_and_pictures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.realism.__main__ import main

    for costs in ("human", "effort"):
        for beta, bounce in ((0.2, 0.08), (0.7, 0.1)):
            write_motion(
                tmp_path / "runs" / costs / f"{beta}" / "motion.npz", beta=beta, bounce=bounce, energy_rate=beta
            )
    write_motion(tmp_path / "runs" / "human" / "0.2" / "joints.npz", beta=0.9)  # the same run again
    (tmp_path / "runs" / "broken").mkdir()
    np.savez(tmp_path / "runs" / "broken" / "motion.npz", names=np.array(["pelvis"]))
    out = tmp_path / "out"
    main(["--runs", str(tmp_path / "runs"), "--clips", str(tmp_path), "--out", str(out)])
    text = (out / "results.md").read_text()
    assert text.strip() == capsys.readouterr().out.strip()
    assert str(tmp_path) not in text
    assert "`python -m experiments.realism --runs FOLDER --clips FOLDER --out FOLDER`" in text
    assert "- commit " in text
    for costs in ("human", "effort"):
        assert f"## Against people: costs={costs}" in text
        assert f"## Briskness: costs={costs}" in text
    assert text.count("| bounce grows | 1 of 1 | 100 % | yes |") == 2
    assert text.count("| flight share grows | 0 of 1 | 0 % | **no** |") == 2
    assert text.count("| arms with the other leg, r | 1.00 (≥ 0.50) yes |") == 2
    assert not [line for line in text.splitlines() if line.startswith("| 3.5 | 0.9 |")]
    assert "run_cmu_16_35 is left out: the folder of clips has no such file." in text
    assert "- broken/motion.npz: " in text
    for picture in ("curves.png", "briskness.png"):
        assert (out / picture).stat().st_size > 10_000
    first_lines = (out / "runs.csv").read_text().splitlines()[:2]
    assert [line[:9] for line in first_lines] == ["# commit ", "# `python"]
    (out / "results.md").unlink()
    main(["--redraw", "--out", str(out)])
    assert (out / "results.md").read_text() == text


def test_runs_are_searched_for_kept_and_measured(tmp_path: Path) -> None:
    from experiments.realism.__main__ import main

    arguments = "--model smooth --costs default --speeds 3.5 --betas .2 --seeds 0 --evaluations 300"
    main([*arguments.split(), "--keep", str(tmp_path / "kept"), "--out", str(tmp_path)])
    assert (tmp_path / "kept" / "default" / "3.5_0.2_0").is_dir()
    text = (tmp_path / "results.md").read_text()
    assert "## Against people: costs=default model=smooth" in text
    assert "| speed m/s | 3.50 |" in text
    assert "gamma: smooth" in text
