from __future__ import annotations

from pathlib import Path

import hydra
import pytest
import torch
from hydra.core.global_hydra import GlobalHydra

import hopdiff
from hopdiff.composing import compose
from hopdiff.doors import config_folder
from hopdiff.io.bvh import read_bvh

TINY = {"search": "random", "evaluations": 60, "model": "smooth"}
# Of the default model: a search that needs no luck, and some least run, which is not searched for then.
LEAST = ("costs.least.external_work=0.2", "costs.least.contact_time=0.25")
BODY = {"search": "ga", "evaluations": 60, "settings": ("search.population=30", *LEAST)}


@pytest.mark.parametrize("how", [BODY, TINY], ids=["body", "smooth"])
def test_generate_returns_a_run_and_writes_nothing(
    how: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run = hopdiff.generate(speed=3, beta=0.5, fps=30, **how)
    assert run.metrics["speed"] == pytest.approx(3.0)
    assert run.metrics["model"] == how.get("model", "body")
    assert run.metrics["beta"] == 0.5
    assert run.clip is run.motion.clip
    assert run.clip.frame_time == pytest.approx(1 / 30, rel=0.05)
    assert len(run.genes) >= 25
    assert run.history[-1].best == min(row.best for row in run.history)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("how", [pytest.param(BODY, marks=pytest.mark.thorough), TINY], ids=["body", "smooth"])
def test_same_seed_same_run_other_seed_other_run(how: dict) -> None:
    one, two, three = (hopdiff.generate(speed=3, seed=seed, **how) for seed in (1, 1, 2))
    assert torch.equal(one.clip.rotations, two.clip.rotations)
    assert one.genes == two.genes
    assert one.genes != three.genes


def test_generate_leaves_pytorch_and_hydra_as_they_were() -> None:
    torch.set_num_threads(2)
    state = torch.random.get_rng_state()
    with hydra.initialize_config_dir(str(config_folder()), version_base=None):
        hopdiff.generate(**TINY)
        assert GlobalHydra.instance().is_initialized()
        assert hydra.compose("config").speed == compose().speed
    assert torch.get_num_threads() == 2
    assert torch.equal(torch.random.get_rng_state(), state)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"speed": -1}, "speed must be a number above 0"),
        ({"speed": float("nan")}, "speed must be a number above 0"),
        ({"speed": "fast"}, "speed must be a number, not 'fast'"),
        ({"beta": 1.0}, "beta must be at least 0 and below 1"),
        ({"search": "gaa"}, "Unknown search 'gaa'"),
        ({"character": "dwarf"}, "Unknown character 'dwarf'"),
        ({"dtype": "float16"}, "Unknown dtype 'float16'"),
        ({"evaluations": 0}, "budget.evaluations"),
        ({"settings": ("search.popsize=3",)}, "Unknown setting of search gradient 'popsize'"),
        ({"search": object()}, "a search is an object with name, init, ask and tell"),
        ({"search": int}, "a search is an object with name, init, ask and tell"),
        ({"character": [1]}, "character must be the name of a body or a table"),
        ({"costs": [1]}, "costs must be a name or a list of hopdiff.Term"),
    ],
)
def test_mistakes_are_hopdiff_errors(arguments: dict, says: str) -> None:
    with pytest.raises(hopdiff.HopdiffError, match=says):
        hopdiff.generate(**arguments)


def test_settings_reach_the_search() -> None:
    run = hopdiff.generate(search="random", model="smooth", evaluations=40, settings=("search.population=10",))
    assert [row.evaluations for row in run.history] == [10, 20, 30, 40]


def test_saved_runs_are_those_that_were_made(tmp_path: Path) -> None:
    runs = [hopdiff.generate(speed=speed, **TINY) for speed in (3, 5)]
    files = hopdiff.save(runs, tmp_path / "out", "glb", "bvh_unreal", settings=("exports.bvh_unreal.fps=30",))
    assert [file.name for file in files[:1]] == ["motion.glb"]
    assert sorted(file.name for file in files) == sorted(file.name for file in (tmp_path / "out").iterdir())
    assert len(files) == 3
    for run, file in zip(runs, files[1:], strict=True):
        clip = read_bvh(file, 0.01, "z").clip()
        assert clip.duration == pytest.approx(run.clip.duration, rel=1e-4)
        hips = run.clip.joint_positions()[-1, run.clip.skeleton.index("left_hip")]
        torch.testing.assert_close(clip.joint_positions()[-1, clip.skeleton.index("thigh_l")], hips, atol=1e-3, rtol=0)
    assert hopdiff.save(runs[0], tmp_path / "one", "csv") == [tmp_path / "one" / "joints.csv"]


@pytest.mark.parametrize(
    ("exports", "settings", "says"),
    [
        (("gbl",), (), "Unknown export 'gbl'"),
        ((), (), "save needs the name of an export"),
        (("glb",), ("exports.glb.fps=0",), "exports.glb.fps must lie between"),
    ],
)
def test_mistakes_in_saving_leave_nothing(
    tmp_path: Path, exports: tuple[str, ...], settings: tuple[str, ...], says: str
) -> None:
    run = hopdiff.generate(**TINY)
    with pytest.raises(hopdiff.HopdiffError, match=says):
        hopdiff.save(run, tmp_path / "out", *exports, settings=settings)
    assert not (tmp_path / "out").exists()
