from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from hopdiff.graph.scene import Passage, Place, Scene, Wall, check_scene
from hopdiff.graph.scene_file import read_scene, scene_of
from hopdiff.types import HopdiffError

SCENES = Path(__file__).resolve().parents[2] / "conf" / "scenes"
SQUARES = """\
name: squares
wall_thickness: 0.2
rooms:
  a: [[0, 0], [4, 0], [4, 3], [0, 3]]
  b: [[0, 4], [4, 4], [4, 7], [0, 7]]
passages:
  door: {between: [a, b], from: [2, 3], to: [2, 4], width: 1.0}
walls:
  screen: {from: [0, 1.5], to: [1, 1.5], thickness: 0.1}
furniture:
  box: [[3, 5], [4, 5], [4, 6], [3, 6]]
places:
  start: {position: [1, 1], heading: 90}
"""


def changed(old: str, new: str) -> str:
    assert old in SQUARES
    return SQUARES.replace(old, new)


def read(tmp_path: Path, text: str) -> Scene:
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    return read_scene(tmp_path / "scene.yaml")


def test_a_scene_file_holds_what_it_says(tmp_path: Path) -> None:
    scene = read(tmp_path, SQUARES)
    assert (scene.name, scene.thickness) == ("squares", 0.2)
    np.testing.assert_array_equal(scene.rooms["a"], [[0, 0], [4, 0], [4, 3], [0, 3]])
    assert scene.passages == {"door": Passage(("a", "b"), (2.0, 3.0), (2.0, 4.0), 1.0)}
    assert scene.walls == {"screen": Wall((0.0, 1.5), (1.0, 1.5), 0.1)}
    assert scene.place("start") == Place((1.0, 1.0), math.pi / 2.0)
    assert scene.floor().area == pytest.approx(12 + 12 + 1, abs=1e-4)
    assert scene.free().area == pytest.approx(12 + 12 + 1 - 1 - 0.1, abs=1e-4)
    assert scene.free().geom_type == "Polygon"


GROUND = """\
ground:
  kind: polygons
  patches:
    - {outline: b, height: 0.17}
    - {outline: door, height: 0.1}
    - {outline: [[0, 0], [1, 0], [1, 1]], height: 0.05}
"""


def test_what_feet_stand_on_may_be_told_by_the_names_of_rooms(tmp_path: Path) -> None:
    assert read(tmp_path, SQUARES).ground == {}
    assert read(tmp_path, f"{SQUARES}ground:\n").ground == {}
    assert read(tmp_path, f"{SQUARES}ground: {{kind: slope, angle: 5}}\n").ground == {"kind": "slope", "angle": 5}
    ground = read(tmp_path, SQUARES + GROUND).ground
    assert [patch["height"] for patch in ground["patches"]] == [0.17, 0.1, 0.05]
    room, door, own = (patch["outline"] for patch in ground["patches"])
    assert room == [[0, 4], [4, 4], [4, 7], [0, 7]]
    assert own == [[0, 0], [1, 0], [1, 1]]
    assert np.ptp(np.array(door), axis=0) == pytest.approx([1.0, 1.0], abs=1e-5)
    with pytest.raises(HopdiffError, match=r"scene.yaml, line 16: ground.patches: there is no 'bb' in the scene"):
        read(tmp_path, SQUARES + GROUND.replace("outline: b,", "outline: bb,"))
    with pytest.raises(HopdiffError, match=r"scene.yaml, line 14: ground must have named entries, not 3"):
        read(tmp_path, f"{SQUARES}ground: 3\n")


def test_the_name_of_a_scene_is_that_of_its_file_by_default(tmp_path: Path) -> None:
    assert read(tmp_path, changed("name: squares\n", "")).name == "scene"
    assert scene_of(yaml.safe_load(changed("name: squares\n", ""))).name == "scene"


@pytest.mark.parametrize(("name", "rooms", "free"), [("two_rooms", 2, 36 + 1.2 - 0.25 - 2.8), ("flat", 5, 76.305)])
def test_shipped_scenes_are_whole(name: str, rooms: int, free: float) -> None:
    scene = read_scene(SCENES / f"{name}.yaml")
    assert scene.name == name
    assert len(scene.rooms) == rooms
    assert scene.free().area == pytest.approx(free, abs=1e-3)
    assert scene.free().buffer(-0.25).geom_type == "Polygon"
    assert {"start", "goal"} <= set(scene.places)


WRONG = [
    ("rooms:\n", "room:\n", "line 3: a scene has an unknown entry 'room': .*Did you mean 'rooms'"),
    ("width: 1.0", "width: 1.0, high: 2", "line 7: passages.door has an unknown entry 'high'"),
    (", width: 1.0", "", "line 7: passages.door needs the entry 'width'"),
    (", thickness: 0.1", "", "line 9: walls.screen needs the entry 'thickness'"),
    (", heading: 90", "", "line 13: places.start needs the entry 'heading'"),
    ("heading: 90", "heading: north", "line 13: places.start.heading must be made of finite numbers, not 'north'"),
    ("heading: 90", "heading: .nan", "line 13: places.start.heading must be made of finite numbers, not nan"),
    ("heading: 90", "heading: true", "line 13: places.start.heading must be made of finite numbers, not True"),
    ("position: [1, 1]", "position: [1]", r"line 13: places.start.position: a point must be \[x, z\] in metres"),
    ("position: [1, 1]", "position: 1", r"line 13: places.start.position: a point must be \[x, z\] in metres, not 1"),
    ("[[3, 5], [4, 5], [4, 6], [3, 6]]", "[[3, 5], [4, 5]]", "line 11: furniture.box needs at least 3 corners, not 2"),
    ("[[3, 5], [4, 5], [4, 6], [3, 6]]", "[]", "line 11: furniture.box needs at least 3 corners, not 0"),
    ("[[3, 5], [4, 5], [4, 6], [3, 6]]", "big", "line 11: furniture.box must be a list of points"),
    (
        "[[3, 5], [4, 5], [4, 6], [3, 6]]",
        "[[3, 5], [4, 6], [4, 5], [3, 6]]",
        "line 11: the outline of furniture.box crosses or touches itself",
    ),
    ("[[3, 5], [4, 5], [4, 6], [3, 6]]", "[[3, 5], [4, 5], [3.5, 5]]", "line 11: the outline of furniture.box"),
    ("[[3, 5], [4, 5], [4, 6], [3, 6]]", "[[9, 9], [10, 9], [9, 10]]", "line 11: furniture.box stands on no room"),
    ("from: [0, 1.5], to: [1, 1.5]", "from: [9, 9], to: [9, 8]", "line 9: walls.screen stands on no room"),
    ("from: [0, 1.5], to: [1, 1.5]", "from: [1, 1], to: [1, 1]", "line 9: walls.screen starts and ends at the same"),
    ("thickness: 0.1", "thickness: 0", "line 9: walls.screen.thickness must be a number of metres above 0, not 0"),
    ("width: 1.0", "width: -1", "line 7: passages.door.width must be a number of metres above 0, not -1"),
    ("between: [a, b]", "between: [a, c]", "line 7: passages.door joins 'c', which is no room"),
    ("between: [a, b]", "between: [a, a]", "line 7: passages.door must join two different rooms"),
    ("between: [a, b]", "between: a", "line 7: passages.door.between must name two rooms, not 'a'"),
    ("to: [2, 4]", "to: [2, 3.8]", r"line 7: passages.door does not open into 'b' over its whole width at \[2, 3.8\]"),
    ("from: [2, 3], to: [2, 4]", "from: [0.3, 3], to: [0.3, 4]", "line 7: passages.door does not open into 'a'"),
    ("between: [a, b], from: [2, 3], to: [2, 4]", "between: [b, a], from: [2, 3], to: [2, 4]", "line 7: .* into 'b'"),
    ("[[0, 4], [4, 4], [4, 7], [0, 7]]", "[[0, 2], [4, 2], [4, 7], [0, 7]]", "line 5: rooms.b overlaps rooms.a"),
    ("  b: [[0, 4]", "  a: [[0, 4]", "line 5: rooms.a was already given in line 4"),
    ("  b: [[0, 4]", "  7: [[0, 4]", "rooms: the name 7 must be text"),
    ("wall_thickness: 0.2", "wall_thickness: -1", "line 2: wall_thickness must be 0 or more metres, not -1"),
    ("wall_thickness: 0.2", "wall_thickness: thin", "line 2: wall_thickness must be made of finite numbers"),
    ("name: squares", "name: [1]", "line 1: name must be text"),
    ("  door: {between", "  door: {between: [", "line 7: not YAML"),
    ("  box: [[3, 5], [4, 5], [4, 6], [3, 6]]", "  - [3, 5]", "line 10: furniture must have named entries"),
    ("walls:\n  screen:", "walls:\n  screen: 3 #", "line 9: walls.screen must have entries from, to, thickness, not 3"),
    (
        "position: [1, 1], heading: 90}",
        "&p position: [1, 1], heading: *p}",
        "line 13: a scene file must not use YAML aliases",
    ),
]


@pytest.mark.parametrize(("old", "new", "said"), WRONG)
def test_what_is_wrong_in_a_scene_file_is_told_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(HopdiffError, match=said) as told:
        read(tmp_path, changed(old, new))
    assert "scene.yaml" in str(told.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a scene must have entries name, wall_thickness, rooms"),
        ("- 1\n- 2\n", "a scene must have entries"),
        ("name: x\n", "a scene needs the entry 'rooms'"),
        ("rooms: {}\n", "line 1: the scene scene has no rooms"),
        ("rooms: 3\n", "line 1: rooms must have named entries, not 3"),
        ("rooms: {a: [[0, 0], [1, 0], [1, .inf]]}\n", "line 1: rooms.a must be made of finite numbers"),
        ("rooms:\n\tx: 1\n", "line 2: not YAML"),
        ("a: !!python/object:os.system x\n", "line 1: not YAML"),
        ("\x00", "not YAML"),
        ("{" * 5000, "not a sensible scene file"),
        ("a: 1\n---\nb: 2\n", "not YAML"),
        ("rooms: {a: 2026-99-99}\n", "not a sensible scene file"),
    ],
)
def test_files_that_are_no_scenes_are_told(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(HopdiffError, match=said):
        read(tmp_path, text)


def test_a_scene_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match=r"cannot read .*nowhere\.yaml"):
        read_scene(tmp_path / "nowhere.yaml")


def test_scenes_from_settings_are_told_by_entry_and_not_by_line() -> None:
    data = yaml.safe_load(changed("width: 1.0", "width: 0"))
    with pytest.raises(HopdiffError, match=r"^scene: passages.door.width must be"):
        scene_of(data)


def test_a_place_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    scene = read(tmp_path, SQUARES)
    with pytest.raises(HopdiffError, match=r"scene squares has no place 'stat': it has start\. Did you mean 'start'"):
        scene.place("stat")
    with pytest.raises(HopdiffError, match="it has none"):
        Scene("bare", scene.rooms).place("start")


def test_a_door_may_not_run_through_a_third_room(tmp_path: Path) -> None:
    text = changed("  b: [[0, 4]", "  c: [[1, 3.2], [3, 3.2], [3, 3.8], [1, 3.8]]\n  b: [[0, 4]")
    with pytest.raises(HopdiffError, match=r"line 8: passages\.door runs through 'c'"):
        read(tmp_path, text)


@pytest.mark.parametrize("numbers", [[[0, 0], [1, 0], [math.nan, 1]], [1.0, 2.0], [[0, 0, 0], [1, 0, 0], [1, 1, 1]]])
def test_scenes_made_in_python_are_checked_too(numbers: list) -> None:
    with pytest.raises(HopdiffError, match=r"^rooms\.a"):
        check_scene(Scene("odd", {"a": np.array(numbers)}))


@settings(max_examples=300, deadline=None)
@given(
    start=st.integers(0, len(SQUARES)),
    length=st.integers(0, 40),
    new=st.text(alphabet="[]{}:,.-#&*!|>'\"\n\t 09abz\x00é", max_size=8),
)
def test_damaged_files_give_a_scene_or_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, start: int, length: int, new: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.yaml"
    path.write_text(SQUARES[:start] + new + SQUARES[start + length :], encoding="utf-8")
    try:
        scene = read_scene(path)
    except HopdiffError as error:
        assert str(path) in str(error)  # noqa: PT017
        assert "\n" not in str(error)  # noqa: PT017
    else:
        assert scene.floor().area > 0
