"""Bodies below a root that does not carry them: read as their hips go, edited, and given back to the channels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hopdiff.editing.leg_joints import facing, find_legs
from hopdiff.editing.root_path import root_path
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.bvh import BvhFile, read_bvh, write_bvh
from hopdiff.types import HopdiffError
from tests.io.bvh_files import simple_positions
from tests.people import file_of

PLACES = "Xposition Yposition Zposition"
TURNS = "Zrotation Yrotation Xrotation"
Rows = NDArray[np.float64]
Below = tuple[list[tuple[str, str, Rows]], str, Rows]


def walk(folder: Path) -> tuple[str, Rows]:
    """The file of a walk in centimetres whose hips are its root: text and rows."""
    text = file_of("walk with a turn", folder, 100.0).read_text()
    assert f"CHANNELS 6 {PLACES} {TURNS}" in text
    return text, rows_of(text)


def rows_of(text: str) -> Rows:
    return np.array([line.split() for line in text.split("Frame Time:")[1].splitlines()[1:]], float)


def angles(turn: Rotation) -> Rows:
    return np.asarray(turn.as_euler("ZYX", degrees=True))


def below(folder: Path, build: Callable[[Rows, Rotation], Below], text: str | None = None) -> str:
    """The walk, or another file, with joints above its hips.

    build: of places and turns of the hips, the joints above with their name, channels and columns, and the channels and
    columns of the hips.
    """
    text, rows = walk(folder) if text is None else (text, rows_of(text))
    above, channels, hips = build(rows[:, :3], Rotation.from_euler("ZYX", rows[:, 3:6], degrees=True))
    lines = text.splitlines()
    assert lines[1] == "ROOT Hips"
    head = ["HIERARCHY"]
    for k, (name, own, _) in enumerate(above):
        head += [f"{'JOINT' if k else 'ROOT'} {name}", "{", "OFFSET 0 0 0", f"CHANNELS {len(own.split())} {own}"]
    start = next(k for k, line in enumerate(lines) if line.strip() == "MOTION")
    body = ["JOINT Hips", "{", "OFFSET 0 0 0", f"CHANNELS {len(channels.split())} {channels}", *lines[5:start]]
    numbers = np.concatenate([*(own for _, _, own in above), hips, rows[:, 6:]], axis=1)
    table = [" ".join(f"{number:.9f}" for number in row) for row in numbers]
    return "\n".join([*head, *body, *["}"] * len(above), *lines[start : start + 3], *table, ""])


def fixed(count: int, *values: float) -> Rows:
    return np.tile(np.array(values, float), (count, 1))


def still(place: Rows, turn: Rotation) -> Below:
    return [("Root", f"{PLACES} {TURNS}", fixed(len(place), *[0.0] * 6))], f"{PLACES} {TURNS}", together(place, turn)


def together(place: Rows, turn: Rotation) -> Rows:
    return np.concatenate([place, angles(turn)], axis=1)


def without_channels(place: Rows, turn: Rotation) -> Below:
    return [("Armature", "", fixed(len(place)))], f"{PLACES} {TURNS}", together(place, turn)


def three_above(place: Rows, turn: Rotation) -> Below:
    above = [
        ("World", "", fixed(len(place))),
        ("Reference", f"{PLACES} {TURNS}", fixed(len(place), 10.0, 0.0, -20.0, 0.0, 30.0, 0.0)),
        ("Offset", TURNS, fixed(len(place), 0.0, -75.0, 0.0)),
    ]
    base = Rotation.from_euler("Y", 30.0, degrees=True)
    world = base * Rotation.from_euler("Y", -75.0, degrees=True)
    local = world.inv().apply(place - np.array([10.0, 0.0, -20.0]))
    return above, f"{PLACES} {TURNS}", together(local, world.inv() * turn)


def bobbing(place: Rows, turn: Rotation) -> Below:
    height = 5.0 * np.sin(np.arange(len(place)) / 3.0)
    up = np.stack([0.0 * height, height, 0.0 * height], axis=1)
    root = np.concatenate([up, fixed(len(place), 0.0, 0.0, 0.0)], axis=1)
    return [("Root", f"{PLACES} {TURNS}", root)], f"{PLACES} {TURNS}", together(place - up, turn)


def turning_on_the_spot(place: Rows, turn: Rotation) -> Below:
    yaw = 20.0 * np.sin(np.arange(len(place)) / 5.0)
    own = Rotation.from_euler("Y", yaw[:, None], degrees=True)
    root = together(0.0 * place, own)
    return (
        [("Root", f"{PLACES} {TURNS}", root)],
        f"{PLACES} {TURNS}",
        together(own.inv().apply(place), own.inv() * turn),
    )


def tipped(place: Rows, turn: Rotation) -> Below:
    """Everything below the root lies along z until the root turns it upright; hips that are turned back there."""
    raised = Rotation.from_euler("X", -90.0, degrees=True)
    root = fixed(len(place), 0.0, 0.0, 0.0, 0.0, 0.0, -90.0)
    hips = together(raised.inv().apply(place), raised.inv() * turn)
    return [("Root", f"{PLACES} {TURNS}", root)], f"{PLACES} {TURNS}", hips


def way_and_turn_apart(place: Rows, turn: Rotation) -> Below:
    return [("Trajectory", PLACES, place)], TURNS, angles(turn)


def a_root_that_does_not_turn(place: Rows, turn: Rotation) -> Below:
    root = np.concatenate([place, fixed(len(place), 0.0, 0.0, 0.0)], axis=1)
    return [("Trajectory", f"{PLACES} {TURNS}", root)], TURNS, angles(turn)


def height_apart(place: Rows, turn: Rotation) -> Below:
    hips = np.concatenate([place[:, 1:2], angles(turn)], axis=1)
    return [("Root", "Xposition Zposition", place[:, [0, 2]])], f"Yposition {TURNS}", hips


ABOVE: dict[str, Callable[[Rows, Rotation], Below]] = {
    "a root that stands still": still,
    "a root without channels": without_channels,
    "three joints above": three_above,
    "a root that moves up and down": bobbing,
    "a root that turns where it stands": turning_on_the_spot,
    "a root that raises the body": tipped,
    "way and turn apart": way_and_turn_apart,
    "a root that does not turn": a_root_that_does_not_turn,
    "height apart": height_apart,
}


def read(folder: Path, name: str) -> tuple[BvhFile, str]:
    text = below(folder, ABOVE[name])
    (folder / "below.bvh").write_text(text)
    return read_bvh(folder / "below.bvh"), text


def led(clip: Clip, degrees: float = 70.0) -> Clip:
    """The clip turned about the vertical and moved, ever further."""
    share = torch.linspace(0.0, 1.0, clip.frames, dtype=torch.float64)
    turn = axis_rotation("Y", math.radians(degrees) * share)
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    place = (turn @ clip.root_position[..., None])[..., 0] + share[:, None] * torch.tensor([1.5, -0.02, 0.5]).double()
    return replace(clip, root_position=place, rotations=rotations)


@pytest.mark.parametrize("name", ABOVE)
def test_the_way_is_that_of_the_hips(tmp_path: Path, name: str) -> None:
    file, text = read(tmp_path, name)
    names, known, _ = simple_positions(text)
    clip = file.clip()
    assert clip.skeleton.names[0] == "Hips"
    assert clip.skeleton.names == tuple(names[names.index("Hips") :])
    assert file.unit == 0.01
    found = 100.0 * clip.joint_positions().numpy()
    np.testing.assert_allclose(found, known[:, names.index("Hips") :], atol=1e-6)
    assert len(file.notes) == 1
    assert "'Hips'" in file.notes[0]
    # Headings are those of the walk itself.
    plain = read_bvh(file_of("walk with a turn", tmp_path, 100.0)).clip()
    for one in (plain, clip):
        legs = find_legs(one.skeleton)
        assert len(legs) == 2
    yaws = [root_path(one, facing(one.skeleton, find_legs(one.skeleton))).yaw for one in (plain, clip)]
    apart = yaws[0] - yaws[1]
    assert float(torch.sin(apart).abs().max()) < 1e-6
    assert float(torch.cos(apart).min()) > 0.99


@pytest.mark.parametrize("name", ABOVE)
def test_the_body_stands_at_rest(tmp_path: Path, name: str) -> None:
    """Exports build bodies on the rest pose."""
    file, _ = read(tmp_path, name)
    body = file.clip().skeleton
    assert body.names == file.skeleton().names
    straight = torch.eye(3, dtype=torch.float64).expand(len(body.names), 3, 3)
    places = body.forward(body.offsets[0], straight)[0]
    high, low = (float(places[body.index(joint), 1]) for joint in ("Head", "LeftFoot"))
    assert high - low > 1.2


def test_a_body_along_z_below_a_root_that_raises_it_stands_at_rest(tmp_path: Path) -> None:
    plain = read_bvh(file_of("walk with a turn", tmp_path, 100.0)).clip()
    write_bvh(tmp_path / "z.bvh", plain, order="ZYX", unit=100.0, up="z")

    def build(place: Rows, turn: Rotation) -> Below:
        return [("Root", TURNS, fixed(len(place), 0.0, 0.0, -90.0))], f"{PLACES} {TURNS}", together(place, turn)

    (tmp_path / "a.bvh").write_text(below(tmp_path, build, (tmp_path / "z.bvh").read_text()))
    file = read_bvh(tmp_path / "a.bvh")
    assert file.up == "y"
    clip = file.clip()
    order = [clip.skeleton.index(name) for name in plain.skeleton.names]
    torch.testing.assert_close(clip.joint_positions()[:, order], plain.joint_positions(), atol=1e-6, rtol=0)
    torch.testing.assert_close(clip.skeleton.offsets[order][1:], plain.skeleton.offsets[1:], atol=1e-6, rtol=0)
    ends = clip.end_positions()
    for name, place in plain.end_positions().items():
        torch.testing.assert_close(ends[name], place, atol=1e-6, rtol=0)
    edited = led(clip)
    again = file.with_motion(edited)
    torch.testing.assert_close(again.clip().joint_positions(), edited.joint_positions(), atol=1e-6, rtol=0)
    assert torch.equal(file.with_motion(clip).values, file.values)


@pytest.mark.parametrize("name", ABOVE)
def test_an_unedited_file_keeps_its_numbers(tmp_path: Path, name: str) -> None:
    file, _ = read(tmp_path, name)
    again = file.with_motion(file.clip())
    assert torch.equal(again.values, file.values)


@pytest.mark.parametrize("name", ABOVE)
@pytest.mark.parametrize("frames", [None, 5, 90])
def test_an_edit_is_given_back_to_the_channels_that_there_are(tmp_path: Path, name: str, frames: int | None) -> None:
    file, text = read(tmp_path, name)
    clip = file.clip()
    if frames is not None:
        index = torch.arange(frames) % clip.frames
        clip = replace(
            clip,
            root_position=clip.root_position[index],
            rotations=clip.rotations[index],
            offsets=None if clip.offsets is None else clip.offsets[index],
        )
    edited = led(clip)
    file.with_motion(edited).write(tmp_path / "edited.bvh")
    written = (tmp_path / "edited.bvh").read_text()
    names, found, _ = simple_positions(written)
    # All joints and channels are there again.
    assert names == simple_positions(text)[0]
    assert [line.strip() for line in written.splitlines() if "CHANNELS" in line] == [
        line.strip() for line in text.splitlines() if "CHANNELS" in line
    ]
    np.testing.assert_allclose(found[:, names.index("Hips") :] / 100.0, edited.joint_positions().numpy(), atol=1e-6)
    again = read_bvh(tmp_path / "edited.bvh")
    torch.testing.assert_close(again.clip().joint_positions(), edited.joint_positions(), atol=1e-6, rtol=0)


def test_joints_above_stay_as_they_are_where_the_hips_can_go_alone(tmp_path: Path) -> None:
    for name, columns in (("a root that stands still", 6), ("three joints above", 9)):
        file, _ = read(tmp_path, name)
        edited = file.with_motion(led(file.clip()))
        assert torch.equal(edited.values[:, :columns], file.values[:, :columns])
        assert not torch.equal(edited.values[-1, columns : columns + 6], file.values[-1, columns : columns + 6])
    # In another number of frames as they are in the first.
    file, _ = read(tmp_path, "a root that turns where it stands")
    clip = file.clip()
    shorter = replace(clip, root_position=clip.root_position[4:9], rotations=clip.rotations[4:9])
    assert torch.equal(file.with_motion(shorter).values[:, :6], file.values[:1, :6].expand(5, -1))


def test_hips_that_cannot_turn_are_turned_by_what_they_hang_on(tmp_path: Path) -> None:
    def build(place: Rows, turn: Rotation) -> Below:
        return [("Root", TURNS, fixed(len(place), 0.0, 0.0, 0.0))], PLACES, place

    text = below(tmp_path, build)
    (tmp_path / "a.bvh").write_text(text)
    file = read_bvh(tmp_path / "a.bvh")
    assert file.clip().skeleton.names[0] == "Hips"
    edited = led(file.clip())
    file.with_motion(edited).write(tmp_path / "b.bvh")
    names, found, _ = simple_positions((tmp_path / "b.bvh").read_text())
    np.testing.assert_allclose(found[:, 1:] / 100.0, edited.joint_positions().numpy(), atol=1e-6)
    assert names[0] == "Root"


def test_what_no_channel_allows_is_refused(tmp_path: Path) -> None:
    def build(place: Rows, turn: Rotation) -> Below:
        return [("Root", "Xposition Zposition", place[:, [0, 2]])], TURNS, angles(turn)

    (tmp_path / "a.bvh").write_text(below(tmp_path, build))
    file = read_bvh(tmp_path / "a.bvh")
    clip = file.clip()
    with pytest.raises(HopdiffError, match="'Root' has no channel Yposition, so it cannot be moved as frame 0 needs"):
        file.with_motion(replace(clip, root_position=clip.root_position + torch.tensor([0.0, 0.1, 0.0])))


def test_a_root_that_carries_the_body_is_left_so(tmp_path: Path) -> None:
    """Root motion: a joint on the ground goes and turns with the body, hips sway over it."""

    def build(place: Rows, turn: Rotation) -> Below:
        ground = place * np.array([1.0, 0.0, 1.0])
        yaw = Rotation.from_euler("Y", angles(turn)[:, [1]], degrees=True)
        root = np.concatenate([ground, angles(yaw)], axis=1)
        hips = together(yaw.inv().apply(place - ground), yaw.inv() * turn)
        return [("Root", f"{PLACES} {TURNS}", root)], f"{PLACES} {TURNS}", hips

    (tmp_path / "a.bvh").write_text(below(tmp_path, build))
    file = read_bvh(tmp_path / "a.bvh")
    assert (file.carrier, file.notes) == (0, ())


@pytest.mark.parametrize(
    ("aside", "channels", "carrier"),
    [(0.0, f"{PLACES} {TURNS}", 0), (90.0, f"{PLACES} {TURNS}", 1), (0.0, PLACES, 1)],
)
def test_a_root_that_goes_straight_leads_hips_that_sway_but_not_hips_that_face_elsewhere(
    tmp_path: Path, aside: float, channels: str, carrier: int
) -> None:
    """Nor hips that alone can turn."""

    def build(place: Rows, turn: Rotation) -> Below:
        share = np.arange(len(place))
        way = np.stack([2.0 * share, 0.0 * share, 0.0 * share], axis=1)
        sway = np.stack([0.0 * share, 0.0 * share + 90.0, 2.0 * np.sin(share)], axis=1)
        root = np.concatenate([way, fixed(len(place), 0.0, 0.0, 0.0)], axis=1)[:, : len(channels.split())]
        hips = np.concatenate([sway, fixed(len(place), 0.0, aside, 0.0) + 5.0 * np.sin(share)[:, None]], axis=1)
        return [("Root", channels, root)], f"{PLACES} {TURNS}", hips

    (tmp_path / "a.bvh").write_text(below(tmp_path, build))
    assert read_bvh(tmp_path / "a.bvh").carrier == carrier


def test_what_else_hangs_on_the_root_is_left_and_told(tmp_path: Path) -> None:
    text = below(tmp_path, still)
    head, rows = text.split("MOTION")
    prop = "JOINT Camera\n{\nOFFSET 1 2 3\nCHANNELS 1 Yrotation\n}\n}\n"
    head = head.rstrip().removesuffix("}") + prop
    lines = rows.strip().splitlines()
    lines[2:] = [f"{line} {k}" for k, line in enumerate(lines[2:])]
    (tmp_path / "a.bvh").write_text(head + "MOTION\n" + "\n".join(lines) + "\n")
    file = read_bvh(tmp_path / "a.bvh")
    assert "Camera" not in file.clip().skeleton.names
    assert file.notes[0].endswith("1 moving joint beside it, 'Camera' first, stay as they are.")
    edited = file.with_motion(led(file.clip()))
    assert torch.equal(edited.values[:, -1], file.values[:, -1])


def test_one_pose_alone_is_carried_by_the_root_if_that_can_move(tmp_path: Path) -> None:
    """A body to put motions on."""
    for name, carrier in (("a root that stands still", 0), ("a root without channels", 1)):
        text = below(tmp_path, ABOVE[name])
        lines = text.splitlines()
        start = next(k for k, line in enumerate(lines) if line.startswith("Frames:"))
        (tmp_path / "a.bvh").write_text("\n".join([*lines[:start], "Frames: 1", *lines[start + 1 : start + 3], ""]))
        assert read_bvh(tmp_path / "a.bvh").carrier == carrier
