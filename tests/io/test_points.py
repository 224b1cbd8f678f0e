from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hopdiff.io.points import read_points
from hopdiff.types import HopdiffError

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="200" height="200" viewBox="0 0 200 200">'
THREE = [[0.0, 0.0], [2.5, 6.0], [-2.5, 13.0]]


def saved(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def drawing(folder: Path, *shapes: str) -> Path:
    return saved(folder, "track.svg", f"{SVG}\n" + "\n".join(shapes) + "\n</svg>\n")


def refused(path: Path) -> str:
    """What the user is told, the file's name left out."""
    with pytest.raises(HopdiffError) as caught:
        read_points(path)
    assert str(path) in str(caught.value)
    return str(caught.value).replace(repr(str(path)), "FILE").replace(str(path), "FILE")


@pytest.mark.parametrize(
    "text",
    [
        "x,z\n0,0\n2.5,6\n-2.5,13\n",
        "0,0\n2.5,6\n-2.5,13",
        "x,z\r\n0,0\r\n2.5,6\r\n-2.5,13\r\n",
        " X , Z \n 0 , 0 \n 2.5 , 6.0 \n -2.5 , 1.3e1 \n",
        '"x","z"\n"0","0"\n"2.5","6"\n"-2.5","13"\n',
        "z,x\n0,0\n6,2.5\n13,-2.5\n",
        "time,z,y,x,name\n0,0,1,0,a\n1,6,1,2.5,b\n2,13,1,-2.5,c\n",
        "x,z,name\n0,0\n2.5,6,b,more\n-2.5,13,\n",
        "0,0,7\n2.5,6,8\n-2.5,13,9\n",
        "x;z\n0;0\n2.5;6\n-2.5;13\n",
        "0;0\n2.5;6\n-2.5;13\n",
        "x\tz\n0\t0\n2.5\t6\n-2.5\t13\n",
        "0\t0\n2.5\t6\n-2.5\t13\n",
        "# a path; of mine\n\n  # two, more\nx,z\n\n0,0\n2.5,6\n   \n# half-way\n-2.5,13\n\n\n",
    ],
)
def test_a_table_is_read_however_it_is_written(tmp_path: Path, text: str) -> None:
    assert read_points(saved(tmp_path, "track.csv", text)).tolist() == THREE


@pytest.mark.parametrize(("name", "scale"), [("track.csv", 0.01), ("TRACK.CSV", 1.0), ("track.Csv", 1000.0)])
def test_the_scale_is_metres_a_unit(tmp_path: Path, name: str, scale: float) -> None:
    found = read_points(saved(tmp_path, name, "x,z\n0,0\n2.5,6\n-2.5,13\n"), scale)
    assert found.tolist() == (scale * np.array(THREE)).tolist()


def test_a_table_may_start_anywhere(tmp_path: Path) -> None:
    assert read_points(saved(tmp_path, "track.csv", "5,7\n6,9\n")).tolist() == [[5.0, 7.0], [6.0, 9.0]]


NUMBERS = "x and z must be two finite numbers."
NAMED = "the columns must be named x and z."


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "FILE is empty."),
        (" \n# nothing\n\n", "FILE is empty."),
        ("x,y\n0,0\n1,1\n", f"FILE, line 1: {NAMED}"),
        ("# mine\n\nz,y\n0,0\n1,1\n", f"FILE, line 3: {NAMED}"),
        ("0,nought\n1,1\n2,2\n", f"FILE, line 1: {NAMED}"),
        ("nan,0\n1,1\n2,2\n", f"FILE, line 1: {NAMED}"),
        ("x z\n0 0\n1 1\n", f"FILE, line 1: {NAMED}"),
        ("x,z\n0,0\n# half-way\n1,one\n2,2\n", f"FILE, line 4: {NUMBERS}"),
        ("x,z\n0,0\n1\n2,2\n", f"FILE, line 3: {NUMBERS}"),
        ("x,z\n0,0\n\n1,\n", f"FILE, line 4: {NUMBERS}"),
        ("x,z\n0,0\n1,nan\n", f"FILE, line 3: {NUMBERS}"),
        ("0,0\n-inf,1\n", f"FILE, line 2: {NUMBERS}"),
        ("0,0\n1,1e999\n", f"FILE, line 2: {NUMBERS}"),
        ("x;z\n0;0\n1,5;2\n", f"FILE, line 3: {NUMBERS}"),
        ("1,2\nx,z\n3,4\n", f"FILE, line 2: {NUMBERS}"),
        ("0\n1\n", f"FILE, line 1: {NUMBERS}"),
        ("x,z\n", "FILE holds 0 points; a path needs at least two."),
        ("0,0\n", "FILE holds 1 point; a path needs at least two."),
    ],
)
def test_a_wrong_table_is_told_with_the_line(tmp_path: Path, text: str, said: str) -> None:
    assert refused(saved(tmp_path, "track.csv", text)) == f"path.file {said}"


@pytest.mark.parametrize("name", ["track.csv", "track.svg"])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    assert refused(tmp_path / name) == "path.file: cannot read FILE: no such file or directory."
    binary = saved(tmp_path, name, b"x,z\n\xff\xfe\x00\x81")
    assert refused(binary) == "path.file: cannot read FILE: it is not UTF-8 text (byte 4)."
    binary.unlink()
    binary.mkdir()
    assert refused(binary) == "path.file: cannot read FILE: is a directory."


@pytest.mark.parametrize("name", ["track.txt", "track", "track.csv.bak", "track.svgz"])
def test_another_kind_of_file_is_refused(tmp_path: Path, name: str) -> None:
    assert refused(saved(tmp_path, name, "0,0\n1,1\n")) == "path.file FILE must be a .csv or an .svg file."


@pytest.mark.parametrize(
    ("shape", "end"),
    [
        ('<path d="M 50 150 L 50 50"/>', [0.0, 100.0]),
        ('<line x1="50" y1="150" x2="50" y2="50"/>', [0.0, 100.0]),
        ('<line x1="50" y1="150" x2="20" y2="110"/>', [30.0, 40.0]),
        ('<polyline points="90,90 90,60 120,60"/>', [-30.0, 30.0]),
        ('<path d="m 10,20 h 30 v -40"/>', [-30.0, 40.0]),
        ('<g transform="translate(7 9) scale(2)"><line x1="1" y1="1" x2="0" y2="-4"/></g>', [2.0, 10.0]),
    ],
)
def test_up_the_page_is_forward_and_left_is_left(tmp_path: Path, shape: str, end: list[float]) -> None:
    found = read_points(drawing(tmp_path, shape))
    assert found[0].tolist() == [0.0, 0.0]
    assert found[-1].tolist() == pytest.approx(end, abs=1e-9)
    assert read_points(drawing(tmp_path, shape), 0.01)[-1].tolist() == pytest.approx([x / 100 for x in end], abs=1e-9)


def test_points_of_a_line_lie_on_it_in_order(tmp_path: Path) -> None:
    found = read_points(drawing(tmp_path, '<line x1="50" y1="150" x2="20" y2="110"/>'))
    assert len(found) > 10
    assert found[:, 0] == pytest.approx(0.75 * found[:, 1])
    assert (np.diff(found[:, 1]) > 0).all()


def test_curves_are_followed(tmp_path: Path) -> None:
    """A quarter of a circle, by arc and by Bezier curve, that goes up the page first and then turns to the left."""
    for d in ("M 100 150 A 60 60 0 0 0 40 90", "M 100 150 C 100 116.863 73.137 90 40 90"):
        found = read_points(drawing(tmp_path, f'<path fill="none" d="{d}"/>'))
        assert found[-1].tolist() == pytest.approx([60.0, 60.0])
        assert np.hypot(found[:, 0] - 60.0, found[:, 1]) == pytest.approx(60.0, abs=0.05)
        assert found[5, 1] > 3.0 * found[5, 0] > 0.0


@pytest.mark.parametrize(
    "shape",
    [
        '<circle cx="100" cy="100" r="40"/>',
        '<ellipse cx="100" cy="100" rx="60" ry="20"/>',
        '<rect x="10" y="10" width="30" height="50"/>',
        '<polygon points="0,0 50,0 50,-70"/>',
        '<path d="M 0 0 L 50 0 L 50 -70 Z"/>',
    ],
)
def test_a_closed_shape_ends_where_it_starts(tmp_path: Path, shape: str) -> None:
    found = read_points(drawing(tmp_path, shape))
    assert found[0].tolist() == [0.0, 0.0]
    assert found[-1].tolist() == pytest.approx([0.0, 0.0], abs=1e-9)
    assert np.ptp(found, axis=0).min() > 25.0


def test_a_circle_is_round(tmp_path: Path) -> None:
    found = read_points(drawing(tmp_path, '<circle cx="100" cy="100" r="40"/>'), 0.1)
    # The drawing starts at the right, so the middle lies to the left.
    assert np.hypot(found[:, 0] - 4.0, found[:, 1]) == pytest.approx(4.0, abs=1e-3)
    steps = np.hypot(*np.diff(found, axis=0).T)
    assert steps.sum() == pytest.approx(8.0 * math.pi, rel=1e-2)


def test_what_is_not_drawn_does_not_count(tmp_path: Path) -> None:
    line = '<line x1="5" y1="9" x2="5" y2="4"/>'
    others = ('<title>Track</title><desc>one, two</desc><text x="1" y="2">start</text>', '<path d="M 3 3"/>')
    found = read_points(drawing(tmp_path, *others, f"<g>{line}</g>"))
    assert found[-1].tolist() == pytest.approx([0.0, 5.0], abs=1e-9)


LINE = '<line x1="5" y1="9" x2="5" y2="4"/>'


@pytest.mark.parametrize(
    ("shapes", "said"),
    [
        ((), "FILE must hold one path, not 0."),
        (("<title>none</title>",), "FILE must hold one path, not 0."),
        (('<path d="M 3 3"/>',), "FILE must hold one path, not 0."),
        ((LINE, LINE), "FILE must hold one path, not 2."),
        ((LINE, '<circle r="9"/>', '<path d="M0 0L1 1"/>'), "FILE must hold one path, not 3."),
        (('<path d="M 0 0 L 5 5 M 9 9 L 12 15"/>',), "FILE: the path must be one line, not several pieces."),
        ((LINE, "<line>"), "FILE, line 4: not an SVG file."),
        (('<path d="M 0 0 L 5 5" </g>',), "FILE, line 2: not an SVG file."),
        (("&nothing;",), "FILE, line 2: not an SVG file."),
    ],
)
def test_a_drawing_of_something_else_is_refused(tmp_path: Path, shapes: tuple[str, ...], said: str) -> None:
    assert refused(drawing(tmp_path, *shapes)) == f"path.file {said}"


BOMB = '<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "FILE is empty."),
        (" \n\n", "FILE is empty."),
        ("0,0\n1,1\n", "FILE, line 1: not an SVG file."),
        ("<?xml version='1.0'?>\n\n<svg>\n<g>\n", "FILE, line 5: not an SVG file."),
        (f"{BOMB}\n{SVG}<text>&b;</text>{LINE}</svg>", "FILE is too large or holds entities: save it as a plain SVG."),
    ],
)
def test_a_file_that_is_no_plain_drawing_is_refused(tmp_path: Path, text: str, said: str) -> None:
    assert refused(saved(tmp_path, "track.svg", text)) == f"path.file {said}"


def test_a_file_too_large_for_a_drawing_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = drawing(tmp_path, LINE)
    monkeypatch.setattr("hopdiff.io.points.LARGEST", 10)
    assert refused(path) == "path.file FILE is too large or holds entities: save it as a plain SVG."
