from __future__ import annotations

import itertools
import re
from functools import partial

import numpy as np
import pytest
import torch

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation, euler_to_matrix
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh import continuous_euler, write_bvh
from hopdiff.types import HopdiffError
from tests.counting import calls

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]


def branching_skeleton() -> Skeleton:
    """Listed breadth first, so that a writer which takes the order of joints for the order of the file fails."""
    return Skeleton(
        names=("pelvis", "left_hip", "waist", "left_knee", "left neck"),
        parents=(-1, 0, 0, 1, 2),
        offsets=torch.tensor(
            [[0, 0.9, 0], [0.09, 0, 0], [0, 0.15, 0.01], [0, -0.43, 0], [0.123456789, 0.4, 0]], dtype=torch.float64
        ),
        end_sites={"left_knee": torch.tensor([0.0, -0.5, 0.02], dtype=torch.float64)},
    )


def wild_clip(frames: int = 50, seed: int = 0, skeleton: Skeleton | None = None) -> Clip:
    """Smooth and large rotations about all axes."""
    skeleton = skeleton or branching_skeleton()
    generator = torch.Generator().manual_seed(seed)
    t = torch.linspace(0, 1, frames, dtype=torch.float64)[:, None, None]
    size = torch.rand(1, len(skeleton.names), 3, generator=generator, dtype=torch.float64)
    angles = 2.5 * size * torch.sin(2 * torch.pi * (t + size))
    root = torch.cat((0.1 * torch.sin(6 * t[:, 0]), 1 + 0 * t[:, 0], 5 * t[:, 0]), dim=1)
    return Clip(skeleton, root, euler_to_matrix(angles, "YZX"), 1 / 60)


def read_positions(text: str) -> tuple[list[str], np.ndarray]:
    """A reader as small as can be: names (joints and end sites) and world positions (T, K, 3) in file units."""
    head, motion = text.split("MOTION")
    stack: list[int] = []
    nodes: list[dict] = []
    for line in head.splitlines():
        words = line.split()
        match words[0] if words else "":
            case "ROOT" | "JOINT" | "End":
                name = words[1] if words[0] != "End" else nodes[stack[-1]]["name"] + " end"
                nodes.append({"name": name, "parent": stack[-1] if stack else -1, "channels": []})
            case "{":
                stack.append(len(nodes) - 1)
            case "}":
                stack.pop()
            case "OFFSET":
                nodes[-1]["offset"] = np.array(words[1:], float)
            case "CHANNELS":
                nodes[-1]["channels"] = words[2:]
                assert int(words[1]) == len(words) - 2
    assert not stack
    rows = np.array([line.split() for line in motion.strip().splitlines()[2:]], float)
    positions, turns = np.zeros((len(rows), len(nodes), 3)), np.zeros((len(rows), len(nodes), 3, 3))
    for frame, row in enumerate(rows):
        values = iter(row)
        for i, node in enumerate(nodes):
            place, turn = node["offset"].copy(), np.eye(3)
            for channel in node["channels"]:
                axis, value = "XYZ".index(channel[0]), next(values)
                if channel.endswith("position"):
                    place[axis] += value
                else:
                    a, b, angle = (axis + 1) % 3, (axis + 2) % 3, np.radians(value)
                    step = np.eye(3)
                    step[a, a] = step[b, b] = np.cos(angle)
                    step[b, a], step[a, b] = np.sin(angle), -np.sin(angle)
                    turn = turn @ step
            parent = node["parent"]
            base, frame_of = (
                (np.zeros(3), np.eye(3)) if parent < 0 else (positions[frame, parent], turns[frame, parent])
            )
            positions[frame, i], turns[frame, i] = base + frame_of @ place, frame_of @ turn
        assert next(values, None) is None
    return [node["name"] for node in nodes], positions


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("unit", [1.0, 100.0, 0.01])
def test_positions_survive(tmp_path, order, unit):
    clip = wild_clip()
    write_bvh(tmp_path / "a.bvh", clip, order=order, unit=unit)
    names, positions = read_positions((tmp_path / "a.bvh").read_text())
    ours = clip.joint_positions().numpy()
    for joint, name in enumerate(clip.skeleton.names):
        error = np.abs(positions[:, names.index(name.replace(" ", "_"))] / unit - ours[:, joint]).max()
        assert error < 2e-6, name
    end = clip.end_positions()["left_knee"].numpy()
    assert np.abs(positions[:, names.index("left_knee end")] / unit - end).max() < 2e-6


@pytest.mark.parametrize("order", ORDERS)
def test_an_independent_reader_agrees(tmp_path, order):
    pymotion = pytest.importorskip("pymotion.io.bvh", reason="upc-pymotion is not installed")
    from pymotion.ops.skeleton import fk
    from pymotion.rotations import quat

    clip = wild_clip()
    write_bvh(tmp_path / "a.bvh", clip, order=order)
    reader = pymotion.BVH()
    reader.load(str(tmp_path / "a.bvh"))
    data = reader.data
    rotations = quat.from_euler(
        np.radians(data["rotations"]), np.broadcast_to(data["rot_order"], data["rotations"].shape)
    )
    positions, _ = fk(rotations, data["positions"][:, 0], data["offsets"], data["parents"])
    ours = clip.joint_positions().numpy()
    for joint, name in enumerate(clip.skeleton.names):
        theirs = positions[:, list(data["names"]).index(name.replace(" ", "_"))]
        np.testing.assert_allclose(theirs, ours[:, joint], atol=1e-4)
    assert data["frame_time"] == pytest.approx(1 / 60, abs=1e-9)
    assert len(data["end_sites"]) == 2


@pytest.mark.parametrize("order", ORDERS)
def test_angles_never_jump(order):
    clip = wild_clip(frames=2000)
    angles = continuous_euler(clip.rotations, order)
    torch.testing.assert_close(euler_to_matrix(angles, order), clip.rotations)
    # With 2000 frames the fastest joint turns about 1 degree a frame; only the poles of the middle angle go faster.
    cosine = torch.cos(angles[..., 1]).abs().clamp(min=1e-3)
    assert ((angles.diff(dim=0).abs().amax(-1)) * cosine[1:]).max() < 0.1


@pytest.mark.parametrize("order", ORDERS)
def test_a_knee_bends_past_a_right_angle_on_one_channel(order):
    flexion = torch.linspace(0.0, 2.3, 101, dtype=torch.float64)
    angles = continuous_euler(axis_rotation(order[1], flexion), order)
    torch.testing.assert_close(angles[:, 1], flexion)
    torch.testing.assert_close(angles[:, [0, 2]], torch.zeros_like(angles[:, [0, 2]]))


def test_full_turns_add_up():
    turning = torch.linspace(0.0, 20.0, 200, dtype=torch.float64)
    angles = continuous_euler(axis_rotation("Y", turning), "YXZ")
    torch.testing.assert_close(angles[:, 0], turning)


def test_file_reads_as_bvh(tmp_path):
    clip = wild_clip(frames=3)
    write_bvh(tmp_path / "a.bvh", clip)
    text = (tmp_path / "a.bvh").read_text()
    lines = text.splitlines()
    assert lines[0] == "HIERARCHY"
    assert "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation" in lines[4]
    assert text.count("CHANNELS 3 Zrotation Xrotation Yrotation") == 4
    assert re.findall(r"Frames: (\d+)", text) == ["3"]
    frame_time = float(re.findall(r"Frame Time: (\S+)", text)[0])
    assert abs(frame_time - 1 / 60) < 1e-9
    assert "-0.000000 " not in text
    assert len(lines[-1].split()) == 6 + 3 * 4
    assert text.count("{") == text.count("}")


def test_single_precision_and_gradients_are_taken(tmp_path):
    clip = wild_clip(frames=5)
    single = Clip(clip.skeleton, clip.root_position.float().requires_grad_(), clip.rotations.float(), clip.frame_time)
    write_bvh(tmp_path / "a.bvh", single)
    _, positions = read_positions((tmp_path / "a.bvh").read_text())
    np.testing.assert_allclose(positions[:, 0], clip.root_position.numpy(), atol=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"order": "XYX"}, "BVH order must be one of .*'XYX'"),
        ({"unit": 0.0}, "BVH unit"),
        ({"unit": float("nan")}, "BVH unit"),
    ],
)
def test_bad_options_are_named(tmp_path, change, message):
    with pytest.raises(HopdiffError, match=message):
        write_bvh(tmp_path / "a.bvh", wild_clip(3), **change)
    assert not list(tmp_path.iterdir())


def test_a_motion_that_is_not_finite_is_not_written(tmp_path):
    clip = wild_clip(3)
    clip.rotations[1, 2, 0, 0] = float("nan")
    with pytest.raises(HopdiffError, match="not finite"):
        write_bvh(tmp_path / "a.bvh", clip)
    assert not list(tmp_path.iterdir())


def test_names_must_differ(tmp_path):
    skeleton = Skeleton(("a b", "a_b"), (-1, 0), torch.zeros(2, 3))
    clip = Clip(skeleton, torch.zeros(2, 3), torch.eye(3).expand(2, 2, 3, 3), 0.1)
    with pytest.raises(HopdiffError, match="'a_b' occurs twice"):
        write_bvh(tmp_path / "a.bvh", clip)


def test_a_minute_is_written_without_a_loop_over_frames(tmp_path):
    joints = 22
    skeleton = Skeleton(tuple(f"j{i}" for i in range(joints)), tuple(range(-1, joints - 1)), torch.ones(joints, 3))
    counts = []
    for frames in (36, 360, 3600):
        clip = wild_clip(frames, skeleton=skeleton)
        write_bvh(tmp_path / "a.bvh", clip)
        counts.append(calls(partial(write_bvh, tmp_path / "a.bvh", clip)))
    assert counts[-1] < 1.1 * counts[0]
