from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest
import yaml
from PIL import Image

from hopdiff.character import REQUIRED_PARENTS
from hopdiff.cli import main
from hopdiff.numerics import GRAVITY
from tests.builders import make_character

FILES = {"body.png", "body.csv", "metrics.json", "config.yaml", "status.json", "versions.json", "git.json"}


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=body", *arguments, f"hydra.run.dir={folder}"])
    return main()


def metrics(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def rows(folder: Path) -> dict[str, dict[str, str]]:
    with open(folder / "body.csv") as file:
        return {row["joint"]: row for row in csv.DictReader(file)}


def column(folder: Path, name: str) -> dict[str, float]:
    return {joint: float(row[name]) for joint, row in rows(folder).items()}


def test_the_human_is_drawn_listed_and_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder) == 0
    assert {path.name for path in folder.iterdir()} == FILES
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == (
        "human: 1.750 m, 70.0 kg, legs 0.929 m, arms 0.640 m, trunk 0.559 m; Froude number 1 at 3.02 m/s"
    )
    assert [line.split()[0] for line in printed[2:-1]] == list(rows(folder))
    assert set(rows(folder)) == set(REQUIRED_PARENTS)
    assert printed[-1] == f"files          {folder}"
    with Image.open(folder / "body.png") as picture:
        shades = picture.convert("L").histogram()
        assert min(picture.size) > 300
    # A body on white: both dark and light cover a good part of it.
    assert min(sum(shades[:100]), sum(shades[250:])) > 0.05 * sum(shades)
    settings = yaml.safe_load((folder / "config.yaml").read_text())
    assert (settings["task"]["name"], settings["character"]["name"]) == ("body", "human")
    assert "task=body" in json.loads((folder / "versions.json").read_text())["command"]


@pytest.mark.few(3)
@pytest.mark.parametrize("name", ["human", "child", "cartoon"])
def test_the_measures_are_those_of_the_character(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, f"character={name}", "pictures=false") == 0
    assert {path.name for path in folder.iterdir()} == FILES - {"body.png"}
    numbers, body = metrics(folder), make_character(name)
    assert numbers["character"] == name
    for measure in ("height", "mass", "leg_length", "thigh", "shank"):
        assert numbers[measure] == pytest.approx(getattr(body, measure), rel=1e-12)
    shoulders, hips = (body.skeleton.offsets[body.skeleton.index(f"left_{joint}")] for joint in ("shoulder", "hip"))
    assert numbers["shoulder_width"] == pytest.approx(2.0 * float(shoulders[0]))
    assert numbers["hip_width"] == pytest.approx(2.0 * float(hips[0]))
    assert numbers["froude_speed"] ** 2 / (GRAVITY * numbers["leg_length"]) == pytest.approx(1.0)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "arguments",
    [(), ("character=child",), ("character.proportions.legs=1.2", "character.proportions.arms=0.8")],
    ids=" ".join,
)
def test_the_parts_add_up_to_the_body(
    arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "pictures=false", *arguments) == 0
    numbers, long, heavy = metrics(folder), column(folder, "length"), column(folder, "mass")
    assert sum(heavy.values()) == pytest.approx(numbers["mass"], rel=1e-12)
    assert long["left_hip"] == pytest.approx(numbers["thigh"])
    assert long["left_knee"] == pytest.approx(numbers["shank"])
    assert long["left_hip"] + long["left_knee"] == pytest.approx(numbers["leg_length"])
    assert long["left_shoulder"] + long["left_elbow"] == pytest.approx(numbers["arm_length"])
    assert long["pelvis"] + long["waist"] == pytest.approx(numbers["trunk_length"])
    # These bodies have their hip joints at the height of the pelvis.
    assert numbers["leg_length"] + numbers["trunk_length"] + long["neck"] == pytest.approx(numbers["height"])


def test_the_table_tells_where_mass_lies_and_how_it_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "pictures=false") == 0
    body = make_character()
    for i, (joint, row) in enumerate(rows(folder).items()):
        assert row["parent"] == (REQUIRED_PARENTS[joint] or "")
        assert joint == body.skeleton.names[i]
        assert float(row["mass"]) == pytest.approx(float(body.masses[i]), rel=1e-12)
        assert [float(row[f"com_{axis}"]) for axis in "xyz"] == pytest.approx(body.coms[i].tolist(), abs=1e-12)
        assert [float(row[f"inertia_{axis}"]) for axis in "xyz"] == pytest.approx(body.inertias[i].tolist())


def test_longer_legs_show_in_the_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain, changed = tmp_path / "plain", tmp_path / "changed"
    assert command(monkeypatch, plain, "pictures=false") == 0
    assert command(monkeypatch, changed, "pictures=false", "character.proportions.legs=1.2") == 0
    before, after = metrics(plain), metrics(changed)
    longer = {name for name in before if after[name] != before[name]}
    assert longer == {"height", "leg_length", "thigh", "shank", "froude_speed"}
    for name in ("leg_length", "thigh", "shank"):
        assert after[name] == pytest.approx(1.2 * before[name])
    assert after["height"] - before["height"] == pytest.approx(0.2 * before["leg_length"])
    assert after["froude_speed"] == pytest.approx(math.sqrt(1.2) * before["froude_speed"])
    share = {
        folder: column(folder, "mass")["left_knee"] / column(folder, "mass")["neck"] for folder in (plain, changed)
    }
    assert share[changed] == pytest.approx(1.2 * share[plain])


def test_height_and_mass_can_be_typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "run"
    assert command(monkeypatch, folder, "pictures=false", "character.height=2", "character.mass=90") == 0
    numbers, body = metrics(folder), make_character()
    assert (numbers["height"], numbers["mass"]) == (pytest.approx(2.0), 90.0)
    assert numbers["leg_length"] == pytest.approx(body.leg_length * 2.0 / body.height)
    assert column(folder, "mass")["neck"] == pytest.approx(float(body.masses[2]) * 90.0 / body.mass)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("character=dwarf", "Unknown character 'dwarf': choose one of cartoon, child, human."),
        ("character.mass=0", "character 'human': mass must be a positive number of kilograms, not 0.0."),
        ("character.height=nan", "character 'human': height must be a positive number of metres, not nan."),
        ("character.proportions.legs=3", "character.proportions.legs must lie between 0.5 and 2, not 3."),
        (
            "character.proportion.legs=1",
            "Unknown setting 'character.proportion'. Did you mean 'character.proportions'?",
        ),
        ("~character.joints.neck", "character 'human': the joint 'neck' is missing."),
        ("pictures=maybe", "pictures must be true or false, not 'maybe'."),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    override: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=body", override])
    assert main() == 1
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith(f"hopdiff: {said}")
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_the_folder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    assert command(monkeypatch, tmp_path / "file" / "run") == 1
    assert "The run folder (hydra.run.dir) cannot be written" in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == "mine"


@pytest.mark.few(2)
@pytest.mark.parametrize("trunk", [0.5, 1.0, 2.0])
def test_the_parts_of_the_trunk_add_up_whatever_its_length(
    trunk: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(monkeypatch, tmp_path, f"character.proportions.trunk={trunk}", "pictures=false") == 0
    lengths = column(tmp_path, "length")
    assert lengths["pelvis"] + lengths["waist"] == pytest.approx(metrics(tmp_path)["trunk_length"])
