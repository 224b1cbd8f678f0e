from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

from hopdiff.cli import main
from tests.builders import make_character, make_problem

ABOUT_THE_SEARCH = {
    "evaluations",
    "gradient_evaluations",
    "invalid_fraction",
    "wall_seconds",
    "stopped",
    "compiled",
    "search",
}
MOTIONS = ("motion.bvh", "motion_in_place.bvh")


def replay(folder: Path, source: Path, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    command = ["hopdiff", "task=replay", f"genes_file={source}", f"hydra.run.dir={folder}", *arguments]
    monkeypatch.setattr("sys.argv", command)
    return main()


def metrics_of(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def test_the_same_motion_comes_back(either: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert replay(tmp_path / "again", either / "genes.json", monkeypatch) == 0
    for name in MOTIONS:
        assert (tmp_path / "again" / name).read_bytes() == (either / name).read_bytes()
    before, after = (json.loads((folder / "metrics.json").read_text()) for folder in (either, tmp_path / "again"))
    for name in set(before) - ABOUT_THE_SEARCH:
        same = pytest.approx(before[name], rel=1e-9) if isinstance(before[name], float) else before[name]
        assert after[name] == same, name
    assert after["evaluations"] == 0
    assert not (tmp_path / "again" / "history.csv").exists()
    assert (tmp_path / "again" / "strip.png").exists()


@pytest.mark.few(2)
def test_typed_settings_win(either: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert replay(tmp_path / "fast", either / "genes.json", monkeypatch, "fps=120", "beta=0.3", "pictures=false") == 0
    metrics = json.loads((tmp_path / "fast" / "metrics.json").read_text())
    assert metrics["frame_time"] == pytest.approx(1 / 120, rel=0.02)
    assert metrics["beta"] == 0.3
    assert metrics["speed"] == pytest.approx(4.0)


def test_fixed_genes_come_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fixed = ("genes.fixed.step_width=0.2", "genes.common_eta=true", "genes.fixed.eta=7")
    words = ("model=smooth", "search=ordinary", *fixed)
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, "pictures=false", f"hydra.run.dir={tmp_path / 'first'}"])
    assert main() == 0
    assert replay(tmp_path / "again", tmp_path / "first" / "genes.json", monkeypatch, "pictures=false") == 0
    assert (tmp_path / "again" / "motion.bvh").read_bytes() == (tmp_path / "first" / "motion.bvh").read_bytes()
    assert json.loads((tmp_path / "again" / "metrics.json").read_text())["genes"].endswith("+eta=7+step_width=0.2")


def test_genes_that_cannot_run_leave_no_folder(
    finished_smooth: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert replay(tmp_path / "no", finished_smooth / "genes.json", monkeypatch, "costs.limits.leg_force_bw=0.5") == 1
    assert "is not a possible run with these settings: The stance leg would have to push" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize(
    ("arguments", "name"),
    [(("character=child",), "child"), (("character.proportions.legs=1.2",), "human+legs=1.2")],
    ids=["child", "longer legs"],
)
def test_another_body_runs_with_steps_of_its_own_legs(
    arguments: tuple[str, ...], name: str, finished_smooth: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert replay(tmp_path / "other", finished_smooth / "genes.json", monkeypatch, "pictures=false", *arguments) == 0
    before, after = metrics_of(finished_smooth), metrics_of(tmp_path / "other")
    assert (after["character"], after["speed"], after["beta"]) == (name, before["speed"], before["beta"])
    legs = after["leg_length"] / before["leg_length"]
    assert legs == pytest.approx(1.2 if "legs" in name else make_character("child").leg_length / before["leg_length"])
    # Genes are angles, ratios and leg lengths: all ways on the ground go with the legs.
    assert after["step_length"] == pytest.approx(legs * before["step_length"], rel=1e-9)
    assert after["contact_time"] == pytest.approx(legs * before["contact_time"], rel=1e-9)
    assert after["duty_factor"] == pytest.approx(before["duty_factor"], rel=1e-9)
    assert after["stance_foot_drift"] < 1e-6
    assert after["loop_error"] < 1e-6
    genes = [
        json.loads((folder / "genes.json").read_text())["genes"] for folder in (finished_smooth, tmp_path / "other")
    ]
    for gene, entry in genes[0].items():
        assert genes[1][gene]["value"] == pytest.approx(entry["value"], abs=1e-9), gene


@pytest.mark.thorough
def test_mass_alone_leaves_the_motion_as_it_is(
    finished_smooth: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The spring leg is as much stiffer as the body is heavier, and balance knows only shares of the mass."""
    assert (
        replay(tmp_path / "heavy", finished_smooth / "genes.json", monkeypatch, "pictures=false", "character.mass=90")
        == 0
    )
    for name in MOTIONS:
        assert (tmp_path / "heavy" / name).read_bytes() == (finished_smooth / name).read_bytes()
    assert json.loads((tmp_path / "heavy" / "genes.json").read_text())["settings"]["character"]["mass"] == 90.0


@pytest.mark.few(3)
@pytest.mark.parametrize("words", [("speed=2",), ("speed=9",), ("character.proportions.legs=1.5",)], ids=" ".join)
def test_genes_outside_the_range_of_a_search_are_told(
    words: tuple[str, ...],
    finished_smooth: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert replay(tmp_path / "far", finished_smooth / "genes.json", monkeypatch, "pictures=false", *words) == 0
    # Speed 4 is what the genes were found at.
    table = make_problem("speed=4", *words).table
    genes = json.loads((finished_smooth / "genes.json").read_text())["genes"]
    ranges = zip(table.names, table.low.tolist(), table.high.tolist(), strict=True)
    outside = [name for name, low, high in ranges if not low <= genes[name]["value"] <= high]
    assert outside
    said = f"Outside the range of a search on this body at this speed: {', '.join(outside)}.\n"
    assert capsys.readouterr().out.startswith(said)


def test_nothing_is_told_of_genes_inside_their_ranges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # The genes of an everyday run, which lie well inside.
    words = ("model=smooth", "search=ordinary", "speed=4", "pictures=false", f"hydra.run.dir={tmp_path / 'first'}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 0
    words = ("pictures=false", "character.proportions.legs=1.1")
    assert replay(tmp_path / "near", tmp_path / "first" / "genes.json", monkeypatch, *words) == 0
    assert "Outside" not in capsys.readouterr().out


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "words",
    [("character=child", "speed=1"), ("character.proportions.legs=1.2", "speed=1"), ("character.height=5", "speed=1")],
    ids=" ".join,
)
def test_where_the_genes_cannot_run_the_speed_of_the_same_froude_number_is_told_and_works(
    words: tuple[str, ...],
    finished_smooth: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    body = [word for word in words if not word.startswith("speed=")]
    assert replay(tmp_path / "no", finished_smooth / "genes.json", monkeypatch, "pictures=false", *words) == 1
    out, err = capsys.readouterr()
    assert (out, len(err.splitlines())) == ("", 1)
    assert err.startswith(
        f"hopdiff: genes_file '{finished_smooth / 'genes.json'}' is not a possible run with these settings:"
    )
    hint = re.search(
        r"Try (speed=[0-9.]+), which gives the character (\w+) the Froude number of the original\.\n$", err
    )
    assert hint is not None
    assert not (tmp_path / "no").exists()
    assert replay(tmp_path / "yes", finished_smooth / "genes.json", monkeypatch, "pictures=false", *body, hint[1]) == 0
    before, after = metrics_of(finished_smooth), metrics_of(tmp_path / "yes")
    assert after["froude"] == pytest.approx(before["froude"], abs=0.005)
    assert after["speed"] == pytest.approx(4.0 * math.sqrt(after["leg_length"] / before["leg_length"]), abs=0.005)
    assert after["character"].split("+")[0] == hint[2]


def test_a_file_of_an_older_version_still_makes_its_motion(
    finished_smooth: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    content = json.loads((finished_smooth / "genes.json").read_text())
    settings = content["settings"]
    for name in ("limp", "path", "hopper", "pictures"):
        settings.pop(name, None)
    del settings["character"]["proportions"], settings["genes"]["common_eta"], settings["genes"]["fixed"]
    for name in [name for name in settings["genes"]["genes"] if name.startswith("lame_") or name == "eta"]:
        del settings["genes"]["genes"][name]
    (tmp_path / "old.json").write_text(json.dumps(content))
    assert replay(tmp_path / "again", tmp_path / "old.json", monkeypatch, "pictures=false") == 0
    for name in MOTIONS:
        assert (tmp_path / "again" / name).read_bytes() == (finished_smooth / name).read_bytes()
    assert metrics_of(tmp_path / "again")["character"] == "human"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("limp.amount=0.3",), "lacks the gene 'lame_ease'. The run has no limp: set limp.amount=0."),
        (
            ("+experiment=limp",),
            "+experiment has no effect with task=replay: type single settings, as limp.amount=0.3.",
        ),
    ],
)
def test_a_replay_that_cannot_limp_says_why(
    words: tuple[str, ...],
    said: str,
    finished_smooth: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert replay(tmp_path / "no", finished_smooth / "genes.json", monkeypatch, *words) == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_a_limp_cannot_be_replayed_as_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("search=ordinary", "speed=3", "limp.amount=0.3", "pictures=false", f"hydra.run.dir={tmp_path / 'limp'}")
    monkeypatch.setattr("sys.argv", ["hopdiff", "model=smooth", *words])
    assert main() == 0
    source = tmp_path / "limp" / "genes.json"
    assert replay(tmp_path / "mirror", source, monkeypatch, "limp.leg=right", "pictures=false") == 0
    lame, mirrored = metrics_of(tmp_path / "limp"), metrics_of(tmp_path / "mirror")
    for name in ("knee_swing_max_deg", "knee_stance_max_deg"):
        assert mirrored[name] == pytest.approx(lame[name], abs=0.2)
    assert replay(tmp_path / "no", source, monkeypatch, "limp.amount=0") == 1
    assert "The run has a limp: set limp.amount above 0." in capsys.readouterr().err


def test_what_is_wrong_with_the_saved_body_is_said_of_the_file(
    either: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads((either / "genes.json").read_text())
    content["settings"]["character"]["proportions"]["legs"] = 9
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    assert replay(tmp_path / "no", tmp_path / "wrong.json", monkeypatch, "character=human") == 1
    assert "wrong.json', of its saved settings: character.proportions.legs must lie" in capsys.readouterr().err
