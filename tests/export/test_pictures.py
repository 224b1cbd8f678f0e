from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from hopdiff.export.full_body import full_body
from hopdiff.export.pictures import MARGIN, Stage, shown
from hopdiff.export.prepare import in_place
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.views import views_of
from hopdiff.export.write import write_exports
from hopdiff.types import HopdiffError
from tests.export.takes import own, walked
from tests.export.test_write import preset

SIZE = 96


def read(path: Path) -> NDArray[np.int64]:
    with Image.open(path) as picture:
        assert picture.mode == "RGBA"
        return np.asarray(picture).astype(np.int64)


def written(folder: Path, name: str, *overrides: str, take: Take | None = None) -> tuple[Path, ExportSettings]:
    settings = preset(name, f"size={SIZE}", *overrides)
    (path, _), *_ = write_exports([own() if take is None else take], {name: settings}, folder)
    return path, settings


def chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and content of the parts of a PNG file."""
    at = 8
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        yield kind, data[at + 8 : at + 8 + length]
        at += 12 + length


def staged(view: Any, **changes: Any) -> tuple[Stage, list[list[NDArray[np.uint8]]]]:
    take = in_place(full_body(own())).resampled(24.0, exact=False)
    stage = Stage.of([take], views_of(view, "view"), changes.get("size", SIZE), changes.get("centred", True))
    return stage, list(stage.pictures(stage.figures[0]))


def blue(picture: NDArray[Any]) -> NDArray[np.bool_]:
    """Pixels of the left limbs."""
    values = picture.astype(int)
    return (values[..., 3] > 200) & (values[..., 2] - values[..., 0] > 60)


def orange(picture: NDArray[Any]) -> NDArray[np.bool_]:
    values = picture.astype(int)
    return (values[..., 3] > 200) & (values[..., 0] - values[..., 2] > 60)


@pytest.mark.parametrize("view", ["side", "three_quarter", "top", "four"])
def test_figures_lie_just_inside_of_their_pictures(view: str) -> None:
    stage, frames = staged(view)
    solid = np.zeros((stage.height, stage.width), dtype=bool)
    for pictures in frames:
        for picture in pictures:
            assert picture.shape == (stage.height, stage.width, 4)
            solid |= picture[..., 3] > 0
    rows, columns = np.flatnonzero(solid.any(axis=1)), np.flatnonzero(solid.any(axis=0))
    assert rows[0] >= MARGIN
    assert columns[0] >= MARGIN
    assert rows[-1] < stage.height - MARGIN
    assert columns[-1] < stage.width - MARGIN
    assert rows[0] <= MARGIN + 1
    assert rows[-1] >= stage.height - MARGIN - 2
    # Centred, so that one side may have room to spare.
    assert min(columns[0], stage.width - 1 - columns[-1]) <= MARGIN + 1
    assert stage.pivot[0] * 2 == stage.width


def test_the_ground_is_in_one_row() -> None:
    stage, frames = staged("side")
    take = stage.figures[0].take
    assert take.contact is not None
    standing = take.contact[: len(frames)].any(dim=-1)
    lowest = np.array([np.flatnonzero((pictures[0][..., 3] > 127).any(axis=1))[-1] + 1 for pictures in frames])
    assert int(standing.sum()) > 5
    assert bool((np.abs(lowest[standing.numpy()] - stage.pivot[1]) <= 2).all())
    assert int(lowest.max()) <= stage.pivot[1] + 2
    # In the air it does not stand there.
    assert int(lowest.min()) < stage.pivot[1] - 2


@pytest.mark.parametrize("size", [48, 200])
def test_size_is_the_standing_height(size: int) -> None:
    stage, _ = staged("side", size=size)
    places = stage.figures[0].take.clip.joint_positions()
    # The human of 1.75 m; a run is a little lower than that.
    assert stage.scale == pytest.approx(size / 1.75, rel=0.03)
    assert stage.height - 2 * MARGIN == pytest.approx(stage.scale * float(places[..., 1].max()), rel=0.15, abs=2)


def test_from_the_side_it_runs_to_the_right() -> None:
    take = full_body(own()).resampled(12.0, exact=False)
    stage = Stage.of([take], views_of("side", "view"), SIZE, centred=False)
    columns = [float(np.nonzero(one[..., 3])[1].mean()) for [one] in stage.pictures(stage.figures[0])]
    way = float(take.clip.root_position[len(columns) - 1, 2] - take.clip.root_position[0, 2])
    assert columns[-1] - columns[0] == pytest.approx(stage.scale * way, rel=0.1)
    assert stage.width > 1.5 * stage.height


def test_its_left_is_on_our_right_when_it_faces_us() -> None:
    _, frames = staged(["front", "back"])
    for front, back in frames:
        middle = [float(np.nonzero(which(one))[1].mean()) for one in (front, back) for which in (blue, orange)]
        assert middle[0] > middle[1] + 5
        assert middle[2] < middle[3] - 5


def test_the_nearer_leg_is_in_front() -> None:
    """Of the right side, which is nearer in the side view, more is seen, and of the left one from the left."""
    _, frames = staged(["side", [-90, 0]])
    seen = np.array([[which(one).sum() for which in (blue, orange)] for pair in frames for one in pair])
    ours, theirs = seen[::2].sum(axis=0), seen[1::2].sum(axis=0)
    assert ours[1] > 1.3 * ours[0]
    assert theirs[0] > 1.3 * theirs[1]


def test_a_folder_of_pictures(tmp_path: Path) -> None:
    path, _ = written(tmp_path, "frames", "fps=20")
    assert path == tmp_path / "motion_frames"
    names = sorted(one.name for one in path.iterdir())
    count = round(own().clip.duration * 20)
    assert names == [f"{k:04d}.png" for k in range(1, count + 1)]
    pictures = [read(path / name) for name in names]
    assert len({one.shape for one in pictures}) == 1
    for one in pictures:
        assert not one[[0, 0, -1, -1], [0, -1, 0, -1], 3].any()
        assert (one[..., 3] == 255).sum() > 300
    # The last one is not the first again, and goes over into it as all go over into their next.
    steps = [np.abs(a - b).mean() for a, b in zip(pictures, [*pictures[1:], pictures[0]], strict=True)]
    assert 0.3 * np.mean(steps) < steps[-1] < 2.0 * np.mean(steps)
    # Made anew it is replaced as a whole.
    again, _ = written(tmp_path, "frames", "fps=24", "view=[side,back]")
    fewer = round(own().clip.duration * 24)
    assert sorted(one.name for one in again.iterdir()) == sorted(
        f"{view}_{k:04d}.png" for view in ("side", "back") for k in range(1, fewer + 1)
    )
    assert [one.name for one in tmp_path.iterdir()] == ["motion_frames"]


def test_what_ends_elsewhere_has_all_of_its_frames(tmp_path: Path) -> None:
    take = replace(own(), loop=False)
    path, _ = written(tmp_path, "frames", "fps=20", take=take)
    assert len(list(path.iterdir())) == round(own().clip.duration * 20) + 1
    path, _ = written(tmp_path, "apng", "fps=20", take=take)
    with Image.open(path) as picture:
        assert picture.info["loop"] == 1
        assert picture.n_frames == round(own().clip.duration * 20) + 1
    path, _ = written(tmp_path, "sprites", "fps=20", take=take)
    [tag] = json.loads(path.with_suffix(".json").read_text())["meta"]["frameTags"]
    assert (tag["repeat"], tag["loop"]) == ("1", False)


def test_an_animated_png_holds_the_same_pictures(tmp_path: Path) -> None:
    folder, _ = written(tmp_path, "frames", "fps=20")
    path, _ = written(tmp_path, "apng", "fps=20")
    wanted = [read(one) for one in sorted(folder.iterdir())]
    total = 0.0
    with Image.open(path) as picture:
        assert picture.n_frames == len(wanted)
        assert picture.info["loop"] == 0
        for frame, one in enumerate(wanted):
            picture.seek(frame)
            total += picture.info["duration"]
            np.testing.assert_array_equal(np.asarray(picture), one)
    assert total == pytest.approx(1000.0 * own().clip.duration, abs=1.0)
    # By the words of the standard: number of plays, and the delay of each frame as a fraction of a second.
    kinds = dict(chunks(path.read_bytes()))
    assert struct.unpack(">II", kinds[b"acTL"]) == (len(wanted), 0)
    delays = [struct.unpack(">5I2H", data[:24])[5:] for kind, data in chunks(path.read_bytes()) if kind == b"fcTL"]
    assert len(delays) == len(wanted)
    assert sum(above / below for above, below in delays) == pytest.approx(own().clip.duration, abs=1e-3)


def test_the_index_cuts_the_sheet_into_the_pictures(tmp_path: Path) -> None:
    words = ("fps=20", "view=[side,front]")
    folder, _ = written(tmp_path, "frames", *words)
    path, _ = written(tmp_path, "sprites", *words, "columns=5")
    sheet, index = read(path), json.loads(path.with_suffix(".json").read_text())
    meta, count = index["meta"], round(own().clip.duration * 20)
    assert (meta["image"], meta["size"]) == (path.name, {"w": sheet.shape[1], "h": sheet.shape[0]})
    assert list(index["animations"]) == [tag["name"] for tag in meta["frameTags"]] == ["run_side", "run_front"]
    names = list(index["frames"])
    places = set()
    for tag, view in zip(meta["frameTags"], ("side", "front"), strict=True):
        run = names[tag["from"] : tag["to"] + 1]
        assert run == index["animations"][tag["name"]]
        assert len(run) == count
        assert "repeat" not in tag
        assert tag["pixels_per_second"] == pytest.approx(3.0 * meta["pixels_per_metre"])
        duration = 0
        for k, name in enumerate(run, start=1):
            entry = index["frames"][name]
            box = entry["frame"]
            cut = sheet[box["y"] : box["y"] + box["h"], box["x"] : box["x"] + box["w"]]
            np.testing.assert_array_equal(cut, read(folder / f"{view}_{k:04d}.png"))
            assert entry["sourceSize"] == {"w": box["w"], "h": box["h"]}
            assert entry["pivot"] == entry["anchor"]
            assert entry["pivot"]["x"] == 0.5
            places.add((box["x"], box["y"]))
            duration += entry["duration"]
        assert duration == round(1000.0 * own().clip.duration)
    assert len(places) == 2 * count
    assert sheet.shape[1] == 5 * index["frames"][names[0]]["frame"]["w"]


def test_motions_share_a_sheet_and_a_scale(tmp_path: Path) -> None:
    small = own().clip.skeleton
    ends = {name: 0.7 * end for name, end in small.end_sites.items()}
    child = replace(
        own(),
        name="child",
        numbers={},
        clip=replace(
            own().clip,
            skeleton=replace(small, offsets=0.7 * small.offsets, end_sites=ends),
            root_position=0.7 * own().clip.root_position,
        ),
        masses={part: 0.7**3 * mass for part, mass in (own().masses or {}).items()},
        feet=None if own().feet is None else 0.7 * own().feet,  # type: ignore[operator]
    )
    settings = preset("sprites", "fps=20", f"size={SIZE}")
    walk = Take.of_clip("walk", walked().clip.part(slice(0, 20)), {})
    (path, _), (index_path, _) = write_exports([own(), child, walk], {"sprites": settings}, tmp_path)
    assert index_path == path.with_suffix(".json")
    sheet, index = read(path), json.loads(path.with_suffix(".json").read_text())
    assert [tag["name"] for tag in index["meta"]["frameTags"]] == ["run", "child", "walk"]
    heights = []
    for tag in index["meta"]["frameTags"]:
        box = index["frames"][index["animations"][tag["name"]][0]]["frame"]
        solid = sheet[box["y"] : box["y"] + box["h"], box["x"] : box["x"] + box["w"], 3] > 127
        heights.append(int(solid.any(axis=1).sum()))
    assert heights[1] == pytest.approx(0.7 * heights[0], abs=4)
    assert [("pixels_per_second" in tag) for tag in index["meta"]["frameTags"]] == [True, False, False]


def test_motions_whose_names_are_alike_in_files_are_numbered_in_the_index(tmp_path: Path) -> None:
    takes = [replace(own(), name=name) for name in ("a b", "a_b", "a_b_1", "c")]
    settings = preset("sprites", "fps=20", "size=16")
    (path, _), *_ = write_exports(takes, {"sprites": settings}, tmp_path)
    index = json.loads(path.with_suffix(".json").read_text())
    tags = [tag["name"] for tag in index["meta"]["frameTags"]]
    assert len(set(tags)) == len(index["animations"]) == 4
    assert tags[2:] == ["a_b_1", "c"]
    assert len(index["frames"]) == sum(len(names) for names in index["animations"].values())
    assert len({(one["frame"]["x"], one["frame"]["y"]) for one in index["frames"].values()}) == len(index["frames"])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("size=0", "exports.sprites.size must lie between 8 and 2048 pixels, not 0"),
        ("size=5000", "exports.sprites.size must lie"),
        ("columns=0", "exports.sprites.columns must be 1 or more, not 0"),
        ("view=profile", "Unknown exports.sprites.view 'profile'"),
        ("view=[side,side]", "exports.sprites.view has the view 'side' twice"),
        ("view=[0,120]", "exports.sprites.view: an elevation lies between"),
        ("file=metrics.png", r"exports\.sprites\.file=metrics\.png needs another name, metrics\.json is the run's"),
    ],
)
def test_settings_that_cannot_be_get_one_sentence(setting: str, message: str) -> None:
    with pytest.raises(HopdiffError, match=message):
        preset("sprites", setting)


def test_what_makes_no_pictures_leaves_nothing(tmp_path: Path) -> None:
    broken = own().clip.root_position.clone()
    broken[3, 1] = torch.nan
    lost = replace(own(), clip=replace(own().clip, root_position=broken))
    kinds = ("frames", "apng", "sprites")
    for kind in kinds:
        with pytest.raises(HopdiffError, match=f"exports.{kind}: cannot draw run: the motion holds a number"):
            write_exports([lost], {kind: ExportSettings(kind, joints="model", root="travelling")}, tmp_path)
        with pytest.raises(HopdiffError, match=rf"exports.{kind}: pictures would be \d+ x \d+ pixels.*root=in_place"):
            write_exports([own()], {kind: ExportSettings(kind, size=2048, cycles=4, fps=10.0)}, tmp_path)
        with pytest.raises(HopdiffError, match=f"exports.{kind}: cannot write .*nowhere"):
            write_exports([own()], {kind: preset(kind, "fps=10", "size=16")}, tmp_path / "nowhere")
    wide = preset("sprites", "columns=100", "cycles=3", "fps=20", "size=512")
    with pytest.raises(HopdiffError, match=r"exports.sprites: the sheet would be \d+ x \d+ pixels, more than 8192"):
        write_exports([own()], {"sprites": wide}, tmp_path)
    many = preset("apng", "view=eight", "size=1500", "fps=6")
    with pytest.raises(HopdiffError, match=r"exports.apng: pictures would be more than 8192 pixels wide"):
        write_exports([own()], {"apng": many}, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "motion_frames").mkdir()
    (tmp_path / "motion_frames" / "thesis.txt").write_text("mine")
    with pytest.raises(HopdiffError, match=r"exports.frames: cannot write .*: something else is there already"):
        written(tmp_path, "frames")
    assert [one.name for one in tmp_path.rglob("*")] == ["motion_frames", "thesis.txt"]


def test_pictures_of_a_loop_are_one_fewer() -> None:
    assert shown(own()) == own().frames - 1
    assert shown(replace(own(), loop=False)) == own().frames
