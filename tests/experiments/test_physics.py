"""The checker of finished runs, on motions whose physics is known: it must see what is right and what is not."""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.experiments.physics_motions import (
    BRAKE,
    CONTACT,
    GRAVITY,
    PEAK,
    STEP,
    STEP_TIME,
    WEIGHT,
    WHEEL,
    Arrays,
    begun_later,
    run,
    scissors,
    shifted,
    tumbling,
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def checked(folder: Path, arrays: Arrays) -> dict[str, float]:
    from experiments.physics.check import check_file

    np.savez(folder / "motion.npz", **arrays)
    return check_file(folder / "motion.npz")


def missed(figures: dict[str, float]) -> set[str]:
    from experiments.physics.bars import BARS

    return {bar.column for bar in BARS if bar.asked(figures) and not bar.met(figures)}


@pytest.mark.parametrize("body", [tumbling, scissors])
def test_a_thrown_body_leaves_nothing_over(body: Callable[[], Arrays], tmp_path: Path) -> None:
    figures = checked(tmp_path, body())
    assert figures["flight_share"] == 1.0
    assert figures["flight_force_max_bw"] < 1e-6
    assert figures["flight_moment_max_nm"] < 1e-3
    assert figures["spin_drift_max"] < 1e-4
    assert not missed(figures)
    # Nothing of feet or ground is known of it.
    assert not {"vertical_min_bw", "slip_mm", "stance_force_max_bw", "kick"} & set(figures)


def test_the_angular_momentum_is_that_of_the_throw(tmp_path: Path) -> None:
    from experiments.physics.momentum import analyse
    from experiments.physics.recording import read_recording

    np.savez(tmp_path / "motion.npz", **scissors())
    spin = analyse(read_recording(tmp_path / "motion.npz")).spin[5:-5]
    np.testing.assert_allclose(spin, np.tile([8.0, 0.0, 0.0], (len(spin), 1)), atol=1e-5)


def test_a_body_that_falls_wrongly_is_reported(tmp_path: Path) -> None:
    figures = checked(tmp_path, tumbling(gravity=0.9 * GRAVITY))
    assert figures["flight_force_y_max_bw"] == pytest.approx(0.1, abs=1e-6)
    assert figures["flight_force_max_bw"] == pytest.approx(0.1, abs=1e-6)
    assert figures["flight_force_x_max_bw"] < 1e-6
    assert missed(figures) == {"flight_force_max_bw"}


@pytest.mark.parametrize("name", ["inertias", "masses", "centres"])
def test_a_body_that_tumbles_wrongly_is_reported(name: str, tmp_path: Path) -> None:
    arrays = tumbling()
    arrays[name] = arrays[name].copy()
    arrays[name][1] *= 1.2
    assert {"flight_moment_max_nm", "spin_drift_max"} <= missed(checked(tmp_path, arrays))


def test_a_spin_that_does_not_keep_its_rate_is_reported(tmp_path: Path) -> None:
    arrays = scissors()
    times = STEP * np.arange(400)
    extra = Rotation.from_rotvec(np.stack((0 * times, 0.5 * times**2, 0 * times), axis=-1))
    arrays["rotations"][:, 0] = extra.as_quat()
    figures = checked(tmp_path, arrays)
    assert figures["flight_moment_y_rms_nm"] > 0.5
    assert "spin_drift_max" in missed(figures)


def test_a_run_that_obeys_keeps_every_bar(tmp_path: Path) -> None:
    from experiments.physics.bars import BARS

    figures = checked(tmp_path, run())
    assert all(bar.asked(figures) for bar in BARS)
    assert not missed(figures)
    assert figures["flight_share"] == pytest.approx(1 - CONTACT / STEP_TIME, abs=0.005)
    assert figures["flight_force_max_bw"] < 1e-7
    assert figures["stance_force_max_bw"] < 1e-7
    assert figures["stance_moment_max_nm"] < 1e-4
    assert figures["vertical_peak_bw"] == pytest.approx(PEAK / WEIGHT, rel=1e-4)
    # The largest share of level force is where the vertical one is a tenth of the weight.
    edge = np.arcsin(0.1 * WEIGHT / PEAK)
    assert figures["friction"] == pytest.approx(2 * BRAKE / PEAK * np.cos(edge), rel=0.01)
    assert figures["friction"] <= 2 * BRAKE / PEAK * np.cos(edge)
    assert figures["slip_mm"] < 1e-3
    assert figures["seam_mm"] < 1e-9
    assert figures["swing_depth_mm"] == pytest.approx(-(WHEEL + 0.1 - 0.05) * 1e3)


def test_frames_that_miss_touchdown_change_nothing(tmp_path: Path) -> None:
    assert not missed(checked(tmp_path, run(frames=661)))


@pytest.mark.parametrize("frame", [3, 100, 260, 334, 670])
def test_it_does_not_matter_where_a_loop_is_cut(frame: int, tmp_path: Path) -> None:
    whole, cut = checked(tmp_path, run(skate=0.1)), checked(tmp_path, begun_later(run(skate=0.1), frame))
    assert missed(cut) == {"slip_mm"}
    assert cut.keys() == whole.keys()
    for name, value in whole.items():
        assert cut[name] == pytest.approx(value, rel=1e-4, abs=2e-4), name


@pytest.mark.parametrize(
    ("name", "change", "broken"),
    [
        ("force", lambda f: f * 1.02, {"stance_force_max_bw", "mean_vertical_off_bw"}),
        ("force", lambda f: f + [100.0, 0.0, 0.0] * (f[..., 1:2] > 0), {"stance_force_max_bw", "stance_moment_max_nm"}),
        ("force", lambda f: f - [0.0, 40.0, 0.0] * (f[..., 1:2] > 0), {"vertical_min_bw", "stance_force_max_bw"}),
        ("force", lambda f: np.where(f == 0.0, 30.0, f), {"air_force_bw"}),
        ("force", lambda f: f * np.nan, {"stance_force_max_bw", "vertical_min_bw", "kick"}),
        ("cop", lambda p: shifted(p, z=0.01), {"stance_moment_max_nm"}),
        ("cop", lambda p: shifted(p, x=0.01), {"stance_moment_max_nm"}),
        ("cop", lambda p: shifted(p, y=0.02), {"cop_height_mm", "stance_moment_max_nm"}),
        ("cop", lambda p: p * np.nan, {"stance_moment_max_nm", "cop_height_mm"}),
        ("heel", lambda h: shifted(h, z=0.25), {"cop_excess_mm"}),
        ("heel", lambda h: shifted(h, y=-0.3), {"stance_depth_mm"}),
        ("heel", lambda h: shifted(h, y=-0.4), {"swing_depth_mm"}),
        ("masses", lambda m: m * [1.0, 1.0, 1.2, 1.0], {"flight_moment_max_nm", "stance_force_max_bw"}),
    ],
)
def test_what_is_wrong_is_reported(
    name: str, change: Callable[[np.ndarray], np.ndarray], broken: set[str], tmp_path: Path
) -> None:
    arrays = run()
    arrays[name] = change(arrays[name])
    assert broken <= missed(checked(tmp_path, arrays))


def test_a_jerk_in_flight_and_one_in_stance_are_told_apart(tmp_path: Path) -> None:
    for moments, seen, other in (((0.27, 0.30), "flight", "stance"), ((0.08, 0.14), "stance", "flight")):
        arrays = run()
        times = STEP_TIME * 2 * np.linspace(0, 1, 673)
        share = np.clip((times - moments[0]) / (moments[1] - moments[0]), 0, 1)
        arrays["root_position"] = arrays["root_position"] + 1e-4 * np.sin(np.pi * share[:, None]) ** 4 * [1.0, 0.0, 0.0]
        figures = checked(tmp_path, arrays)
        assert figures[f"{seen}_force_x_max_bw"] > 1e-3
        assert figures[f"{other}_force_x_max_bw"] < 1e-6
        assert figures[f"{seen}_force_z_max_bw"] < 1e-6


def test_a_skating_foot_is_reported(tmp_path: Path) -> None:
    figures = checked(tmp_path, run(skate=0.1))
    assert figures["slip_mm"] == pytest.approx(100 * CONTACT, rel=0.01)
    assert figures["slip_speed_mm_s"] == pytest.approx(100.0, rel=1e-3)
    assert missed(figures) == {"slip_mm"}


def test_friction_that_no_shoe_gives_is_reported(tmp_path: Path) -> None:
    figures = checked(tmp_path, run(brake=0.9 * WEIGHT))
    assert figures["friction"] == pytest.approx(1.8 * WEIGHT / PEAK, rel=0.01)
    assert "friction" in missed(figures)
    assert figures["stance_force_max_bw"] < 1e-6


def test_a_blow_between_the_frames_that_are_looked_at_is_reported(tmp_path: Path) -> None:
    figures = checked(tmp_path, run(burst=0.05))
    assert figures["kick"] == pytest.approx(0.05, rel=0.01)
    assert missed(figures) == {"kick", "jump_mm"}
    figures = checked(tmp_path, run(yaw=0.5))
    # Of the pelvis, and of both arms where they are at take-off.
    sine = np.sin(0.6 * np.sin(np.pi * CONTACT / STEP_TIME)) ** 2
    arms = 2 * (0.01 * (1 - sine) + 0.05 * sine + 5 * 0.25**2 * sine)
    assert figures["spin_kick"] == pytest.approx(0.5 * (0.9 + arms), rel=0.02)
    assert "spin_kick" in missed(figures)


def test_without_forces_the_motion_is_asked_for_them(tmp_path: Path) -> None:
    arrays = {name: values for name, values in run().items() if name not in ("force", "cop")}
    arrays["feet"] = np.nan_to_num(run()["cop"])
    figures = checked(tmp_path, arrays)
    assert not missed(figures)
    assert figures["vertical_peak_bw"] == pytest.approx(PEAK / WEIGHT, rel=1e-4)
    assert 0.0 < figures["vertical_min_bw"] < 0.5
    assert figures["point_moment_max_nm"] < 1e-3
    assert "stance_force_max_bw" not in figures
    arrays["feet"] = shifted(arrays["feet"], z=0.01)
    assert checked(tmp_path, arrays)["point_moment_max_nm"] == pytest.approx(0.01 * PEAK, rel=0.01)


def test_a_loop_that_does_not_close_is_reported(tmp_path: Path) -> None:
    arrays = run()
    arrays["root_position"] = arrays["root_position"] + np.linspace(0, 1e-3, 673)[:, None] * [0.0, 1.0, 0.0]
    figures = checked(tmp_path, arrays)
    assert figures["seam_mm"] == pytest.approx(1.0)
    assert missed(figures) == {"seam_mm", "jump_mm"}


def test_a_file_without_a_body_says_so(tmp_path: Path) -> None:
    from experiments.physics.recording import UnfitError

    arrays = {name: values for name, values in run().items() if name not in ("centres", "inertias")}
    with pytest.raises(UnfitError, match="no centres, inertias"):
        checked(tmp_path, arrays)
    (tmp_path / "motion.npz").write_bytes(b"PK no archive")
    with pytest.raises(UnfitError, match="no NumPy archive"):
        from experiments.physics.check import check_file

        check_file(tmp_path / "motion.npz")


def test_the_study_judges_runs_that_are_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.physics.__main__ import main
    from experiments.report import read_table

    numbers = '{"model": "body", "speed": 3.5, "beta": 0.2, "seed": %d}'
    for seed, arrays in enumerate((run(), run(skate=0.1))):
        own = tmp_path / "runs" / f"seed_{seed}"
        own.mkdir(parents=True)
        np.savez(own / "motion.npz", **arrays, numbers=np.array(numbers % seed))
    np.savez(tmp_path / "runs" / "other.npz", names=np.array(["pelvis"]))
    out = tmp_path / "out"
    main(["--runs", str(tmp_path / "runs"), "--clips", str(tmp_path / "nowhere"), "--out", str(out)])
    text = (out / "results.md").read_text()
    assert "| standing foot slips at most 1 mm | **1 of 2** |" in text
    assert "| ground never pulls | 2 of 2 |" in text
    assert "- body 3.5 m/s, beta 0.2, seed 1: standing foot slips at most 1 mm: 22" in text
    assert "--runs" in text
    assert "other.npz has no parents" in text
    assert "There is no folder nowhere." in text
    assert [float(row["seed"]) for row in read_table(out / "runs.csv")] == [0.0, 1.0]
    assert (out / "momentum.png").stat().st_size > 20_000
    main(["--redraw", "--out", str(out)])
    assert (out / "results.md").read_text() == text
    assert text in capsys.readouterr().out


def test_the_study_goes_on_without_a_model_that_is_not_there(tmp_path: Path) -> None:
    from experiments.physics.__main__ import main

    small = "--models nobody --speeds 3 --betas .2 --seeds 0"
    main([*small.split(), "--made", str(tmp_path / "made"), "--out", str(tmp_path)])
    text = (tmp_path / "results.md").read_text()
    assert "# Physics: 0 runs" in text
    assert "- nobody 3 m/s, beta 0.2, seed 0:" in text


def test_runs_are_made_with_all_their_frames(tmp_path: Path) -> None:
    from experiments.physics.making import made_with, make

    path = make("smooth", 3.5, 0.2, 0, tmp_path, {"evaluations": 200, "search": "random"})
    with np.load(path) as file:
        assert 1.0 / float(file["frame_time"]) == pytest.approx(960, rel=0.01)
        assert len(file["names"]) == 11
    said = made_with("smooth", {"evaluations": 200})
    assert "200 evaluations" in said
    assert "costs default" in said
    assert "ordinary 0.4" in said


def test_the_checking_shares_no_code_with_what_it_checks() -> None:
    folder = ROOT / "experiments" / "physics"
    for name in ("recording", "frames", "momentum", "feet", "check", "bvh", "captured", "bars"):
        for node in ast.walk(ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import | ast.ImportFrom):
                found = [node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
                assert not [one for one in found if str(one).startswith("hopdiff")], name
