"""The group `ground`: every choice is the ground that its settings tell, and mistakes are one sentence."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import torch

from hopdiff.composing import compose
from hopdiff.config import typed
from hopdiff.doors import TASKS, files_of
from hopdiff.grounds import GROUNDS, build_ground
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError

SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2]]


def ground_of(*words: str, task: str = "edit") -> Ground:
    config = compose([f"task={task}", *words])
    return build_ground(typed(config, TASKS.load(task).settings).ground)


def height(ground: Ground, x: float, z: float) -> float:
    return float(ground.height(torch.tensor([x, z], dtype=torch.float64)))


@pytest.mark.parametrize("task", ["edit", "path", "navigate"])
def test_ground_is_flat_unless_chosen(task: str) -> None:
    assert ground_of(task=task).flat
    assert not ground_of("ground=slope", task=task).flat


def test_every_kind_has_a_file_of_its_name() -> None:
    assert set(files_of("ground")) == set(GROUNDS)
    for name in GROUNDS:
        assert compose(["task=edit", f"ground={name}"]).ground.kind == name


def test_a_slope_is_as_its_settings_say() -> None:
    ground = ground_of("ground=slope", "ground.angle=10", "ground.heading=90", "ground.start=[1,0]", "ground.length=2")
    rise = math.tan(math.radians(10.0))
    assert [height(ground, x, 7.0) for x in (0.0, 2.0, 9.0)] == pytest.approx([0.0, rise, 2.0 * rise])


def test_stairs_are_as_their_settings_say() -> None:
    ground = ground_of("ground=stairs", "ground.steps=2", "ground.start=[0,0]")
    assert [height(ground, 0.0, z) for z in (-0.1, 0.1, 0.4, 9.0)] == pytest.approx([0.0, 0.17, 0.34, 0.34])


def test_a_map_is_as_its_file_says(tmp_path: Path) -> None:
    (tmp_path / "map.csv").write_text("4,3\n2,1\n")
    words = ("ground.cell=0.5", "ground.origin=[1,2]", "ground.scale=0.1")
    ground = ground_of("ground=map", f"ground.file={tmp_path / 'map.csv'}", *words)
    at = [height(ground, x, z) for x, z in ((1.0, 2.0), (1.5, 2.0), (1.0, 2.5), (1.5, 2.5), (1.25, 2.25))]
    assert at == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.25])


def test_polygons_are_as_their_settings_say() -> None:
    ramp = "{outline: [[2,0],[4,0],[4,2],[2,2]], corners: [[2,0.2,0],[4,0,0],[2,0.2,1]]}"
    ground = ground_of(
        "ground=polygons", f"ground.patches=[{{outline: [[0,0],[2,0],[2,2],[0,2]], height: 0.2}}, {ramp}]"
    )
    assert [height(ground, x, 1.0) for x in (-1.0, 1.0, 3.0, 5.0)] == pytest.approx([0.0, 0.2, 0.1, 0.0])


def test_what_is_left_out_is_as_in_the_files() -> None:
    ours = build_ground({"kind": "stairs", "steps": 3})
    theirs = ground_of("ground=stairs", "ground.steps=3")
    place = torch.rand(50, 2, dtype=torch.float64) * 3.0
    assert torch.equal(ours.height(place), theirs.height(place))


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({}, "Unknown ground.kind 'None': choose one of flat, map, polygons, slope, stairs."),
        ({"kind": "hill"}, "Unknown ground.kind 'hill'"),
        ({"kind": "flat", "angle": 3}, "Unknown setting of ground flat 'angle': choose one of kind."),
        ({"kind": "slope", "angle": -20.1}, "ground.angle must lie between -20 and 20 degrees, not -20.1."),
        ({"kind": "slope", "angle": math.nan}, "ground.angle must lie between"),
        ({"kind": "slope", "heading": math.inf}, "ground.heading must be a finite number of degrees, not inf."),
        ({"kind": "slope", "length": 0}, "ground.length must be a number of metres above 0, or null, not 0."),
        ({"kind": "slope", "start": [1]}, "ground.start must be two finite numbers [x, z], not [1]."),
        ({"kind": "slope", "start": [1, "a"]}, "ground.start must be two finite numbers [x, z]"),
        ({"kind": "slope", "start": [1, math.nan]}, "ground.start must be two finite numbers [x, z]"),
        ({"kind": "stairs", "rise": 0}, "ground.rise must lie between -0.3 and 0.3 m and not be 0."),
        ({"kind": "stairs", "rise": 1}, "ground.rise must lie between -0.3 and 0.3 m"),
        ({"kind": "stairs", "run": 0.1}, "ground.run must be 0.15 m or more, not 0.1."),
        ({"kind": "stairs", "run": math.inf}, "ground.run must be"),
        ({"kind": "stairs", "steps": 0}, "ground.steps must be from 1 to 1000, not 0."),
        ({"kind": "stairs", "steps": 1.5}, "ground.steps must be a whole number, not '1.5'."),
        ({"kind": "map"}, "ground=map needs ground.file"),
        ({"kind": "map", "file": "x.png", "cell": 0}, "ground.cell must be a number of metres above 0, not 0."),
        ({"kind": "map", "file": "x.png", "scale": math.inf}, "ground.scale must be a finite number"),
        ({"kind": "map", "file": "none.csv"}, "ground.file: cannot read none.csv"),
        ({"kind": "polygons"}, "ground=polygons needs ground.patches="),
    ],
)
def test_a_mistake_is_told_in_one_sentence(settings: dict[str, Any], says: str) -> None:
    with pytest.raises(HopdiffError) as error:
        build_ground(settings)
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("patch", "says"),
    [
        (3, "must be {outline: [[x, z], ...], height: METRES}, not 3."),
        ({"outline": SQUARE, "hight": 1}, "has an unknown entry 'hight'. Did you mean 'height'?"),
        ({"height": 1}, ".outline must be three or more places [x, z], not None."),
        ({"outline": SQUARE[:2], "height": 1}, ".outline must be three or more places"),
        ({"outline": [*SQUARE, [1]], "height": 1}, ".outline must be three or more places"),
        ({"outline": [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], "height": 1}, ".outline crosses or touches itself."),
        ({"outline": [[0, 0], [1, 1], [2, 2]], "height": 1}, ".outline"),
        ({"outline": SQUARE}, "needs either height or corners."),
        ({"outline": SQUARE, "height": 1, "corners": [[0, 0, 0]] * 3}, "needs either height or corners."),
        ({"outline": SQUARE, "height": math.nan}, ".height must be a finite number of metres, not nan."),
        ({"outline": SQUARE, "corners": [[0, 0, 0]]}, ".corners must be three places [x, height, z]"),
        ({"outline": SQUARE, "corners": [[0, 0, 0], [1, 0, 1], [2, 1, 2]]}, ".corners must not lie on one line."),
        ({"outline": SQUARE, "corners": [[0, 0, 0], [1, 1, 0], [0, 0, 1]]}, "is steeper than 20 degrees: 45.0."),
    ],
)
def test_a_mistake_in_a_patch_names_it(patch: Any, says: str) -> None:
    with pytest.raises(HopdiffError) as error:
        build_ground({"kind": "polygons", "patches": [{"outline": SQUARE, "height": 0.1}, patch]})
    assert str(error.value).startswith("ground.patches[1]")
    assert says in str(error.value)
