"""Maps of heights: grey pictures and tables, seen from above with +z up the page and +x to the left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from hopdiff.io.heights import read_heights
from hopdiff.types import HopdiffError

VALUES = np.array([[0, 51, 255], [102, 0, 204]])


@pytest.mark.parametrize("depth", [8, 16])
def test_a_picture_gives_shares_of_white_right_way_round(depth: int, tmp_path: Path) -> None:
    pixels = VALUES.astype(np.uint8) if depth == 8 else (VALUES * 257).astype(np.uint16)
    Image.fromarray(pixels).save(tmp_path / "map.png")
    found = read_heights(tmp_path / "map.png", "ground.file")
    # The first row is the smallest z, at the bottom; its first value the smallest x, at the right.
    assert found == pytest.approx(VALUES[::-1, ::-1] / 255.0)


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
def test_a_table_gives_its_numbers(separator: str, tmp_path: Path) -> None:
    rows = [separator.join(str(0.5 * value) for value in row) for row in VALUES]
    (tmp_path / "map.csv").write_text("# heights\n\n" + "\n".join(rows) + "\n")
    assert read_heights(tmp_path / "map.csv", "ground.file") == pytest.approx(0.5 * VALUES[::-1, ::-1])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("map.csv", "1,2\n3,nan\n", "map.csv', line 2: value 2 is not a finite number."),
        ("map.csv", "1,2\n\n3,x\n", "map.csv', line 3: value 2 is not a finite number."),
        ("map.csv", "1,2\n3,4,5\n", "map.csv', line 2: 3 values, and 2 in the first line."),
        ("map.csv", "1,2\n", "needs at least 2 by 2 values, not 1 by 2."),
        ("map.csv", "# nothing\n", "map.csv' is empty."),
        ("map.csv", None, "ground.file: cannot read"),
        ("map.png", None, "map.png' cannot be read: no such file or directory."),
        ("map.png", "no picture", "map.png' is no PNG picture."),
        ("map.txt", "1,2\n3,4\n", "must be a .png or a .csv file."),
    ],
)
def test_a_broken_map_is_told_in_one_sentence(name: str, content: str | None, says: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(HopdiffError) as error:
        read_heights(tmp_path / name, "ground.file")
    assert says in str(error.value)
    assert str(error.value).startswith("ground.file")


def test_a_picture_that_is_cut_off_or_coloured_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.png"
    noise = np.random.default_rng(0).integers(0, 255, (200, 200), dtype=np.uint8)
    Image.fromarray(noise).save(path)
    whole = path.read_bytes()
    for length in (len(whole) // 2, 60, 20):
        path.write_bytes(whole[:length])
        with pytest.raises(HopdiffError, match=r"is a broken PNG picture|is no PNG picture"):
            read_heights(path, "ground.file")
    # Spoilt in the middle: wrong check sums or data that do not unpack.
    path.write_bytes(whole[:200] + b"spoilt" * 20 + whole[320:])
    with pytest.raises(HopdiffError, match="is a broken PNG picture"):
        read_heights(path, "ground.file")
    Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8)).save(path)
    with pytest.raises(HopdiffError, match="must be a grey picture of 8 or 16 bits, not one of mode RGB"):
        read_heights(path, "ground.file")


def test_an_enormous_picture_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    Image.new("1", (20_000, 20_000)).save(tmp_path / "map.png")
    with pytest.raises(HopdiffError, match="is too large"):
        read_heights(tmp_path / "map.png", "ground.file")
