from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest
import yaml
from PIL import Image

from hopdiff.cli import main

FILES = {"hopper.png", "metrics.json", "frames.csv", "config.yaml", "status.json", "versions.json", "git.json"}


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", *arguments, f"hydra.run.dir={folder}"])
    return main()


def metrics(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def frames(folder: Path) -> list[dict[str, str]]:
    with open(folder / "frames.csv") as file:
        return list(csv.DictReader(file))


def test_figure_3_4_repeats(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "+experiment=kang1999/fig_3_4") == 0
    assert {path.name for path in folder.iterdir()} == FILES
    numbers = metrics(folder)
    assert (numbers["speed"], numbers["leg_length"], numbers["step"], numbers["mass"]) == (10.0, 2.0, 0.005, 50.0)
    assert (numbers["stiffness"], numbers["touchdown_angle_deg"]) == (3000.0, 45.0)
    assert numbers["periodic"] is True
    assert numbers["fell"] is False
    assert numbers["contact_time"] == pytest.approx(0.28284, abs=1e-5)
    assert numbers["flight_time"] == pytest.approx(0.57552, abs=1e-5)
    assert numbers["touchdown_rate"] == pytest.approx(2.8229, abs=1e-4)
    assert numbers["contact_times"] == pytest.approx([0.2828] * 3, abs=0.005)
    assert numbers["flight_times"] == pytest.approx([0.5755] * 3, abs=0.005)
    assert numbers["peak_leg_force_bw"] == pytest.approx(3000.0 * numbers["max_leg_compression"] / (50.0 * 9.81))
    assert numbers["lowest_foot"] > -1e-6
    printed = capsys.readouterr().out
    assert "Repeats itself: contact 0.283 s, flight 0.576 s." in printed
    with Image.open(folder / "hopper.png") as picture:
        assert picture.width > 3 * picture.height
    settings = yaml.safe_load((folder / "config.yaml").read_text())
    assert settings["hopper"]["stiffness"] == 3000.0
    assert "+experiment=kang1999/fig_3_4" in json.loads((folder / "versions.json").read_text())["command"]


@pytest.mark.parametrize(("name", "hops", "legs"), [("3_5", 2, 1), ("3_7", 4, 2)])
def test_figures_3_5_and_3_7_grow(
    name: str,
    hops: int,
    legs: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"+experiment=kang1999/fig_{name}") == 0
    numbers = metrics(folder)
    assert (numbers["periodic"], numbers["fell"]) == (False, False)
    assert (numbers["hops_done"], numbers["touchdown_rate"], numbers["legs"]) == (hops, 0.0, legs)
    apexes = numbers["apex_heights"]
    assert apexes == sorted(apexes)
    assert apexes[-1] > 1.5 * apexes[0]
    assert numbers["contact_times"][0] == pytest.approx(numbers["contact_time"], abs=numbers["step"])
    assert numbers["lowest_foot"] > -0.005
    assert "Does not repeat itself" in capsys.readouterr().out


def test_frames_are_the_motion(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "+experiment=kang1999/fig_3_7", "hopper.hops=2") == 0
    rows = frames(folder)
    assert rows[0]["phase"] == "stance"
    assert {row["carrier"] for row in rows} == {"left", "right"}
    assert [float(row["time"]) for row in rows] == pytest.approx([0.01 * i for i in range(len(rows))])
    assert float(rows[-1]["hip_z"]) - float(rows[0]["hip_z"]) == pytest.approx(5.0 * float(rows[-1]["time"]))
    for row in rows:
        place = {name: float(value) for name, value in row.items() if name not in ("phase", "carrier")}
        for side in ("left", "right"):
            thigh = math.hypot(place[f"{side}_knee_z"] - place["hip_z"], place[f"{side}_knee_y"] - place["hip_y"])
            assert thigh == pytest.approx(0.75)
        if row["phase"] == "stance":
            assert place[f"{row['carrier']}_foot_y"] == pytest.approx(0.0, abs=1e-9)
    # Both flights are in the table, and their frames are the flight times of the metrics.
    flying = [sum(row["phase"] == "flight" and row["hop"] == str(k) for row in rows) * 0.01 for k in (0, 1)]
    assert flying == pytest.approx(metrics(folder)["flight_times"], abs=0.0101)


def test_a_fall_is_a_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "+experiment=kang1999/fig_3_5", "hopper.hops=5") == 0
    numbers = metrics(folder)
    assert (numbers["fell"], numbers["hops_done"]) == (True, 2)
    assert len(numbers["contact_times"]) == 2
    assert "Falls in hop 3" in capsys.readouterr().out
    assert (folder / "hopper.png").is_file()
    assert frames(folder)[-1]["hop"] == "2"


def test_another_start_finds_its_way_to_the_cycle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The touchdown rate that the thesis leaves out does not matter much for figure 3.4: its hop attracts others."""
    folder = tmp_path / "run"
    arguments = ("+experiment=kang1999/fig_3_4", "hopper.touchdown_rate=0", "hopper.hops=5")
    assert command(monkeypatch, folder, *arguments) == 0
    numbers = metrics(folder)
    assert numbers["periodic"] is False
    assert numbers["periodic_touchdown_rate"] == pytest.approx(2.8229, abs=1e-4)
    assert abs(numbers["flight_times"][0] - 0.5755) > 0.01
    assert numbers["flight_times"][-1] == pytest.approx(0.5755, abs=0.005)
    assert "the hop that repeats itself does at 2.823 m/s" in capsys.readouterr().out


def test_an_unstable_cycle_is_called_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, tmp_path / "run", "task=hopper", "speed=9", "hopper.hops=10") == 0
    assert metrics(tmp_path / "run")["periodic"] is True
    assert "unstable" in capsys.readouterr().out


def test_a_foot_below_the_ground_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ("+experiment=kang1999/fig_3_4", "hopper.flight_knee_deg=0")
    assert command(monkeypatch, tmp_path / "run", *arguments) == 0
    assert metrics(tmp_path / "run")["lowest_foot"] < -0.1
    assert "raise hopper.flight_knee_deg" in capsys.readouterr().out


def test_the_defaults_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for legs in (1, 2):
        folder = tmp_path / str(legs)
        assert (
            command(monkeypatch, folder, "task=hopper", f"hopper.legs={legs}", "hopper.hops=8", "pictures=false") == 0
        )
        numbers = metrics(folder)
        assert (numbers["periodic"], numbers["hops_done"], numbers["fell"]) == (True, 8, False)
        assert numbers["flight_times"] == pytest.approx([numbers["flight_time"]] * 8, abs=0.01)
        assert numbers["lowest_foot"] > -0.005


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("hopper.stiffness=-3000", "hopper.stiffness must be from 0.001 to 1e+09 N/m, not -3000."),
        ("hopper.hops=0", "hopper.hops must be from 1 to 100, not 0."),
        ("hopper.hops=1.5", "hopper.hops must be a whole number, not '1.5'."),
        ("hopper.mass=nan", "hopper.mass must be from 0.001 to 1e+06 kg, not nan."),
        ("hopper.leg_length=inf", "hopper.leg_length must be from 0.01 to 100 m, not inf."),
        ("hopper.legs=3", "hopper.legs must be 1 or 2, not 3."),
        ("hopper.touchdown_angle_deg=95", "hopper.touchdown_angle_deg must be from 1 to 85, not 95."),
        ("hopper.touchdown_rate=-1", "hopper.touchdown_rate must be from 0 to 100 m/s, not -1."),
        ("hopper.touchdown_rate=nan", "hopper.touchdown_rate must be from 0 to 100 m/s, not nan."),
        ("hopper.alpha=0.5", "hopper.alpha must be from 0.55 to 2, not 0.5."),
        ("hopper.step=0", "hopper.step must be from 1e-06 to 1 s, not 0."),
        ("hopper.step=0.1", "hopper.step must be at most 0.022 s for this leg, speed and spring, not 0.1."),
        ("hopper.stiffness=1e8", "hopper.step must be at most 0.00084 s for this leg, speed and spring, not 0.005."),
        ("hopper.active_knee_middle_deg=200", "hopper.active_knee_middle_deg must be from 0 to 170, not 200."),
        ("speed=nan", "speed must be a number above 0 [m/s], not nan."),
        ("hopper.leg=2", "Unknown setting 'hopper.leg'. Did you mean 'hopper.legs'?"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    override: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=hopper", override])
    assert main() == 1
    assert capsys.readouterr().err == f"hopdiff: {said}\n"
    assert not (tmp_path / "outputs").exists()


def test_too_many_frames_are_refused_before_a_folder_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hopdiff.tasks.hopper.MAX_FRAMES", 300)
    assert command(monkeypatch, tmp_path / "run", "+experiment=kang1999/fig_3_4") == 1
    assert "takes more than 300 frames" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
