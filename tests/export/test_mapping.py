"""What is said of the parts that were found on a user's skeleton."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from hopdiff.cli import main
from hopdiff.export.anatomy import SCHEMES
from hopdiff.export.mapping import NAMES_FILE, MappingReport, few, grouped
from hopdiff.export.retarget import read_target, retargeted
from hopdiff.io.bvh import write_bvh
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS
from tests.export.rigs import skeleton, write_rest
from tests.export.takes import own
from tests.people import clip_of

ARMS = [f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow", "wrist")]
COLLARS = ["left_collar", "right_collar"]


def hero(folder: Path) -> Path:
    """A body whose arms have names that say nothing, and no shape of arms: they hang from the neck."""
    body = skeleton("mixamo")
    odd = {SCHEMES["mixamo"][part]: f"x{k}" for k, part in enumerate([*ARMS, *COLLARS])}
    names = tuple(odd.get(name, name) for name in body.names)
    ends = {odd.get(name, name): end for name, end in body.end_sites.items()}
    return write_rest(folder / "hero.bvh", replace(body, names=names, end_sites=ends))


def names_without_arms(folder: Path) -> Path:
    lines = [f"{part}: {joint}" for part, joint in SCHEMES["mixamo"].items() if part not in (*ARMS, *COLLARS)]
    path = folder / "names.yaml"
    path.write_text("\n".join(lines))
    return path


def test_all_parts_of_a_known_skeleton_are_found(tmp_path: Path) -> None:
    report = read_target(write_rest(tmp_path / "body.bvh", skeleton())).report()
    assert report.sentence() == "body.bvh: 22 of 22 parts found"
    assert report.warning() is None
    assert report.numbers()["missing"] == []


def test_what_is_missing_is_told_with_the_names_that_there_are(tmp_path: Path) -> None:
    report = read_target(hero(tmp_path), str(names_without_arms(tmp_path))).report()
    assert report.sentence() == (
        "hero.bvh: 14 of 22 parts found; not arms, collarbones; other joints: x6, x0, x1, x2, x7, x3, x4, x5"
    )
    warning = report.warning()
    assert warning is not None
    assert "arms not found" in warning
    assert NAMES_FILE in warning
    numbers = report.numbers()
    assert (numbers["found"], numbers["of"]) == (14, 22)
    assert set(numbers["missing"]) == {*ARMS, *COLLARS}
    assert set(numbers["other_joints"]) == {f"x{k}" for k in range(8)}


def test_the_file_of_names_is_read_again_blank_or_filled_in(tmp_path: Path) -> None:
    path = hero(tmp_path)
    report = read_target(path, str(names_without_arms(tmp_path))).report()
    blank = tmp_path / NAMES_FILE
    blank.write_text(report.names_file())
    assert set(yaml.safe_load(blank.read_text())) == set(JOINTS)
    assert read_target(path, str(blank)).report().joints == report.joints
    lines = report.names_file().splitlines()
    for k, part in enumerate([*ARMS, *COLLARS]):
        lines[lines.index(f"{part}:")] = f"{part}: x{k}"
    blank.write_text("\n".join(lines))
    whole = read_target(path, str(blank))
    assert whole.report().count == "22 of 22"
    assert retargeted(own(), whole).numbers["parts"] == "22 of 22"


@pytest.mark.parametrize("odd", ["a: b", "# x", "'", '"', "Ärmel", "null", "1", "右足", "a\\b"])
def test_joints_of_any_name_can_stand_in_the_file(odd: str) -> None:
    report = MappingReport("hero", {"pelvis": odd}, [odd + odd, "y"])
    assert yaml.safe_load(report.names_file())["pelvis"] == odd


def test_parts_are_told_in_groups() -> None:
    assert grouped(["left_shoulder", "left_elbow"]) == ["left arm"]
    assert grouped(["left_wrist"]) == ["left wrist"]
    assert grouped([*ARMS, "neck"]) == ["arms", "neck"]
    assert grouped(["waist", "chest"]) == ["waist", "chest"]
    assert grouped([]) == []
    assert few([str(k) for k in range(11)]) == "0, 1, 2, 3, 4, 5, 6, 7 and 3 more"


def test_a_body_without_legs_is_refused_with_the_names_of_its_joints(tmp_path: Path) -> None:
    body = skeleton()
    odd = replace(body, names=tuple(f"x{k}" for k in range(len(body.names))), end_sites={})
    flat = replace(odd, offsets=0.0 * odd.offsets)
    with pytest.raises(HopdiffError, match=r"lacks a pair of legs.*x0, x1, x2, x3, x4, x5, x6, x7 and 14 more"):
        read_target(write_rest(tmp_path / "flat.bvh", flat))


def test_the_command_tells_it_and_writes_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def hopdiff(*words: str) -> int:
        monkeypatch.setattr("sys.argv", ["hopdiff", *words])
        return main()

    source = tmp_path / "walk.bvh"
    write_bvh(source, clip_of("walk"), "ZYX", 100.0)
    words = [f"retarget.skeleton={hero(tmp_path)}", f"retarget.names={names_without_arms(tmp_path)}"]
    out = tmp_path / "out"
    assert hopdiff("task=export", f"run={source}", "export=[html]", *words, f"hydra.run.dir={out}") == 0
    said = capsys.readouterr().out
    assert "14 of 22 parts found; not arms, collarbones" in said
    assert "arms not found" in said
    assert json.loads((out / "retarget.json").read_text())["found"] == 14
    assert "left_shoulder:\n" in (out / NAMES_FILE).read_text()
    notes = json.loads((out / "status.json").read_text())["notes"]
    assert [note["flag"] for note in notes] == ["retarget"]
    assert "14 of 22" in (out / "motion.html").read_text()
    # A run has it in its metrics, and nothing to fill in where all is there.
    whole = write_rest(tmp_path / "whole.bvh", skeleton())
    run = tmp_path / "run"
    words = ["+experiment=edit", f"clip={source}", "target.position=[0.2,1]", "pictures=false"]
    assert hopdiff(*words, "export=[bvh_blender]", f"retarget.skeleton={whole}", f"hydra.run.dir={run}") == 0
    assert json.loads((run / "metrics.json").read_text())["retarget"]["found"] == 22
    assert not (run / NAMES_FILE).exists()
    assert not (run / "retarget.json").exists()
