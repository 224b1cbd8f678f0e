"""Every mistake on the command line: one sentence, status 1, nothing left behind."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

import hopdiff
from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.doors import config_folder
from hopdiff.errors import sentence

MISTAKES = {
    "sped=3": "Unknown setting 'sped'. Did you mean 'speed'?",
    "+sped=3": "Unknown setting 'sped'. Did you mean 'speed'?",
    "+speed=3": "write speed=VALUE, without the plus",
    "speed": "The override 'speed' cannot be read: write NAME=VALUE",
    "speed=[1,": "The override 'speed=[1,' cannot be read",
    "genes_file=a=b": "The override 'genes_file=a=b' cannot be read",
    "speed=fast": "speed must be a number, not 'fast'",
    "speed=": "speed must be a number, not ''",
    "speed=null": "speed needs a value",
    "speed=0": "speed must be a number above 0 [m/s], not 0",
    "speed=-2": "speed must be a number above 0 [m/s], not -2",
    "speed=nan": "speed must be a number above 0 [m/s], not nan",
    "speed=inf": "speed must be a number above 0 [m/s], not inf",
    "speed=3,4": "add -m to make a run of each",
    "beta=1": "beta must be at least 0 and below 1, not 1",
    "beta=-0.1": "beta must be at least 0 and below 1, not -0.1",
    "beta=nan": "beta must be at least 0 and below 1, not nan",
    "fps=0": "fps must be above 0",
    "fps=-60": "fps must be above 0",
    "fps=nan": "fps must be above 0",
    "fps=1e9": "fps must be above 0 and at most 10000",
    "seed=-1": "seed must be a whole number from 0",
    "seed=1.5": "seed must be a whole number, not '1.5'",
    "threads=0": "threads must be at least 1",
    "device=gpu": "device 'gpu' cannot be used here: choose one of cpu",
    "device=meta": "device 'meta' cannot be used here: choose one of cpu",
    "device=cuda:99": "device 'cuda:99' cannot be used here: choose one of cpu",
    "dtype=float16": "Unknown dtype 'float16': choose one of float32, float64",
    "budget.evaluations=0": "budget.evaluations must be at least 1",
    "budget.evaluation=5": "Did you mean 'budget.evaluations'?",
    "budget.gradient_price=-1": "budget.gradient_price must be",
    "compile=maybe": "Unknown compile 'maybe': choose one of auto, false, true.",
    "model=smooth compile=maybe": "Unknown compile 'maybe'",
    "compile=true dtype=float32": "compile=true: kernels are for dtype=float64.",
    "search=gaa": "choose one of cmaes, ga, ga_thesis, gradient, hybrid, ordinary, random. Did you mean 'ga'?",
    "search.popsize=3": "Unknown setting of search gradient 'popsize': choose one of gain, method, name, patience",
    "+search.popsize=3": "popsize",
    "+search=ga": "write search=NAME, without the plus",
    "model=smoth": "Unknown model 'smoth': choose one of body, smooth, thesis. Did you mean 'smooth'?",
    "character=dwarf": "Unknown character 'dwarf': choose one of cartoon, child, human",
    "character.mass=-70": "mass must be a positive number",
    "character.height=0.0001": "height must be at least 0.01 m, not 0.0001",
    "character.heigt=2": "Did you mean 'character.height'?",
    "character.joints.left_knee.parent=left_elbow": "left_knee",
    "character.joints.left_hip.parent=left_knee": "cycle",
    "~character.joints.neck": "'neck' is missing",
    "costs=none": "Unknown costs 'none'",
    "genes=none": "Unknown genes 'none'",
    "genes.genes.step_time.high=25": "the range of 'step_time'",
    "~genes.genes.step_time": "'step_time' is missing",
    "model=smooth genes.genes.touchdown_angle.high=95": "the range of 'touchdown_angle'",
    "model=smooth ~genes.genes.touchdown_angle": "'touchdown_angle' is missing",
    "costs=default": "costs=default cannot judge runs of model=body: take costs=human or effort.",
    "model=smooth costs=human": "costs=human cannot judge runs of model=smooth: take costs=default or thesis.",
    "task=fly": "Unknown task 'fly': choose one of blendspace, body, compare, edit, export",
    "task=replay": "task=replay needs genes_file=FILE",
    "task=compare": "task=compare needs runs=FOLDER",
    "+experiment=navigate way.seconds=9": "way.seconds is no setting any more; ways are limited by steps of the search",
    "+experiment=navigate way.leg=8": "way.leg is no setting any more; ways of any length are found in one search",
    "experiment=brisk": "write +experiment=NAME",
    "+experiment=bris": "Did you mean 'brisk'?",
    "ground=slope": "ground is a setting of task=edit, task=navigate, task=path: add one of these.",
    "ground.angle=3": "ground is a setting of task=edit, task=navigate, task=path: add one of these.",
    "+ground=slope": "ground is a setting of task=edit, task=navigate, task=path: add one of these.",
    "task=edit ground.angle=3": "ground.angle is a setting of ground=slope: add it.",
    "task=edit ground.heading=3": "ground.heading is a setting of ground=slope, ground=stairs: add one of these.",
    "task=edit ground=slop": "choose one of flat, map, polygons, slope, stairs. Did you mean 'slope'?",
    "task=edit ground=3": "Unknown ground '3'",
    "task=edit ground=slope ground.angel=3": "Unknown setting 'ground.angel'. Did you mean 'ground.angle'?",
    "task=edit ground=slope +ground.rise=1": "Unknown setting of ground slope 'rise'",
    "task=edit ground=slope ground.angle=25": "ground.angle must lie between -20 and 20 degrees, not 25.",
    "task=edit ground=slope ground.angle=steep": "ground.angle must be a number, not 'steep'",
    "task=edit ground=slope ground.angle=null": "ground.angle needs a value, not null",
    "task=edit ground=map": "ground=map needs ground.file",
    "task=edit ground=map ground.file=none.png": "ground.file 'none.png' cannot be read: no such file",
    "task=navigate ground=stairs ground.rise=1": "task=navigate needs clips",
    "task=path ground=stairs ground.steps=0": "ground.steps must be from 1 to 1000, not 0.",
    "hydra/launcher=cloud": "Unknown hydra/launcher 'cloud'",
}


def run_main(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", *arguments])
    return main()


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    monkeypatch.chdir(tmp_path)


def only_sentence(capsys: pytest.CaptureFixture[str]) -> str:
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("hopdiff: ")
    assert len(err.splitlines()) == 1
    return err


@pytest.mark.few(4)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence(
    mistake: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run_main(monkeypatch, *mistake.split(" ")) == 1
    assert MISTAKES[mistake] in only_sentence(capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("sped: 3", "experiment/mine.yaml: Unknown setting 'sped'. Did you mean 'speed'?"),
        ("speed: fast", "experiment/mine.yaml: speed must be a number, not 'fast'"),
        ("search: {popsize: 3}", "Unknown setting of search"),
        ("search: {seed: 3, name: ga}", "Unknown setting of search"),
        ("speed: [3\nbeta: 1", "mine.yaml, line 3: not YAML"),
        ("defaults: [{override /search: gaa}]", "Unknown search 'gaa'"),
    ],
)
def test_a_mistake_in_a_file_names_it(
    content: str, says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "mine" / "experiment").mkdir(parents=True)
    (tmp_path / "mine" / "experiment" / "mine.yaml").write_text(f"# @package _global_\n{content}\n")
    assert run_main(monkeypatch, "--config-dir", "mine", "+experiment=mine") == 1
    assert says in only_sentence(capsys)


def test_a_run_folder_that_cannot_be_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    assert run_main(monkeypatch, "hydra.run.dir=file/run") == 1
    assert "The run folder (hydra.run.dir) cannot be written" in only_sentence(capsys)


def test_an_unwritable_run_folder_is_found_before_the_search(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def refuse(self: Path, data: bytes) -> int:
        raise PermissionError(13, "Permission denied", str(self))

    def search(*_: object) -> None:
        raise AssertionError("searched all the same")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    monkeypatch.setattr("hopdiff.tasks.run.find", search)
    assert run_main(monkeypatch, "model=smooth", "hydra.run.dir=there") == 1
    assert "there' cannot be written: Permission denied" in only_sentence(capsys)
    assert not (tmp_path / "there").exists()


def test_runs_that_are_not_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    assert run_main(monkeypatch, "task=compare", "runs=nowhere") == 1
    assert "runs=nowhere is not a folder" in only_sentence(capsys)
    assert run_main(monkeypatch, "task=compare", "runs=empty") == 1
    assert "runs=empty holds no run" in only_sentence(capsys)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", "not a JSON file"),
        ('{"genes": {}}', "lacks the gene"),
        ('{"genes": {}, "settings": {"speed": "fast"}}', "speed"),
        ('{"genes": {}, "settings": {"model": {"stepp": 1}}}', "stepp"),
        ('{"genes": {}, "settings": {"beta": 2}}', "beta must be at least 0 and below 1"),
    ],
)
def test_a_broken_genes_file(
    content: str, says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "genes.json").write_text(content)
    assert run_main(monkeypatch, "task=replay", "genes_file=genes.json") == 1
    assert says in only_sentence(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["genes.json"]


def test_no_valid_candidate_is_told_in_the_folder(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ("costs.limits.leg_force_bw=0.1", "search=random", "search.population=8", "budget.evaluations=16")
    assert run_main(monkeypatch, "model=smooth", *arguments) == 1
    said = only_sentence(capsys)
    assert "None of the 16 candidates tried is a possible run" in said
    (status,) = tmp_path.rglob("status.json")
    told = json.loads(status.read_text())
    assert (told["status"], f"hopdiff: {told['sentence']}\n") == ("failed", said)
    assert not list(tmp_path.rglob("metrics.json"))
    assert not list(tmp_path.rglob("motion*"))


def test_the_whole_trace_on_request(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(Exception, match="speed must be a number above 0"):
        run_main(monkeypatch, "speed=-2")
    with pytest.raises(Exception, match="Could not override 'sped'"):
        run_main(monkeypatch, "sped=2")


def test_an_error_of_hopdiff_itself_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("hopdiff.perform.perform", broken)
    with pytest.raises(ZeroDivisionError):
        run_main(monkeypatch)


def test_a_failing_job_of_a_sweep_is_named_and_the_others_finish(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("hopdiff.tasks.results.write_pictures", lambda *_: {})
    monkeypatch.setattr("hopdiff.tasks.results.write_moving", lambda *_: None)
    tiny = ("model=smooth", "search=random", "search.population=16", "budget.evaluations=32")
    with pytest.raises(SystemExit) as done:
        run_main(monkeypatch, "-m", "speed=-1,4", "hydra.sweep.dir=sweep", *tiny)
    assert done.value.code == 1
    err = capsys.readouterr().err
    assert "job 0 (speed=-1" in err
    assert "speed must be a number above 0" in err
    assert "Traceback" not in err
    metrics = [json.loads(path.read_text()) for path in (tmp_path / "sweep").rglob("metrics.json")]
    assert [m["speed"] for m in metrics] == [pytest.approx(4.0)]


def test_the_defaults_are_no_mistake() -> None:
    assert compose().speed == 5.0
    assert (config_folder() / "config.yaml").is_file()


def test_a_cluster_that_is_not_there_is_one_sentence() -> None:
    """As Ray raises it where none is running; an error of ours that is no such thing keeps its trace."""
    missing = ConnectionError("Could not find any running Ray instance. Please specify the one to connect to.\n")
    assert sentence(missing) == (
        "hydra/launcher=ray_cluster: Could not find any running Ray instance. Please specify the one to connect to."
    )
    assert sentence(ConnectionError("reset by peer")) is None


@pytest.mark.parametrize("kept", [True, False])
def test_a_mistake_leaves_folders_as_they_were(kept: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder of the user's own stays, and of one that is not there none of those above it."""
    folder = tmp_path / "deep" / "er" / "run"
    if kept:
        folder.mkdir(parents=True)
    assert run_main(monkeypatch, "model=smooth", "speed=-1", f"hydra.run.dir={folder}") == 1
    assert folder.is_dir() == kept
    assert (tmp_path / "deep").exists() == kept


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("export=[glbx]",), "Unknown export 'glbx': choose one of blend"),
        (("search=3",), "Unknown search '3': choose one of cmaes, ga"),
        (("search=ga", "search.population=nan"), "search.population must be a whole number, not 'nan'."),
        (("overwrite=maybe",), "overwrite must be true or false, not 'maybe'."),
        (("character=1.5",), "Unknown character '1.5': choose one of cartoon, child, human."),
        (("speed=" + "9" * 5000,), "speed is a number of too many digits."),
        (("seed=" + "9" * 5000,), "seed is a number of too many digits."),
    ],
    ids=lambda value: str(value)[:30],
)
def test_numbers_and_names_in_the_wrong_place(
    words: tuple[str, ...],
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run_main(monkeypatch, *words, f"hydra.run.dir={tmp_path / 'run'}") == 1
    assert says.partition(" blend")[0] in only_sentence(capsys)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("file", "text", "says"),
    [
        ("character/bin.yaml", b"\xff\xfe\x00bad", "not text (UTF-8)"),
        ("character/list.yaml", b"- 1\n", "character/list.yaml: Cannot merge DictConfig with ListConfig"),
        ("character/poor.yaml", b"name: poor\nheight: 1.7\n", "character/poor.yaml: character.mass"),
        ("experiment/bare.yaml", b"speed: 3\n", "A file of experiment/ lacks its first line: # @package _global_"),
        ("character/human2.yaml", b"defaults: [humann, _self_]\n", "Unknown character 'humann': choose one of cartoon"),
    ],
)
def test_files_of_ones_own_that_cannot_be(
    file: str,
    text: bytes,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "own" / file
    path.parent.mkdir(parents=True)
    path.write_bytes(text)
    plus = "+" if file.startswith("experiment") else ""
    words = ("--config-dir", str(tmp_path / "own"), f"{plus}{path.parent.name}={path.stem}")
    assert run_main(monkeypatch, *words, f"hydra.run.dir={tmp_path / 'run'}") == 1
    assert says in only_sentence(capsys)
    assert not (tmp_path / "run").exists()


def test_the_version_is_that_of_hopdiff(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
    assert run_main(monkeypatch, "--version") == 0
    assert "HYDRA_FULL_ERROR" not in os.environ  # which would make later mistakes long
    assert capsys.readouterr().out.startswith(f"hopdiff {hopdiff.__version__} (Hydra ")


def test_the_name_of_a_folder_holds_no_path_of_a_scene() -> None:
    assert compose(["task=navigate", "scene=/home/me/own.yaml"]).task.label == "navigate_own"
    assert compose(["task=navigate"]).task.label == "navigate_two_rooms"
