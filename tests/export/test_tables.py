from __future__ import annotations

import contextlib
import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hopdiff.export.full_body import full_body
from hopdiff.export.tables import ground_force, read_npz, write_csv, write_npz
from hopdiff.types import HopdiffError
from tests.export.takes import own, walked


def test_the_archive_gives_the_motion_again(tmp_path: Path) -> None:
    for take in (own(), full_body(own()), walked()):
        write_npz(tmp_path / "a.npz", take)
        found = read_npz(tmp_path / "a.npz")
        assert found.name == take.name
        assert (found.loop, found.numbers, found.masses) == (take.loop, take.numbers, take.masses)
        assert found.clip.frame_time == take.clip.frame_time
        assert found.clip.skeleton.names == take.clip.skeleton.names
        assert found.clip.skeleton.parents == take.clip.skeleton.parents
        torch.testing.assert_close(found.clip.joint_positions(), take.clip.joint_positions(), atol=1e-9, rtol=0)
        for entry in ("contact", "feet", "com", "leg_force"):
            before, after = getattr(take, entry), getattr(found, entry)
            assert (before is None) == (after is None)
            if before is not None:
                torch.testing.assert_close(after, before)


def test_moving_joints_come_back(tmp_path: Path) -> None:
    take = own()
    offsets = take.clip.skeleton.offsets * (1.0 + 0.1 * torch.rand(take.frames, 1, 1).double())
    moving = replace(take, clip=replace(take.clip, offsets=offsets))
    write_npz(tmp_path / "a.npz", moving)
    torch.testing.assert_close(read_npz(tmp_path / "a.npz").clip.joint_positions(), moving.clip.joint_positions())


def test_the_table_has_the_columns_that_are_promised(tmp_path: Path) -> None:
    take = own()
    write_csv(tmp_path / "a.csv", take)
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text().splitlines()))
    assert len(rows) == take.frames
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    places = take.clip.joint_positions().numpy()
    np.testing.assert_allclose(columns["time"], np.arange(take.frames) * take.clip.frame_time, rtol=1e-7)
    for joint, name in enumerate(take.clip.skeleton.names):
        for k, axis in enumerate("xyz"):
            np.testing.assert_allclose(columns[f"{name}.{axis}"], places[:, joint, k], atol=1e-8, rtol=1e-7)
        norm = sum(columns[f"{name}.q{axis}"] ** 2 for axis in "xyzw")
        np.testing.assert_allclose(norm, 1.0, atol=1e-7)
    assert take.com is not None
    np.testing.assert_allclose(columns["com.y"], take.com[:, 1].numpy(), rtol=1e-7)
    assert take.contact is not None
    assert columns["left.contact"].tolist() == take.contact[:, 0].double().tolist()
    assert {"left_foot.x", "right_foot.z", "left.leg_force", "right.ground_force"} <= set(columns)
    # The body is carried by its legs: over a whole stride they push as much as it weighs.
    pushed = columns["left.ground_force"][:-1] + columns["right.ground_force"][:-1]
    assert pushed.mean() == pytest.approx(70.0 * 9.81, rel=0.03)
    assert bool((columns["left.ground_force"][columns["left.contact"] == 0.0] == 0.0).all())


def test_clips_alone_have_no_columns_of_what_is_not_known(tmp_path: Path) -> None:
    write_csv(tmp_path / "a.csv", walked())
    header = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert "left.contact" in header
    assert not [name for name in header if "force" in name or name.startswith("com")]
    assert ground_force(walked()) is None


def test_broken_archives_get_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    write_npz(path, own())
    whole = path.read_bytes()
    generator = np.random.default_rng(0)
    broken = [b"", b"no archive", whole[:100], whole[: len(whole) // 2]]
    for _ in range(60):
        bad = bytearray(whole)
        bad[generator.integers(len(bad))] ^= int(generator.integers(1, 256))
        broken.append(bytes(bad))
    for data in broken:
        path.write_bytes(data)
        # Some bytes say nothing, and a sentence is all that may come of the others.
        with contextlib.suppress(HopdiffError):
            assert torch.isfinite(read_npz(path).clip.root_position).all()
    np.savez(path, other=np.zeros(3))
    with pytest.raises(HopdiffError, match="does not hold a motion"):
        read_npz(path)
    with pytest.raises(HopdiffError, match="cannot read"):
        read_npz(tmp_path / "none.npz")
