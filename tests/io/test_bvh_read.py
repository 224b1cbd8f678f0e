from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.bvh import BvhFile, read_bvh, write_bvh
from hopdiff.types import HopdiffError
from tests.builders import make_problem
from tests.io.bvh_files import FILES, MANY_ENDS, ORDERS_OF_ALL_KINDS, PLAIN, Z_UP, simple_positions
from tests.people import CAPTURED, file_of

CMU = 0.0254 / 0.45  # m in a unit of files made from those of Carnegie Mellon


def saved(folder: Path, text: str | bytes, name: str = "a.bvh") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def refused(path: Path) -> str:
    """What the user is told, the file's name left out."""
    with pytest.raises(HopdiffError) as caught:
        read_bvh(path)
    message = str(caught.value)
    assert str(path) in message
    assert "\n" not in message
    return message.replace(str(path), "FILE")


def assert_same_file(found: BvhFile, known: BvhFile) -> None:
    assert found.joints == known.joints
    assert torch.equal(found.values, known.values)
    assert found.frame_time == known.frame_time


def assert_positions(file: BvhFile, text: str, tolerance: float = 1e-9) -> None:
    names, known, _ = simple_positions(text)
    clip = file.clip()
    if file.up == "z":
        known = np.stack((known[..., 0], known[..., 2], -known[..., 1]), axis=-1)
    np.testing.assert_allclose(clip.joint_positions().numpy() / file.unit, known, atol=tolerance)
    assert [joint.name for joint in file.joints] == names


@pytest.mark.parametrize("name", FILES)
def test_joints_are_where_other_forward_kinematics_has_them(tmp_path: Path, name: str) -> None:
    assert_positions(read_bvh(saved(tmp_path, FILES[name])), FILES[name])


@pytest.mark.parametrize("name", [name for name in FILES if name != "z up"])
def test_end_sites_are_where_other_forward_kinematics_has_them(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, FILES[name]), unit=1, up="y")
    positions, orientations = file.clip().forward()
    found = [
        positions[:, at] + orientations[:, at] @ torch.tensor(end, dtype=torch.float64)
        for at, joint in enumerate(file.joints)
        for end in joint.end_sites
    ]
    # By the order of the joints here, by the order of the file there.
    known = simple_positions(FILES[name])[2]
    assert len(found) == len(known)
    for place in found:
        assert min(np.abs(place.numpy() - other).max() for other in known) < 1e-9
    firsts = {
        joint.name: positions[:, at] + orientations[:, at] @ torch.tensor(joint.end_sites[0], dtype=torch.float64)
        for at, joint in enumerate(file.joints)
        if joint.end_sites
    }
    ends = file.clip().end_positions()
    assert ends.keys() == firsts.keys()
    for joint, place in firsts.items():
        torch.testing.assert_close(ends[joint], place)


def swapped(*pairs: tuple[str, str]) -> str:
    text = PLAIN
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


HEAD, ROWS = PLAIN.split("Frame Time: 0.0333333\n")
WRITINGS: dict[str, str | bytes] = {
    "capital channels": re.sub(r"[XYZ](?:position|rotation)", lambda found: found.group().upper(), PLAIN),
    "small channels": re.sub(r"[XYZ](?:position|rotation)", lambda found: found.group().lower(), PLAIN),
    "short channels": PLAIN.replace("position", "pos").replace("rotation", "rot"),
    "channels with a line": PLAIN.replace("position", "_position").replace("rotation", "_Rotation"),
    "small keywords": re.sub(
        r"\b(?:HIERARCHY|ROOT|JOINT|OFFSET|CHANNELS|MOTION)\b", lambda m: m.group().lower(), PLAIN
    ),
    "odd keywords": swapped(("End Site", "END SITE"), ("Frames:", "FRAMES :"), ("Frame Time:", "frame time:")),
    "end sites in a word": swapped(("End Site", "EndSite")),
    "named end sites": swapped(("End Site", "End Site Tip of it")),
    "CRLF": PLAIN.replace("\n", "\r\n"),
    "CR": PLAIN.replace("\n", "\r"),
    "BOM": b"\xef\xbb\xbf" + PLAIN.encode(),
    "UTF-16": PLAIN.encode("utf-16"),
    "tabs": PLAIN.replace("  ", "\t").replace(" ", "\t").replace("End\tSite", "End Site").replace("e\tT", "e T"),
    "blanks": PLAIN.replace(" ", "   ").replace("\n", "  \n"),
    "blank lines": PLAIN.replace("\n", "\n\n \t\n"),
    "no line end": PLAIN.rstrip("\n"),
    "many line ends": "\n\n" + PLAIN + "\n\n\n",
    "braces on the line": re.sub(r"\n *\{", " {", PLAIN),
    "braces that touch": re.sub(r"\n *\{", "{", PLAIN).replace("}\n  }", "}}"),
    "a hierarchy on few lines": re.sub(r"\n *(?=[{}OC])", " ", HEAD) + "Frame Time: 0.0333333\n" + ROWS,
    "numbers below OFFSET": swapped(("OFFSET 9.5000 -4.0000", "OFFSET\n 9.5000\n -4.0000")),
    "channels on two lines": swapped(("Zposition Zrotation", "Zposition\n    Zrotation")),
    "no blank after the colon": swapped(("Frames: ", "Frames:"), ("Frame Time: ", "Frame Time:")),
    "no colon": swapped(("Frames:", "Frames"), ("Frame Time:", "FrameTime")),
    "powers of ten": swapped(("90.2500", "9.025E+01"), ("-42.0000", "-4.2e1"), ("0.0333333", "3.33333e-2")),
    "short numbers": re.sub(r"(\.\d*?)0+\b", r"\1", PLAIN).replace(" 0. ", " 0 ").replace(" 0.2", " .2"),
    "plus signs": swapped((" 4.0000", " +4.0000"), (" 9.5", " +9.5")),
    "a number a line": HEAD + "Frame Time: 0.0333333\n" + "\n".join(ROWS.split()),
    "a frame on two lines": HEAD + "Frame Time: 0.0333333\n" + ROWS.replace(" 11.0", "\n11.0").replace(" 9.0", "\n9.0"),
    "all frames on a line": HEAD + "Frame Time: 0.0333333\n" + " ".join(ROWS.split()),
    "seven numbers a line": HEAD
    + "Frame Time: 0.0333333\n"
    + "\n".join(" ".join(ROWS.split()[at : at + 7]) for at in range(0, 45, 7)),
    "comments": "# made by hand\n" + swapped(("MOTION\n", "// now\nMOTION\n; so many\n"), ("\n2.5", "\n# half\n2.5")),
}


@pytest.mark.parametrize("name", WRITINGS)
def test_other_writings_say_the_same(tmp_path: Path, name: str) -> None:
    known, found = read_bvh(saved(tmp_path, PLAIN)), read_bvh(saved(tmp_path, WRITINGS[name], "b.bvh"))
    plain = tuple(
        replace(joint, channels=plain.channels)
        for joint, plain in zip(found.joints, known.joints, strict=True)
        if len(joint.channels) == len(plain.channels)
    )
    assert_same_file(replace(found, joints=plain), known)
    torch.testing.assert_close(found.clip().joint_positions(), known.clip().joint_positions(), rtol=0, atol=0)


def test_the_file_is_kept_as_it_is(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, PLAIN))
    assert [joint.name for joint in file.joints] == ["Hips", "LeftLeg", "LeftFoot", "Head"]
    assert [joint.parent for joint in file.joints] == [-1, 0, 1, 0]
    assert file.joints[1].offset == (9.5, -4.0, 0.25)
    assert file.joints[1].channels == ("Zrotation", "Xrotation", "Yrotation")
    assert file.joints[2].end_sites == ((0.0, -45.0, 12.0),)
    assert file.values.shape == (3, 15)
    assert file.values[1, :3].tolist() == [2.5, 91.0, 4.0]
    assert (file.frames, file.frame_time, file.decimals, file.offset_decimals) == (3, 0.0333333, 4, 4)
    assert (file.unit, file.up) == (0.01, "y")
    clip = file.clip()
    assert clip.frame_time == 0.0333333
    torch.testing.assert_close(clip.root_position, file.values[:, :3] * 0.01)
    assert clip.offsets is None


@pytest.mark.parametrize(
    "name", ["mixamorig:Hips", "Left  Arm", "Bip01 L Thigh", "Hüfte", "腰", "a#1", "ROOT", "Motion"]
)
def test_names_stay_as_they_are(tmp_path: Path, name: str) -> None:
    text = PLAIN.replace("JOINT Head", f"JOINT {name}")
    file = read_bvh(saved(tmp_path, text))
    assert file.joints[3].name == name
    assert file.clip().skeleton.names[3] == name
    file.write(tmp_path / "b.bvh")
    assert_same_file(read_bvh(tmp_path / "b.bvh"), file)


def test_names_in_an_old_code_page_stay_byte_for_byte(tmp_path: Path) -> None:
    name = "Hüfte".encode("latin-1")
    file = read_bvh(saved(tmp_path, PLAIN.encode().replace(b"Hips", name)))
    file.write(tmp_path / "b.bvh")
    assert b"ROOT " + name + b"\n" in (tmp_path / "b.bvh").read_bytes()


def test_names_that_occur_twice_are_told_apart_in_the_clip_only(tmp_path: Path) -> None:
    text = PLAIN.replace("LeftLeg", "J").replace("LeftFoot", "J").replace("Head", "J_2")
    file = read_bvh(saved(tmp_path, text))
    assert [joint.name for joint in file.joints] == ["Hips", "J", "J", "J_2"]
    assert file.clip().skeleton.names == ("Hips", "J", "J_3", "J_2")
    assert set(file.clip().end_positions()) == {"J_3", "J_2"}
    file.with_motion(file.clip()).write(tmp_path / "b.bvh")
    assert_same_file(read_bvh(tmp_path / "b.bvh"), file)


@pytest.mark.parametrize(
    ("given", "metres"),
    [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("inch", 0.0254), ("cmu", 0.0254 / 0.45), (0.3, 0.3), ("0.3", 0.3)],
)
def test_the_unit_can_be_told(tmp_path: Path, given: float | str, metres: float) -> None:
    file = read_bvh(saved(tmp_path, PLAIN), unit=given)
    assert file.unit == metres
    torch.testing.assert_close(file.clip().root_position, file.values[:, :3] * metres)
    torch.testing.assert_close(file.skeleton().offsets[2], torch.tensor([0, -42, 1], dtype=torch.float64) * metres)


@pytest.mark.parametrize("unit", ["m", "cm", "mm", "inch", "cmu"])
@pytest.mark.parametrize("hips", [0.7, 0.9, 1.1])
@pytest.mark.parametrize("up", ["y", "z"])
def test_unit_and_axis_are_guessed(tmp_path: Path, unit: str, hips: float, up: str) -> None:
    """Bodies of three sizes, with the hips at the given height."""
    plain = read_bvh(saved(tmp_path, PLAIN))
    told = read_bvh(tmp_path / "a.bvh", unit=unit).unit
    size = hips / 0.91 * 0.01 / told

    def turned(place: tuple[float, ...]) -> tuple[float, float, float]:
        x, y, z = (size * value for value in place)
        return (x, y, z) if up == "y" else (x, -z, y)

    joints = tuple(
        replace(joint, offset=turned(joint.offset), end_sites=tuple(map(turned, joint.end_sites)))
        for joint in plain.joints
    )
    values = plain.values.clone()
    values[:, :3] = torch.tensor([turned(tuple(row)) for row in values[:, :3].tolist()])
    values[:, 3:] = 0.0
    replace(plain, joints=joints, values=values).write(tmp_path / "b.bvh")
    found = read_bvh(tmp_path / "b.bvh")
    assert (found.unit, found.up) == (told, up)


def test_a_body_raised_by_its_root_stands_along_y(tmp_path: Path) -> None:
    """Bones along z as a drawing program has them, turned upright in every frame."""
    text = Z_UP.replace("0.91  1 2 3", "0.91  -90 0 0").replace("0.92  2 3 4", "0.92  -90 0 0")
    file = read_bvh(saved(tmp_path, text))
    assert file.up == "y"
    assert_positions(file, text)


def test_the_axis_can_be_told(tmp_path: Path) -> None:
    assert read_bvh(saved(tmp_path, Z_UP)).up == "z"
    file = read_bvh(saved(tmp_path, Z_UP), up="Y", unit=1)
    assert file.up == "y"
    torch.testing.assert_close(file.clip().root_position, file.values[:, :3])


def test_a_body_with_z_up_stands_and_faces_as_all_others_do(tmp_path: Path) -> None:
    clip = read_bvh(saved(tmp_path, Z_UP)).clip()
    rest = clip.skeleton.offsets
    assert rest[1].tolist() == [0.1, -0.05, 0.0]
    torch.testing.assert_close(clip.skeleton.end_sites["Left Foot"][2], torch.tensor(0.15, dtype=torch.float64))
    torch.testing.assert_close(clip.root_position[1], torch.tensor([0.1, 0.92, 0.1], dtype=torch.float64))
    # The foot hangs below the hips in both frames.
    assert bool((clip.joint_positions()[:, 2, 1] < 0.2).all())


@pytest.mark.parametrize(("unit", "up"), [("feet", None), (0, None), (-1.0, None), (math.nan, None), (None, "x")])
def test_bad_units_and_axes_are_named(tmp_path: Path, unit: float | str | None, up: str | None) -> None:
    with pytest.raises(HopdiffError, match="unit must be" if up is None else "up must be"):
        read_bvh(saved(tmp_path, PLAIN), unit=unit, up=up)


@pytest.mark.parametrize("name", FILES)
def test_an_unedited_file_comes_back_with_the_same_numbers(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, FILES[name]))
    again = file.with_motion(file.clip())
    assert torch.equal(again.values, file.values)
    assert again.decimals == file.decimals
    again.write(tmp_path / "b.bvh")
    found = read_bvh(tmp_path / "b.bvh")
    assert_same_file(found, file)
    assert (found.decimals, found.unit, found.up) == (file.decimals, file.unit, file.up)


def test_the_plain_file_comes_back_letter_by_letter(tmp_path: Path) -> None:
    read_bvh(saved(tmp_path, PLAIN)).write(tmp_path / "b.bvh")
    assert (tmp_path / "b.bvh").read_text() == PLAIN


@pytest.mark.parametrize("number", ["1e-9", "123456789.0625", "0.1234567890123456789", "-7.1e-300", "1e8", "-0.0"])
def test_no_number_loses_anything(tmp_path: Path, number: str) -> None:
    text = PLAIN.replace("\n2.5000", f"\n{number}").replace("9.5000", number).replace("0.0333333", "1.23456789e-5")
    file = read_bvh(saved(tmp_path, text))
    assert file.values[1, 0] == float(number)
    file.write(tmp_path / "b.bvh")
    assert_same_file(read_bvh(tmp_path / "b.bvh"), file)


def yawed(file: BvhFile, degrees: float) -> BvhFile:
    """The motion turned about the vertical, ever further up to so many degrees in the last frame."""
    clip = file.clip()
    turn = axis_rotation("Y", torch.linspace(0.0, math.radians(degrees), clip.frames, dtype=torch.float64))
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    moved = (turn @ clip.root_position[..., None])[..., 0]
    edited = replace(clip, rotations=rotations, root_position=moved)
    result = file.with_motion(edited)
    error = (result.clip().joint_positions() - edited.joint_positions()).abs().max()
    assert float(error) < 1e-5 * file.unit
    return result


@pytest.mark.parametrize("name", ["plain", "orders of all kinds", "six channels everywhere", "z up"])
def test_an_edit_of_the_root_changes_the_root_only(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, FILES[name]))
    result = yawed(file, 50.0)
    assert torch.equal(result.values[:, 6:], file.values[:, 6:])
    assert torch.equal(result.values[0], file.values[0])
    assert not torch.equal(result.values[-1, :6], file.values[-1, :6])
    assert (result.joints, result.frame_time) == (file.joints, file.frame_time)
    result.write(tmp_path / "b.bvh")
    assert torch.equal(read_bvh(tmp_path / "b.bvh").values, result.values)


def test_one_channel_that_changes_leaves_its_neighbours_as_they_are(tmp_path: Path) -> None:
    """Yaw first, so that a turn about the vertical is one number."""
    file = read_bvh(saved(tmp_path, ORDERS_OF_ALL_KINDS))
    result = yawed(file, 50.0)
    assert torch.equal(result.values[:, 4:], file.values[:, 4:])
    assert float(result.values[1, 3]) == 61.0


def test_turned_angles_go_on_without_jumps(tmp_path: Path) -> None:
    """The file itself jumps from 178 to -174 degrees; what is edited does not."""
    file = read_bvh(saved(tmp_path, PLAIN.replace("1.5000 90.2500", "1.2500 90.2500")))
    result = yawed(file, 1.0)
    assert float(file.values[:, 5].diff().abs().max()) > 300
    assert float(result.values[:, 5].diff().abs().max()) < 15


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("frames", [1, 2, 7])
def test_a_motion_may_have_another_number_of_frames(tmp_path: Path, name: str, frames: int) -> None:
    file = read_bvh(saved(tmp_path, FILES[name]))
    clip = file.clip()
    index = torch.arange(frames) % clip.frames
    offsets = None if clip.offsets is None else clip.offsets[index]
    looped = replace(clip, root_position=clip.root_position[index], rotations=clip.rotations[index], offsets=offsets)
    # Spare channels stay as they were in the first frame, and the others make up for them.
    result = file.with_motion(looped)
    assert result.frames == frames
    error = (result.clip().joint_positions() - looped.joint_positions()).abs().max()
    assert float(error) < 1e-5 * file.unit


@pytest.mark.parametrize(
    ("joint", "axis", "message"),
    [
        (
            "Knee",
            "Y",
            r"'Knee' cannot be turned as frame 1 needs: its rotation channels are Xrotation \(off by 19.9 deg",
        ),
        ("Foot", "X", "'Foot' cannot be turned .* Zrotation"),
        ("Neck", "Z", "'Neck' cannot be turned .* none"),
        ("Hips", "X", "'Hips' cannot be turned .* Yrotation"),
    ],
)
def test_a_rotation_without_channels_is_refused(tmp_path: Path, joint: str, axis: str, message: str) -> None:
    file = read_bvh(saved(tmp_path, FILES["fewer and more channels"]))
    clip = file.clip()
    rotations = clip.rotations.clone()
    at = clip.skeleton.index(joint)
    rotations[1, at] = rotations[1, at] @ axis_rotation(axis, torch.tensor(math.radians(20), dtype=torch.float64))
    with pytest.raises(HopdiffError, match=message):
        file.with_motion(replace(clip, rotations=rotations))


def test_the_channels_that_there_are_can_be_used(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, FILES["fewer and more channels"]))
    clip = file.clip()
    names = clip.skeleton.names
    rotations = clip.rotations.clone()
    for joint, axis in (("Knee", "X"), ("Foot", "Z"), ("Eye", "Y"), ("Eye", "Z"), ("Arm", "Y"), ("Arm", "X")):
        rotations[1, names.index(joint)] @= axis_rotation(axis, torch.tensor(0.3, dtype=torch.float64))
    root = clip.root_position.clone()
    root[:, 2] += 0.5
    edited = replace(clip, rotations=rotations, root_position=root)
    result = file.with_motion(edited)
    torch.testing.assert_close(result.clip().joint_positions(), edited.joint_positions(), atol=1e-6, rtol=0)
    torch.testing.assert_close(result.clip().rotations, edited.rotations, atol=1e-6, rtol=0)
    assert torch.equal(result.values[0, 2:], file.values[0, 2:])


def broken(file: BvhFile) -> dict[str, tuple[object, str]]:
    clip = file.clip()
    root, rotations, skeleton = clip.root_position.clone(), clip.rotations.clone(), clip.skeleton
    root[0, 0] = math.nan
    rotations[0, 0, 0, 0] = math.inf
    longer = replace(skeleton, offsets=skeleton.offsets * 1.1)
    moving = skeleton.offsets.repeat(clip.frames, 1, 1)
    moving[1, 2] += 0.1
    return {
        "position": (replace(clip, root_position=root), "not finite"),
        "rotation": (replace(clip, rotations=rotations), "not finite"),
        "names": (replace(clip, skeleton=replace(skeleton, names=("a", "b", "c", "d"))), "other joints"),
        "bones": (replace(clip, skeleton=longer), "another bone at joint"),
        "offsets": (replace(clip, offsets=moving), "'LeftFoot' has no channel Xposition"),
        "time": (replace(clip, frame_time=0.01), "0.01 s a frame, but the BVH file 0.0333333 s"),
    }


@pytest.mark.parametrize("what", ["position", "rotation", "names", "bones", "offsets", "time"])
def test_a_motion_that_is_not_of_this_file_is_refused(tmp_path: Path, what: str) -> None:
    file = read_bvh(saved(tmp_path, PLAIN))
    clip, message = broken(file)[what]
    with pytest.raises(HopdiffError, match=message):
        file.with_motion(clip)  # type: ignore[arg-type]


def test_a_root_without_position_channels_stays_at_its_offset(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, MANY_ENDS), unit=1)
    clip = file.clip()
    assert clip.root_position.tolist() == [[-1.5, 2.5, 3.5]]
    with pytest.raises(HopdiffError, match="'Pelvis' has no channel Zposition, so it cannot be moved as frame 0"):
        file.with_motion(replace(clip, root_position=clip.root_position + torch.tensor([0.0, 0.0, 1.0])))


def test_joints_that_move_against_their_parents_can_be_edited(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, FILES["six channels everywhere"]))
    clip = file.clip()
    assert clip.offsets is not None
    offsets = clip.offsets.clone()
    offsets[1, 2, 1] += 0.02
    result = file.with_motion(replace(clip, offsets=offsets))
    changed = (result.values != file.values).nonzero().tolist()
    assert changed == [[1, 17]]
    torch.testing.assert_close(result.clip().offsets, offsets)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "FILE: the file is empty."),
        (" \n\t\n", "FILE: the file is empty."),
        ("hello", "FILE, line 1: this is not a BVH file, which begins with HIERARCHY and not with 'hello'."),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "FILE, line 3: this is binary data, not a BVH file."),
        (bytes(range(128, 256)) * 9, "FILE, line 1: this is not a BVH file"),
        ("HIERARCHY\n", "FILE, line 1: the file ends before its MOTION."),
        ("HIERARCHY\nMOTION\nFrames: 1\n", "FILE, line 2: MOTION begins, but there was no ROOT."),
        (PLAIN[: PLAIN.index("    JOINT LeftFoot")], "FILE, line 9: the file ends before its MOTION."),
        (
            PLAIN[: PLAIN.index("  JOINT LeftLeg") - 2],
            "FILE, line 5: 'Yrotatio' is no channel (Xposition ... Zrotation).",
        ),
        (HEAD[: HEAD.index("-42")], "FILE, line 12: OFFSET needs three numbers."),
        (PLAIN[: PLAIN.index("Frames:")], "FILE, line 31: the file ends before Frames: and a number."),
        (PLAIN[: PLAIN.index("Frame Time:")], "FILE, line 32: the file ends before Frame Time: and a number."),
        (PLAIN[: PLAIN.index("1.5000")], "FILE, line 31: the file says that it has 3 frames, but holds 0."),
        (PLAIN[:-50], "FILE, line 35: 9 numbers stand here, but a frame has 15."),
        (PLAIN[: PLAIN.index("\n2.5")], "FILE, line 31: the file says that it has 3 frames, but holds 1."),
        (swapped(("Frames: 3", "Frames: 1")), "FILE, line 31: the file says that it has 1 frame, but holds 3."),
        (swapped(("Frames: 3", "Frames: 5")), "FILE, line 31: the file says that it has 5 frames, but holds 3."),
        (swapped(("Frames: 3", "Frames: 0")), "FILE, line 31: the file says that it has no frames."),
        (swapped(("Frames: 3", "Frames: -3")), "FILE, line 31: the number of frames cannot be '-3'."),
        (swapped(("Frames: 3", "Frames: 3.5")), "FILE, line 31: the number of frames cannot be '3.5'."),
        (swapped(("Frames: 3", "Frames: " + "9" * 30)), "FILE, line 31: the number of frames cannot be '999999"),
        (swapped(("Frames: 3", "Frames:")), "FILE, line 31: Frames: and a number should stand here, not 'Frames:'."),
        (swapped(("0.0333333", "0")), "FILE, line 32: the time between frames must be positive, not '0'."),
        (swapped(("0.0333333", "-0.1")), "FILE, line 32: the time between frames must be positive, not '-0.1'."),
        (swapped(("0.0333333", "nan")), "FILE, line 32: 'nan' is not a number."),
        (swapped(("Frame Time: 0.0333333\n", "")), "FILE, line 32: Frame Time: and a number should stand here"),
        (swapped(("91.0000", "nan")), "FILE, line 34: 'nan' is not a number."),
        (swapped(("91.0000", "-inf")), "FILE, line 34: '-inf' is not a number."),
        (swapped(("91.0000", "1e999")), "FILE, line 34: '1e999' is too large."),
        (swapped(("91.0000", "91,0")), "FILE, line 34: '91,0' is not a number."),
        (swapped(("91.0000", "9-1")), "FILE, line 34: '9-1' is not a number."),
        (swapped(("91.0000", "9.1-2.0")), "FILE, line 34: '9.1-2.0' is not a number."),
        (swapped(("91.0000 4.0000 3.0000", "91.0000-4-3")), "FILE, line 34: '91.0000-4-3' is not a number."),
        (swapped(("91.0000 4.0000", "91.0000-4.0x")), "FILE, line 34: '91.0000-4.0x' is not a number."),
        (swapped(("91.0000", "9.1.0")), "FILE, line 34: '9.1.0' is not a number."),
        (swapped(("91.0000", "0x91")), "FILE, line 34: '0x91' is not a number."),
        (swapped(("91.0000", "9_1")), "FILE, line 34: '9_1' is not a number."),
        (swapped(("91.0000 ", "")), "FILE, line 34: 14 numbers stand here, but a frame has 15."),
        (swapped(("91.0000", "91.0000 1")), "FILE, line 34: 16 numbers stand here, but a frame has 15."),
        (
            swapped(("91.0000 ", ""), ("90.5000", "90.5000 1")),
            "FILE, line 34: 14 numbers stand here, but a frame has 15.",
        ),
        (swapped(("9.5000", "x")), "FILE, line 8: 'x' is not a number."),
        (swapped(("9.5000", "inf")), "FILE, line 8: 'inf' is not a number."),
        (swapped(("9.5000", "")), "FILE, line 8: OFFSET needs three numbers."),
        (swapped(("9.5000", "9.5 1")), "FILE, line 8: OFFSET needs three numbers, but there are more."),
        (swapped(("    OFFSET 9.5000 -4.0000 0.2500\n", "")), "FILE, line 18: joint 'LeftLeg' has no OFFSET."),
        (swapped(("OFFSET 9.5", "OFFSET 1 2 3\nOFFSET 9.5")), "FILE, line 9: joint 'LeftLeg' has a second OFFSET."),
        (swapped(("CHANNELS 6", "CHANNELS 5")), "FILE, line 5: CHANNELS says 5, but 6 follow."),
        (swapped(("CHANNELS 6", "CHANNELS 7")), "FILE, line 5: CHANNELS says 7, but 6 follow."),
        (swapped(("CHANNELS 6", "CHANNELS six")), "FILE, line 5: CHANNELS needs a number, not 'six'."),
        (swapped(("Zposition", "Zscale")), "FILE, line 5: 'Zscale' is no channel (Xposition ... Zrotation)."),
        (swapped(("Zposition", "Yposition")), "FILE, line 5: joint 'Hips' has a position channel twice."),
        (swapped(("  JOINT Head", "  CHANNELS 0\n  JOINT Head")), "FILE, line 20: joint 'Hips' has CHANNELS twice."),
        (swapped(("OFFSET 0.0000 -45", "CHANNELS 0\nOFFSET 0 -45")), "FILE, line 16: an end site has no CHANNELS."),
        (re.sub(r"CHANNELS.*", "CHANNELS 0", PLAIN), "FILE, line 30: no joint has CHANNELS, so there is no motion."),
        (swapped(("}\nMOTION", "MOTION")), "FILE, line 29: MOTION begins before joint 'Hips' is closed by }."),
        (swapped(("}\nMOTION", "}\n}\nMOTION")), "FILE, line 30: } stands outside of all joints."),
        (swapped(("Hips\n{", "Hips\n")), "FILE, line 4: OFFSET stands where the { of joint 'Hips' is missing."),
        (swapped(("Hips\n{", "Hips\n{\n{")), "FILE, line 4: { stands where no joint begins."),
        (swapped(("JOINT Head", "JOINT")), "FILE, line 20: JOINT has no name."),
        (swapped(("JOINT Head", "BONE Head")), "FILE, line 20: 'BONE' is no word of a BVH hierarchy."),
        (swapped(("JOINT Head", "ROOT Head")), "FILE, line 20: a second ROOT begins, but only files with one skeleton"),
        (swapped(("ROOT Hips", "JOINT Hips")), "FILE, line 2: JOINT stands outside of all joints."),
        (swapped(("ROOT Hips", "ROOT Hips\nROOT B")), "FILE, line 3: a second ROOT begins"),
        (swapped(("OFFSET 0.0000 -45", "JOINT a\nOFFSET 0 -45")), "FILE, line 16: an end site cannot hold a JOINT."),
        (swapped(("MOTION\n", "MOTION now\n")), "FILE, line 30: MOTION must stand alone on its line."),
        (swapped(("MOTION\n", "")), "FILE, line 30: 'Frames:' is no word of a BVH hierarchy."),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, text: str | bytes, message: str) -> None:
    assert refused(saved(tmp_path, text)).startswith(message)


@pytest.mark.parametrize(
    ("text", "frames", "note"),
    [
        (swapped(("Frames: 3", "Frames: 2")), 3, "line 31 says that there are 2 frames, but 3 were found and read."),
        (swapped(("Frames: 3", "Frames: 4")), 3, "line 31 says that there are 4 frames, but 3 were found and read."),
        (PLAIN[: PLAIN.index("\n3.5")], 2, "line 31 says that there are 3 frames, but 2 were found and read."),
        (swapped(("91.0000 4", "91.0000+4")), 3, "line 34 lacks a blank: '91.0000+4.0000' was read as 2 numbers."),
        (
            swapped((" -30.0000", "-30.0000"), (" -1.0000", "-1.0000"), (" -20.0000", "-20.0000")),
            3,
            "line 33 lacks a blank: '11.0000-30.0000' was read as 2 numbers, and 2 more like it.",
        ),
        (swapped((" -8.0000", "e0-8.0000")), 3, "line 33 lacks a blank: '4.0000e0-8.0000' was read as 2 numbers."),
    ],
)
def test_small_mistakes_are_mended_and_told(tmp_path: Path, text: str, frames: int, note: str) -> None:
    file = read_bvh(saved(tmp_path, text))
    assert file.notes == (note,)
    known = read_bvh(saved(tmp_path, PLAIN, "plain.bvh")).values[:frames]
    assert torch.equal(file.values, known)
    file.write(tmp_path / "b.bvh")
    again = read_bvh(tmp_path / "b.bvh")
    assert again.notes == ()
    assert torch.equal(again.values, known)


@pytest.mark.parametrize("name", ["End", "EndSite1", "End Site", "Site", "JOINT", "OFFSET", "CHANNELS 3", "Frames: 3"])
def test_joints_may_be_called_like_words_of_the_format(tmp_path: Path, name: str) -> None:
    file = read_bvh(saved(tmp_path, PLAIN.replace("JOINT LeftFoot", f"JOINT {name}")))
    assert [joint.name for joint in file.joints] == ["Hips", "LeftLeg", name, "Head"]
    assert file.joints[2].end_sites == ((0.0, -45.0, 12.0),)


def test_lines_are_counted_as_editors_count_them(tmp_path: Path) -> None:
    text = swapped(("91.0000", "x")).replace("\n", "\r\n")
    assert refused(saved(tmp_path, b"\xef\xbb\xbf" + text.encode())).startswith("FILE, line 34: 'x'")


def test_the_line_is_found_far_down_a_long_file(tmp_path: Path) -> None:
    row = ROWS.splitlines()[1]
    text = HEAD.replace("Frames: 3", "Frames: 90000") + "Frame Time: 0.01\n"
    long = text + (row + "\n") * 80000 + row.replace("91", "9l") + "\n" + (row + "\n") * 9999
    assert refused(saved(tmp_path, long)) == "FILE, line 80033: '9l.0000' is not a number."
    short = text + (row + "\n") * 80000 + "1 2 3\n" + (row + "\n") * 9999
    assert refused(saved(tmp_path, short)) == "FILE, line 80033: 3 numbers stand here, but a frame has 15."


@pytest.mark.parametrize("path", ["nowhere.bvh", "."])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, path: str) -> None:
    with pytest.raises(HopdiffError, match="cannot read"):
        read_bvh(tmp_path / path)


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    file = read_bvh(saved(tmp_path, PLAIN))
    with pytest.raises(HopdiffError, match="cannot write"):
        file.write(tmp_path / "nowhere" / "b.bvh")
    assert [path.name for path in tmp_path.iterdir()] == ["a.bvh"]


def test_clips_of_our_own_come_back(tmp_path: Path) -> None:
    clip = read_bvh(saved(tmp_path, PLAIN)).clip()
    write_bvh(tmp_path / "b.bvh", clip, order="YXZ", unit=100)
    found = read_bvh(tmp_path / "b.bvh")
    assert found.unit == 0.01
    torch.testing.assert_close(found.clip().joint_positions(), clip.joint_positions(), atol=1e-6, rtol=0)
    moving = read_bvh(saved(tmp_path, FILES["six channels everywhere"])).clip()
    write_bvh(tmp_path / "c.bvh", moving, unit=100, up="z")
    again = read_bvh(tmp_path / "c.bvh")
    assert (again.unit, again.up) == (0.01, "z")
    torch.testing.assert_close(again.clip().joint_positions(), moving.joint_positions(), atol=1e-6, rtol=0)


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize("legs", [0.7, 1.0, 1.3])
def test_runs_of_our_own_are_read_as_what_they_are(tmp_path: Path, legs: float, unit: float) -> None:
    """No feet, ends at the knees; short and long legs."""
    problem = make_problem("speed=3", f"character.proportions.legs={legs}")
    clip = problem.motion(problem.ordinary_genes, 60.0).clip
    write_bvh(tmp_path / "a.bvh", clip, unit=unit)
    file = read_bvh(tmp_path / "a.bvh")
    assert (file.unit, file.up) == (1 / unit, "y")
    found = file.clip()
    order = [found.skeleton.index(name) for name in clip.skeleton.names]
    torch.testing.assert_close(found.joint_positions()[:, order], clip.joint_positions(), atol=1e-5, rtol=0)
    assert found.end_positions().keys() >= clip.end_positions().keys()
    for name, place in clip.end_positions().items():
        torch.testing.assert_close(found.end_positions()[name], place, atol=1e-5, rtol=0)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("walk", 0.01),
        ("walk without toes", 1.0),
        ("walk with a turn", CMU),
        ("walk sideways", 0.01),
        ("run", CMU),
        ("wander", 0.01),
        ("walk_straight_snu_30hz", 1.0),
        ("walk_sideways_snu_cross90", 1.0),
        ("wander_snu_93s_30hz", 0.01),
        *((path.stem, CMU) for path in sorted(CAPTURED.glob("*_cmu_*.bvh"))),
    ],
)
def test_clips_of_people_are_read_and_come_back(tmp_path: Path, name: str, unit: float) -> None:
    path = file_of(name, tmp_path, 1.0 / unit)
    file = read_bvh(path)
    text = path.read_text()
    assert file.unit == unit
    assert file.up == "y"
    fixed = re.sub(r"[XYZ](?:POSITION|ROTATION)", lambda found: found.group().capitalize(), text)
    assert_positions(replace(file, joints=file.joints), fixed)
    edited = yawed(file, 90.0)
    assert torch.equal(edited.values[:, 6:], file.values[:, 6:])
    file.write(tmp_path / "b.bvh")
    assert_same_file(read_bvh(tmp_path / "b.bvh"), file)


@pytest.mark.parametrize("name", ["walk", "walk_straight_cmu_07_01"])
def test_another_library_reads_what_is_written(tmp_path: Path, name: str) -> None:
    pymotion = pytest.importorskip("pymotion.io.bvh", reason="upc-pymotion is not installed")
    from pymotion.ops.skeleton import fk
    from pymotion.rotations import quat

    file = yawed(read_bvh(file_of(name, tmp_path)), 90.0)
    file.write(tmp_path / "b.bvh")
    reader = pymotion.BVH()
    reader.load(str(tmp_path / "b.bvh"))
    data = reader.data
    order = np.broadcast_to(data["rot_order"], data["rotations"].shape)
    turns = quat.from_euler(np.radians(data["rotations"]), order)
    positions, _ = fk(turns, data["positions"][:, 0], data["offsets"], data["parents"])
    np.testing.assert_allclose(file.clip().joint_positions().numpy() / file.unit, positions, atol=1e-4)
