"""The study of ways, in small, and what judges it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from hopdiff.graph.scene_file import scene_of
from hopdiff.io.bvh import read_bvh
from tests.people import file_of

ROOT = Path(__file__).resolve().parents[2]
ROOMS = {
    "name": "rooms",
    "rooms": {"near": [[0, 0], [4, 0], [4, 4], [0, 4]], "far": [[0, 5], [4, 5], [4, 9], [0, 9]]},
    "passages": {"door": {"between": ["near", "far"], "from": [2, 4], "to": [2, 5], "width": 1.0}},
    "walls": {"screen": {"from": [1, 1], "to": [1, 3], "thickness": 0.2}},
    "furniture": {"table": [[3, 7], [4, 7], [4, 8], [3, 8]]},
}


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def test_the_judge_reads_and_poses_as_the_project_does(tmp_path: Path) -> None:
    from experiments.ways.judge import read_walk

    file = file_of("wander", tmp_path)
    clip, walk = read_bvh(file).clip(), read_walk(file, read_bvh(file).unit)
    theirs = {**{name: clip.joint_positions()[:, k] for k, name in enumerate(clip.skeleton.names)}}
    theirs |= {f"{name} end": places for name, places in clip.end_positions().items()}
    assert set(walk.names) == set(theirs)
    for k, name in enumerate(walk.names):
        np.testing.assert_allclose(walk.places[:, k], theirs[name].numpy(), atol=1e-6)
    assert walk.frame_time == pytest.approx(clip.frame_time)


def test_the_judge_finds_the_deepest_part_and_what_was_missed() -> None:
    from experiments.ways.judge import Walk, judge
    from experiments.ways.scenes import Pair

    root = np.array([[1.5, 0.9, 0.5], [1.5, 0.9, 1.5], [1.5, 0.9, 2.5]])
    hand = root + np.array([[-0.3, 0.0, 0.0], [-0.45, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    forward = np.array([[0.0, 1.0], [0.0, 1.0], [1.0, 0.0]])
    walk = Walk(["hips", "hand"], np.stack((root, hand), axis=1), forward, 0.5)
    found = judge(walk, ROOMS, Pair((1.5, 0.5, 0.0), (1.4, 2.5, 80.0)))
    # The screen reaches from x = .9 to 1.1: in the second frame the hand is 5 cm inside.
    assert found.depth == pytest.approx(0.05)
    assert found.deepest == "hand"
    assert found.inside == pytest.approx(1 / 3)
    assert found.length == pytest.approx(2.0)
    assert found.fastest == pytest.approx(2.0)
    assert found.off == pytest.approx(0.1)
    assert found.off_deg == pytest.approx(10.0)


def test_shortest_ways_go_round_corners_by_half_a_width() -> None:
    from experiments.ways.judge import Shortest

    shortest = Shortest(ROOMS, 0.25)
    assert shortest.length((2.0, 1.0), (2.0, 8.0)) == pytest.approx(7.0, abs=1e-6)
    # Two tangents of a quarter metre around the screen's corners, and the arcs between.
    around = shortest.length((0.5, 2.0), (1.5, 2.0))
    straight = 2.0 * math.sqrt(0.5**2 - 0.15**2)  # from each place to the corner's circle at most
    assert 2.0 * 0.9 + 0.7 < around < 2.0 * 1.2 + 2.0 * straight
    assert math.isinf(Shortest({**ROOMS, "passages": {}}, 0.25).length((2.0, 1.0), (2.0, 8.0)))


@pytest.mark.parametrize("name", ["flat_1", "flat_2", "hall_3", "warehouse_4"])
def test_scenes_are_the_same_each_time_and_can_be_walked_in(name: str) -> None:
    from experiments.ways.scenes import HALF_WIDTH, SCENES, floor_of, pairs

    data = SCENES[name]()
    assert data == SCENES[name]()
    scene = scene_of(data)
    assert scene.free().symmetric_difference(floor_of(data)).area < 1e-3
    assert all(door.width == 0.8 for door in scene.passages.values())
    drawn = pairs(data, 25, 7)
    assert len(set(drawn)) == 25
    free = scene.free().buffer(-HALF_WIDTH)
    assert all(free.covers(shapely.Point(place[:2])) for pair in drawn for place in (pair.start, pair.goal))
    assert len(shapely.get_parts(free.buffer(-0.01))) < 8


def test_the_warehouse_is_nearly_two_hundred_metres_long() -> None:
    from experiments.ways.judge import Shortest
    from experiments.ways.scenes import SCENES

    shortest = Shortest(SCENES["warehouse_4"](), 0.25)
    assert 180.0 < shortest.length((0.5, 0.5), (39.0, 40.0)) < 220.0


def test_the_study_goes_on_where_it_stopped_and_judges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from experiments.report import read_table
    from experiments.ways import __main__ as study
    from experiments.ways.scenes import Pair

    # Places from which the person who is made by rule gets to the other.
    pair = Pair((2.0, 1.0, 0.0), (2.0, 8.0, 0.0))
    monkeypatch.setattr(study, "SCENES", {"rooms": lambda: ROOMS})
    monkeypatch.setattr(study, "pairs", lambda data, count, seed: [pair] * count)
    clip = file_of("wander", tmp_path)
    arguments = ["--clips", str(clip), "--unit", str(read_bvh(clip).unit), "--scenes", "rooms", "--out", str(tmp_path)]
    study.main([*arguments, "--pairs", "1", "--busy", "1"])
    text = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == text.strip()
    assert "| rooms | 1 of 1 |" in text
    assert "| the same on a busy machine | 1 of 1 scenes | yes |" in text
    first = (tmp_path / "ways.csv").read_text(encoding="utf-8")
    study.main([*arguments, "--pairs", "1", "--busy", "1"])
    assert (tmp_path / "ways.csv").read_text(encoding="utf-8") == first
    row = read_table(tmp_path / "ways.csv")[0]
    assert float(row["off"]) < 1e-5
    assert "**no**" in study.report([{**row, "depth": 0.02}], "wander")
    assert "**no**" in study.report([{**row, "detour": 1.2}], "wander")
    lost = {**row, "found": 0, "said": "no way"}
    assert "| 98 of 100 found | 1 of 2 | **no** |" in study.report([row, lost], "wander")
    assert "- rooms, pair 0: no way" in study.report([lost, row], "wander")
    # As it is before it was written and read again.
    unread = {"scene": "rooms", "pair": "1", "found": 0, "shortest": 7.0, "seconds": 1.0, "said": "no way"}
    assert "- rooms, pair 1: no way" in study.report([row, unread], "wander")
    other = {**row, "pair": "0 busy", "digest": "other"}
    assert "| rooms | 1 | 0 |" in study.report([row, other], "wander")
