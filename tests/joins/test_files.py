"""Clips beside a walk, however they are written, and the one file that all become."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from experiments.bvh_reading import read
from hopdiff.geometry.clip import Clip
from hopdiff.io.bvh import read_bvh, write_bvh
from hopdiff.joins.files import Neighbours, read_neighbour, together
from hopdiff.types import HopdiffError
from tests.joins.neighbours import laid, rise, walk


def off(a: Clip, b: Clip) -> float:
    order = [b.skeleton.index(name) for name in a.skeleton.names]
    return float((a.joint_positions() - b.joint_positions()[:, order]).norm(dim=-1).max())


@pytest.fixture
def written(tmp_path: Path) -> Path:
    write_bvh(tmp_path / "walk.bvh", walk(2.0), unit=100.0)
    return tmp_path / "walk.bvh"


@pytest.mark.parametrize(
    ("order", "unit", "up"), [("ZXY", 100.0, "y"), ("XYZ", 100.0, "y"), ("ZYX", 1.0, "y"), ("ZXY", 39.37, "z")]
)
def test_a_neighbour_is_where_it_is_whatever_its_file(
    order: str, unit: float, up: str, written: Path, tmp_path: Path
) -> None:
    clip = laid(rise(), 130.0, 2.0, 1.0)
    write_bvh(tmp_path / "rise.bvh", clip, order=order, unit=unit, up=up)
    found = read_neighbour(tmp_path / "rise.bvh", read_bvh(written), "walk.bvh")
    assert found.notes == ()
    assert off(found.clip, clip) < 1e-4


def test_one_who_lies_all_the_time_is_read_as_the_walk_is(written: Path, tmp_path: Path) -> None:
    """What of such a file is up, and how long its unit, cannot be told from it alone."""
    clip = rise()
    flat = torch.tensor([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]], dtype=torch.float64)
    root = clip.root_position * torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64) + torch.tensor([0.0, 0.15, 0.0])
    rotations = clip.rotations.clone()
    rotations[:, 0] = flat @ rotations[:, 0]
    lying = replace(clip, root_position=root, rotations=rotations)
    write_bvh(tmp_path / "lie.bvh", lying, unit=100.0)
    assert off(read_neighbour(tmp_path / "lie.bvh", read_bvh(written), "walk.bvh").clip, lying) < 1e-4


def test_another_rate_becomes_the_walks(written: Path, tmp_path: Path) -> None:
    clip = rise()
    write_bvh(tmp_path / "rise.bvh", replace(clip, frame_time=1.0 / 60.0), unit=100.0)
    found = read_neighbour(tmp_path / "rise.bvh", read_bvh(written), "walk.bvh")
    assert found.clip.frames == (clip.frames + 1) // 2
    assert off(found.clip, clip.part(slice(0, None, 2))) < 1e-4
    assert found.notes == ("rise.bvh has 60 frames a second, and now 30 as walk.bvh has.",)


def test_other_skeletons_are_refused(written: Path, tmp_path: Path) -> None:
    clip = rise()
    names = tuple("Pelvis" if name == "Hips" else name for name in clip.skeleton.names)
    long = clip.skeleton.offsets.clone()
    long[clip.skeleton.index("LeftLeg")] *= 1.2
    for skeleton, words in (
        (replace(clip.skeleton, names=names), "joint 1 is 'Pelvis', there 'Hips'"),
        (replace(clip.skeleton, offsets=long), "the bone to 'LeftLeg' is"),
    ):
        write_bvh(tmp_path / "other.bvh", replace(clip, skeleton=skeleton), unit=100.0)
        with pytest.raises(HopdiffError, match=rf"^other.bvh has another skeleton than walk.bvh: {words}"):
            read_neighbour(tmp_path / "other.bvh", read_bvh(written), "walk.bvh")


def test_the_file_of_all_has_the_neighbours_rows_letter_by_letter(written: Path, tmp_path: Path) -> None:
    before = tmp_path / "before.bvh"
    write_bvh(before, laid(rise(), 175.0, 2.0, 1.0), unit=100.0)
    # Written by another program, with more digits and blanks than needed.
    text = before.read_text().splitlines()
    start = next(k for k, line in enumerate(text) if line.startswith("Frame Time")) + 1
    rows = ["  ".join(f"{float(word):.8f}" for word in line.split()) for line in text[start:]]
    before.write_text("\n".join([*text[:start], *rows]) + "\n")
    file = read_bvh(written)
    near = read_neighbour(before, file, "walk.bvh")
    clip = near.clip
    ahead = file.clip()
    count = clip.frames + ahead.frames - 1
    whole = replace(
        clip,
        root_position=torch.cat((clip.root_position, ahead.root_position[1:])),
        rotations=torch.cat((clip.rotations, ahead.rotations[1:])),
    )
    together(file, whole, Neighbours(near, None)).write(tmp_path / "all.bvh")
    lines = (tmp_path / "all.bvh").read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    assert lines[at : at + clip.frames] == rows
    again = read(tmp_path / "all.bvh")
    assert len(again.values) == count
    assert np.abs(again.forward()[0] / 100.0 - whole.joint_positions().numpy()).max() < 1e-5
    # Angles of the walk go on from those before, but for what really turns.
    turned = np.abs(np.diff(again.values[clip.frames :], axis=0))
    assert turned.max() < 60.0
