from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort.problem import BodyProblem
from hopdiff.export.blend_space import sliding
from hopdiff.export.contact_events import contact_events, root_motion
from hopdiff.export.full_body import full_body
from hopdiff.export.one_stride import one_stride
from hopdiff.export.pose import mirrored
from hopdiff.export.prepare import in_place
from hopdiff.export.tables import read_npz
from hopdiff.io.glb_file import read_glb
from hopdiff.job import make_run
from hopdiff.tasks.blendspace import begin_near
from hopdiff.tasks.turning import turning
from tests.builders import valid_genes
from tests.export.gltf import Gltf
from tests.export.rigs import armature, skeleton, with_legs
from tests.tasks.test_path import QUICK

GRID = ("task=blendspace", "blendspace.speeds=[4,3]", "blendspace.betas=[0.2,0.7]")


def call(monkeypatch: pytest.MonkeyPatch, folder: Path, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, f"hydra.run.dir={folder}"])
    return main()


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("grid") / "out"
    with pytest.MonkeyPatch.context() as patch:
        assert call(patch, folder, *GRID, *QUICK) == 0
    return folder


def test_every_crossing_is_a_run_and_a_clip(grid: Path) -> None:
    index = json.loads((grid / "blendspace.json").read_text())
    assert (index["speeds"], index["betas"], index["missing"]) == ([3.0, 4.0], [0.2, 0.7], [])
    assert [(clip["speed"], clip["beta"]) for clip in index["clips"]] == [(3, 0.2), (3, 0.7), (4, 0.2), (4, 0.7)]
    file = Gltf.of((grid / "blendspace.glb").read_bytes())
    assert [one["name"] for one in file.content["animations"]] == [clip["name"] for clip in index["clips"]]
    for clip in index["clips"]:
        own = grid / "runs" / f"v{clip['speed']:g}_beta{clip['beta']:g}"
        metrics = json.loads((own / "metrics.json").read_text())
        assert (metrics["speed"], metrics["beta"]) == (clip["speed"], clip["beta"])
        assert read_npz(own / "motion.npz").clip.duration == pytest.approx(clip["stride_time"], abs=1e-6)
    assert json.loads((grid / "status.json").read_text())["status"] == "complete"
    assert (grid / "blendspace.html").stat().st_size > 500_000


def test_finished_runs_are_a_space_too_and_need_not_be_all(
    grid: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("task=export", f"runs={grid / 'runs'}", "export=[blendspace]")
    assert call(monkeypatch, tmp_path / "whole", *words) == 0
    ours, again = (json.loads((folder / "blendspace.json").read_text()) for folder in (grid, tmp_path / "whole"))
    assert sorted(ours["clips"], key=lambda clip: clip["name"]) == sorted(again["clips"], key=lambda clip: clip["name"])
    assert "lacks" not in capsys.readouterr().out
    assert json.loads((tmp_path / "whole" / "status.json").read_text())["notes"] == []
    three = ",".join(str(grid / "runs" / name) for name in ("v3_beta0.2", "v3_beta0.7", "v4_beta0.7"))
    assert call(monkeypatch, tmp_path / "part", "task=export", f"run=[{three}]", "export=[blendspace]") == 0
    assert json.loads((tmp_path / "part" / "blendspace.json").read_text())["missing"] == [
        {"speed": 4.0, "beta": 0.2, "turn": 0.0}
    ]
    told = "exports.blendspace: the grid lacks 1 clip: speed 4, beta 0.2, turn 0."
    assert f"note      {told}" in capsys.readouterr().out.splitlines()
    notes = json.loads((tmp_path / "part" / "status.json").read_text())["notes"]
    assert notes == [{"flag": "blendspace", "sentence": told}]


@pytest.mark.parametrize("rooted", [False, True])
def test_a_space_on_another_body(grid: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rooted: bool) -> None:
    """Also where a root on the ground carries the way, against which the pelvis moves."""
    body = skeleton("unreal_mannequin", "a") if rooted else skeleton()
    if rooted:
        names, parents = ("root", *body.names), (-1, *(parent + 1 for parent in body.parents))
        offsets = torch.cat((torch.zeros(1, 3).double(), body.offsets))
        body = type(body)(names, parents, offsets, body.end_sites)
    hero = tmp_path / "hero.glb"
    hero.write_bytes(armature(body))
    words = ("task=export", f"runs={grid / 'runs'}", "export=[blendspace]", f"retarget.skeleton={hero}")
    assert call(monkeypatch, tmp_path / "out", *words, "retarget.keys=64", "retarget.root=in_place") == 0
    index = json.loads((tmp_path / "out" / "blendspace.json").read_text())
    assert len(index["clips"]) == 4
    for clip in index["clips"]:
        assert [event["name"] for event in clip["contacts"]] == ["LeftDown", "LeftUp", "RightDown", "RightUp"]
        assert clip["contacts"][0]["phase"] == 0.0
        assert clip["stride_length"] / clip["stride_time"] == pytest.approx(clip["speed"], rel=0.02)
    # The body's own file has the same clips, beginning with the left foot, on the spot.
    files = [Gltf.of(path.read_bytes()) for path in (tmp_path / "out").glob("retargeted*.glb")]
    wanted, root = {clip["name"] for clip in index["clips"]}, read_glb(hero).skeleton().names[0]
    clips = [(file, one) for file in files for one in file.content["animations"] if one["name"] in wanted]
    assert {one["name"] for _, one in clips} == wanted
    for file, one in clips:
        longest = max((file.values(sampler["input"])[:, 0] for sampler in one["samplers"]), key=len)
        assert len(longest) == 65
        first, last = (file.places(one["name"], time)[root] for time in (longest[0], longest[-1]))
        assert abs(last[2] - first[2]) < 0.01


def test_a_search_begins_at_its_neighbour_where_that_costs_less() -> None:
    job, other = (build_job(compose(["model=body", "speed=3.2", "beta=0.2"])) for _ in range(2))
    assert isinstance(job.problem, BodyProblem)
    assert isinstance(other.problem, BodyProblem)
    start, spread = job.problem.start.clone(), job.problem.spread
    worse = (start + 0.2).clamp(0.0, 1.0)
    values = dict(zip(job.table.names, job.table.to_physical(worse).tolist(), strict=True))
    begin_near(job, [values])
    torch.testing.assert_close(job.problem.start, start)
    # From a bad start the ordinary one is the better neighbour.
    other.problem.start = worse
    values = dict(zip(job.table.names, job.table.to_physical(start).tolist(), strict=True))
    begin_near(other, [values])
    torch.testing.assert_close(other.problem.start, start, atol=1e-9, rtol=0)
    assert other.problem.spread < spread


@pytest.mark.parametrize("model", ["smooth", "body"])
def test_a_turning_stride_runs_on_a_circle(model: str) -> None:
    """Each repetition is turned about one point, at a distance of speed over rate of turn, and feet stand."""
    job = build_job(compose([f"model={model}", "speed=3.2", "beta=0.2"]))
    genes = job.problem.start if model == "body" else valid_genes(job.problem, 1, seed=2)[0]
    run = make_run(job, genes)
    for turn in (60.0, -40.0):
        take = turning(job, run, turn)
        assert take.loop
        assert take.clip.duration == pytest.approx(run.metrics["stride_time"], rel=0.02)
        assert contact_events(take)[0].name == "LeftDown"
        assert contact_events(take)[0].time == pytest.approx(0.0, abs=0.01)
        heads = take.repeated(4).clip.root_position[:: take.frames - 1, [0, 2]].numpy()
        # A circle through three places of the root, a stride apart.
        sides = np.linalg.norm(heads[[1, 2, 0]] - heads[[2, 0, 1]], axis=1)
        angle = np.radians(turn) * take.clip.duration
        assert sides[0] == pytest.approx(sides[2], rel=1e-3)
        assert sides[1] == pytest.approx(2.0 * sides[0] * np.cos(0.5 * angle), rel=1e-3)
        # To the left is towards +x.
        assert np.sign(heads[3, 0] - heads[0, 0]) == np.sign(turn)
        way = root_motion(take)
        assert float(way.distance[-1]) == pytest.approx(3.2 * take.clip.duration, rel=0.01)
        assert float(way.yaw[-1] - way.yaw[0]) == pytest.approx(angle, rel=1e-3)
        whole = full_body(take) if model == "smooth" else take
        for one in (whole, one_stride(whole, 64)):
            slide = sliding(in_place(one))
            assert slide is not None
            assert slide < 0.08
        # In the mirror it turns to the other side.
        assert root_motion(mirrored(take)).yaw[-1] == pytest.approx(-float(way.yaw[-1]), abs=1e-6)
        assert mirrored(take).numbers["turn"] == -turn


def test_turns_are_clips_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("task=blendspace", "blendspace.speeds=[3]", "blendspace.betas=[0.2]", "blendspace.turns=[-50,0,50]")
    assert call(monkeypatch, tmp_path / "out", *words, *QUICK) == 0
    index = json.loads((tmp_path / "out" / "blendspace.json").read_text())
    assert index["turns"] == [-50.0, 0.0, 50.0]
    assert sorted(clip["turn"] for clip in index["clips"]) == [-50.0, 0.0, 50.0]
    for clip in index["clips"]:
        assert clip["stride_length"] / clip["stride_time"] == pytest.approx(3.0, rel=0.01)
    # Again from the folders of the runs, and on another body, whose steps are as long as its legs.
    hero = tmp_path / "hero.glb"
    hero.write_bytes(armature(with_legs(skeleton(), 0.8)))
    words = ("task=export", f"runs={tmp_path / 'out' / 'runs'}", "export=[blendspace]")
    assert call(monkeypatch, tmp_path / "again", *words) == 0
    again = json.loads((tmp_path / "again" / "blendspace.json").read_text())
    assert {clip["name"]: clip["turn"] for clip in again["clips"]} == {
        clip["name"]: clip["turn"] for clip in index["clips"]
    }
    more = ("retarget.keys=64", "retarget.root=in_place", f"retarget.skeleton={hero}")
    assert call(monkeypatch, tmp_path / "hero", *words, *more) == 0
    small = json.loads((tmp_path / "hero" / "blendspace.json").read_text())
    assert small["turns"] == [-50.0, 0.0, 50.0]
    for clip in small["clips"]:
        assert clip["stride_length"] / clip["stride_time"] == pytest.approx(clip["speed"], rel=0.03)
        assert clip["speed"] < 2.7


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("blendspace.speeds=[]", "blendspace.speeds must be a list of different numbers"),
        ("blendspace.betas=[0.2,0.2]", "blendspace.betas must be a list of different numbers"),
        ("blendspace.speeds=[3,-1]", "speed must be a number above 0"),
        ("blendspace.betas=[0.2,1.5]", "beta must be at least 0 and below 1"),
        ("blendspace.turns=[0,190]", "blendspace.turns must lie between -141 and 141 deg/s at 4 m/s, not 190"),
        ("blendspace.keys=3", "blendspace.keys"),
    ],
)
def test_what_cannot_be_leaves_no_folder(
    word: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(monkeypatch, tmp_path / "out", *GRID, *QUICK, word) != 0
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
