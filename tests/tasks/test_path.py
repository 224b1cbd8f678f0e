from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from hopdiff.cli import main
from hopdiff.geometry.curve import curve_through
from tests.tasks.conftest import LEAST

FILES = {
    *(
        "motion.bvh",
        "motion.npz",
        "path.csv",
        "genes.json",
        "history.csv",
        "metrics.json",
        "config.yaml",
        "status.json",
        "versions.json",
    ),
    *("git.json", "events"),
}
PICTURES = {"motion.gif", "path.png", "along.png", "convergence.png"}
# A budget for a blink, a search that needs no luck.
QUICK = ("model=smooth", "search=random", "search.population=100", "budget.evaluations=300", "fps=30", "pictures=false")
# The default model: genetic, as hardly a random candidate of it can run; some least run, not searched for then.
BODY = ("model=body", "search=ga", "search.population=40", "budget.evaluations=120", *LEAST)
BENDS = ("path.points=[[0,0],[2,6],[-2,12],[0,18]]", "path.time=6")
STRAIGHT = ("path.points=[[0,0],[0,20]]", "path.time=6")
# Round a circle of 8 m to the left, forward first.
ROUND = "path.points=" + str(
    [[round(8 - 8 * math.cos(a), 6), round(8 * math.sin(a), 6)] for a in np.arange(16) * math.pi / 8]
).replace(" ", "")
CIRCLE = (ROUND, "path.closed=true", "path.time=12")

Runs = Callable[..., Path]


def command(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: str) -> int:
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=path", *QUICK, *arguments, f"hydra.run.dir={folder}"])
    return main()


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """The folder of a run with these arguments; many tests look at the same few."""

    @cache
    def run(*arguments: str) -> Path:
        folder = tmp_path_factory.mktemp("path") / "run"
        with pytest.MonkeyPatch.context() as patch:
            assert command(patch, folder, *arguments) == 0
        return folder

    return run


def metrics(folder: Path) -> dict:
    return json.loads((folder / "metrics.json").read_text())


def frames(folder: Path) -> tuple[float, NDArray[np.float64]]:
    """Frame time [s] and the rows of motion.bvh: root position x, y, z, then angles."""
    head, _, body = (folder / "motion.bvh").read_text().partition("Frame Time:")
    first, *rows = body.strip().splitlines()
    values = np.array([row.split() for row in rows], dtype=float)
    assert f"Frames: {len(values)}\n" in head
    return float(first), values


def table(folder: Path) -> dict[str, NDArray[np.float64]]:
    with open(folder / "path.csv") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def names(folder: Path) -> set[str]:
    return {"events" if path.name.startswith("events.") else path.name for path in folder.iterdir()}


def test_the_folder_holds_the_run(runs: Runs) -> None:
    assert names(runs(*BENDS)) == FILES


def test_pictures_come_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert command(monkeypatch, tmp_path / "run", *STRAIGHT, "pictures=true", "fps=12") == 0
    assert names(tmp_path / "run") == FILES | PICTURES
    with Image.open(tmp_path / "run" / "motion.gif") as film:
        assert getattr(film, "n_frames", 1) > 20
    with Image.open(tmp_path / "run" / "path.png") as picture:
        assert min(picture.size) > 100


def test_what_came_out_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, tmp_path / "run", *STRAIGHT) == 0
    printed = capsys.readouterr()
    assert "20.00 m in 6 s, so 3.33 m/s" in printed.out
    assert f"{metrics(tmp_path / 'run')['strides']} strides" in printed.out
    assert printed.err == ""


@pytest.mark.parametrize(
    "arguments",
    [
        BENDS,
        STRAIGHT,
        CIRCLE,
        (*BENDS, "limp.amount=0.3"),
        pytest.param((*BENDS, "model=thesis"), marks=pytest.mark.thorough),
        (*BENDS, "fps=24"),
        (*BENDS, *BODY),
    ],
)
def test_the_run_leads_along_the_path_in_its_time_on_whole_strides(arguments: tuple[str, ...], runs: Runs) -> None:
    folder = runs(*arguments)
    numbers, way = metrics(folder), table(folder)
    frame_time, rows = frames(folder)
    points = json.loads(arguments[0].partition("=")[2])
    closed = "path.closed=true" in arguments
    time = float(next(word for word in arguments if word.startswith("path.time="))[10:])
    assert frame_time * (len(rows) - 1) == pytest.approx(time, abs=1e-5)
    assert way["time"] == pytest.approx(frame_time * np.arange(len(rows)), abs=1e-5)
    assert [way["x"][0], way["z"][0]] == pytest.approx(points[0], abs=1e-9)
    assert [way["x"][-1], way["z"][-1]] == pytest.approx(points[0 if closed else -1], abs=1e-6)
    # The body goes on the path, inwards of it where it leans.
    beside = np.hypot(rows[:, 0] - way["x"], rows[:, 2] - way["z"])
    assert beside.max() < 0.1 + math.sin(math.radians(numbers["max_lean_deg"]))
    assert closed or beside[[0, -1]].max() < 0.1
    # The thesis' strides are made of whole frames; what these leave is stretched.
    exact = 0.01 if "model=thesis" in arguments else 1e-3
    assert numbers["strides"] * numbers["stride_time"] == pytest.approx(time, rel=exact)
    assert numbers["foot_slide_max"] < 0.01
    # What the limits allow.
    assert numbers["min_foot_clearance"] > (-0.01 if set(BODY) <= set(arguments) else -5e-4)
    assert numbers["speed"] * time == pytest.approx(numbers["path_length"]) == pytest.approx(way["way"][-1])


def test_the_table_is_the_curve_through_the_points(runs: Runs) -> None:
    way = table(runs(*BENDS))
    dense = curve_through([[0, 0], [2, 6], [-2, 12], [0, 18]])
    assert way["way"][-1] == pytest.approx(dense.length)
    for point in ([2, 6], [-2, 12]):
        assert np.hypot(way["x"] - point[0], way["z"] - point[1]).min() < 0.1
    step = np.hypot(np.diff(way["x"]), np.diff(way["z"]))
    assert step == pytest.approx(np.diff(way["way"]), rel=1e-2)
    middle = 0.5 * (way["heading"][1:] + way["heading"][:-1])
    assert np.arctan2(np.diff(way["x"]), np.diff(way["z"])) == pytest.approx(middle, abs=0.02)


def test_a_straight_path_ends_in_the_pose_it_began_with(runs: Runs) -> None:
    _, rows = frames(runs(*STRAIGHT))
    assert rows[-1, [0, 2]] - rows[0, [0, 2]] == pytest.approx([0.0, 20.0], abs=1e-4)
    assert rows[-1, 3:] == pytest.approx(rows[0, 3:], abs=0.01)
    assert np.ptp(rows[:, 3:], axis=0).max() > 50.0


def test_a_closed_path_loops(runs: Runs) -> None:
    folder = runs(*CIRCLE)
    numbers = metrics(folder)
    assert numbers["closed"] is True
    assert numbers["loop_error"] < 1e-3
    _, rows = frames(folder)
    assert rows[-1, :3] == pytest.approx(rows[0, :3], abs=1e-3)
    assert np.cos(np.radians(rows[-1, 3:] - rows[0, 3:])) == pytest.approx(1.0, abs=1e-6)
    assert metrics(runs(*BENDS))["closed"] is False


@pytest.mark.few(2)
@pytest.mark.parametrize("time", [9.0, 20.0])
def test_the_lean_grows_with_the_square_of_speed_over_radius(time: float, runs: Runs) -> None:
    folder = runs(*CIRCLE[:2], f"path.time={time:g}", "path.max_lean_deg=40")
    speed, radius = 16.0 * math.pi / time, 8.0
    lean = math.atan(speed**2 / (9.81 * radius))
    assert metrics(folder)["max_lean_deg"] == pytest.approx(math.degrees(lean), abs=0.5)
    # HIP leans about the line on the ground, which is the circle: inwards of it by its height's share.
    _, rows = frames(folder)
    inwards = radius - np.hypot(rows[:, 0] - radius, rows[:, 2])
    assert float(np.mean(inwards / rows[:, 1])) == pytest.approx(math.tan(lean), rel=0.05)


@pytest.mark.few(2)
@pytest.mark.parametrize("cap", [0.0, 5.0])
def test_the_lean_is_capped(cap: float, runs: Runs) -> None:
    assert metrics(runs(*CIRCLE))["max_lean_deg"] > 10.0
    assert metrics(runs(*CIRCLE, f"path.max_lean_deg={cap:g}"))["max_lean_deg"] == pytest.approx(cap, abs=1e-6)


def test_a_table_file_is_the_same_as_points(tmp_path: Path, runs: Runs) -> None:
    (tmp_path / "track.csv").write_text("x,z\n0,0\n200,600\n-200,1200\n0,1800\n")
    read = runs(f"path.file={tmp_path / 'track.csv'}", "path.scale=0.01", BENDS[1])
    assert (read / "motion.bvh").read_bytes() == (runs(*BENDS) / "motion.bvh").read_bytes()
    assert (read / "path.csv").read_bytes() == (runs(*BENDS) / "path.csv").read_bytes()


@pytest.mark.thorough
def test_a_drawing_is_the_same_as_points(tmp_path: Path, runs: Runs) -> None:
    """Ten metres up the page and a quarter of a circle of ten metres to the left."""
    shape = '<path d="M 300 400 C 300 344.772 255.228 300 200 300"/>'
    (tmp_path / "track.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 500 500">{shape}</svg>')
    angles = np.linspace(0.0, 0.5 * math.pi, 40)
    points = np.stack((10.0 * (1.0 - np.cos(angles)), 10.0 * np.sin(angles)), axis=-1).round(6).tolist()
    drawn = runs(f"path.file={tmp_path / 'track.svg'}", "path.scale=0.1", "path.time=4")
    typed = runs(f"path.points={points}".replace(" ", ""), "path.time=4")
    one, other = table(drawn), table(typed)
    assert one["x"][-1] == pytest.approx(10.0, abs=1e-3)
    for name in ("time", "way", "x", "z"):
        assert one[name] == pytest.approx(other[name], abs=0.02)
    assert metrics(drawn)["strides"] == metrics(typed)["strides"]


def test_a_seed_is_repeated_to_the_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runs: Runs) -> None:
    assert command(monkeypatch, tmp_path / "again", *BENDS) == 0
    assert command(monkeypatch, tmp_path / "other", *BENDS, "seed=1") == 0
    first = (runs(*BENDS) / "motion.bvh").read_bytes()
    assert (tmp_path / "again" / "motion.bvh").read_bytes() == first
    assert (tmp_path / "other" / "motion.bvh").read_bytes() != first


def test_a_limp_goes_along(runs: Runs) -> None:
    lame, sound = metrics(runs(*BENDS, "limp.amount=0.3")), metrics(runs(*BENDS))
    assert lame["contact_time_left"] == pytest.approx(0.7 * lame["contact_time_right"], rel=0.02)
    assert sound["contact_time_left"] == pytest.approx(sound["contact_time_right"])


def test_smoothing_takes_the_bends_out(runs: Runs) -> None:
    zigzag = ("path.points=[[0,0],[1,4],[-1,8],[1,12],[-1,16],[0,20]]", "path.time=7")
    rough, smooth = metrics(runs(*zigzag)), metrics(runs(*zigzag, "path.smooth=1"))
    assert smooth["min_radius"] > 1.5 * rough["min_radius"]
    assert smooth["path_length"] < rough["path_length"]


TEN = "path.points=[[0,0],[0,10]]"
PAIRS = "path.points must be a list of pairs of numbers: [[x, z], [x, z], ...]."
HAIRPIN = "path.points=[[0,0],[0,10],[0.5,10],[0.5,0]]"


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        ("path.time=3", "task=path needs either path.points=[[x,z],...] or path.file=FILE."),
        (TEN, "task=path needs path.time, the seconds from the first point to the last."),
        (f"{TEN} path.time=0", "path.time must be a number above 0, not 0."),
        (f"{TEN} path.time=-3", "path.time must be a number above 0, not -3."),
        (f"{TEN} path.time=nan", "path.time must be a number above 0, not nan."),
        (f"{TEN} path.time=soon", "path.time must be a number, not 'soon'."),
        (f"{TEN} path.time=3 path.scale=0", "path.scale must be a number above 0, not 0."),
        (f"{TEN} path.time=3 path.smooth=-1", "path.smooth must be a number of 0 or more, not -1."),
        (f"{TEN} path.time=3 path.max_lean_deg=50", "path.max_lean_deg must lie between 0 and 45, not 50."),
        (f"{TEN} path.time=3 path.max_lean_deg=nan", "path.max_lean_deg must lie between 0 and 45, not nan."),
        (f"{TEN} path.time=3 speed=3", "speed cannot be set with task=path: path.time and the length of the path"),
        (f"{TEN} path.time=3 path.file=a.csv", "path.points and path.file are both set: give the path by one of them."),
        ("path.file=a.csv path.time=3", "path.file: cannot read a.csv: no such file or directory."),
        ("path.file=a.png path.time=3", "path.file 'a.png' must be a .csv or an .svg file."),
        ("path.points=[[0,0]] path.time=3", "path.points needs at least two points, not 1."),
        ("path.points=[[0,0],[0,10,1]] path.time=3", PAIRS),
        ("path.points=[[0,0],[0,ten]] path.time=3", PAIRS),
        (
            "path.points=[[0,0],[0,nan]] path.time=3",
            "path.points: point 2 is not a pair of finite numbers: [0.0, nan].",
        ),
        ("path.points=[[0,0],[0,0],[1,9]] path.time=3", "path.points: points 1 and 2 are the same, [0.0, 0.0]."),
        (f"{TEN} path.time=3 path.closed=true", "path.points: a closed path needs at least three different points."),
        (f"{TEN} path.time=3 genes.fixed.duty_factor=0.3", "genes.fixed.duty_factor cannot be set with task=path: "),
        (f"{TEN} path.time=3 path.speed=3", "Unknown setting 'path.speed'."),
        (f"{TEN} path.time=0.5", "path.time=0.5 asks for 20.0 m/s over 10.0 m, and the character human runs at "),
        (f"{TEN} path.time=1e9", "path.time=1e+09 asks for 0.0 m/s over 10.0 m, and the character human runs at "),
        (f"{HAIRPIN} path.time=6", "the path turns with a radius of 0.25 m near [0.3, 10.1], where 3.5 m/s need 1.2"),
        (
            "path.points=[[0,0],[0,9],[0.01,9],[0.01,0]] path.time=20",
            "the path turns with a radius of 0.00 m near [0.0, 9.0]: ",
        ),
        ("path.points=[[0,0],[0,1]] path.time=0.3", "no whole number of strides fits path.time=0.3: at 3.33 m/s a "),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    overrides: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["hopdiff", "task=path", *QUICK, *overrides.split()])
    assert main() == 1
    told = capsys.readouterr().err
    assert told.startswith(f"hopdiff: {said}")
    assert told.endswith("\n")
    assert told.count("\n") == 1
    assert not list(tmp_path.rglob("motion*"))


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("points", "time", "share"),
    [
        (TEN, 0.5, 0.1),
        (TEN, 1e9, 0.9),
        (HAIRPIN, 6.0, 0.5),
        ("path.points=[[0,0],[20,20],[0,40],[-20,20],[0,0]]", 5.0, 0.1),
    ],
)
def test_a_time_of_the_range_that_is_told_will_do(
    points: str,
    time: float,
    share: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command(monkeypatch, tmp_path / "refused", points, f"path.time={time:g}") == 1
    told = re.search(r"path\.time must lie between (\S+) and (\S+) s\b", capsys.readouterr().err)
    assert told is not None
    least, most = map(float, told.groups())
    assert not least <= time <= most
    assert not (tmp_path / "refused").exists()
    assert command(monkeypatch, tmp_path / "run", points, f"path.time={least + share * (most - least):.3f}") == 0
    assert metrics(tmp_path / "run")["foot_slide_max"] < 0.01


@pytest.mark.parametrize(
    "points",
    ["path.points=[[0,0],[0,10],[0,2]]", "path.points=[[0,0],[0,10],[0,20]] path.closed=true"],
    ids=["there and back", "closed line"],
)
def test_turning_about_on_the_spot_is_refused(
    points: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, tmp_path / "no", *points.split(), "path.time=8") == 1
    assert "too sharp at any speed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("points", "time", "said"),
    [
        ("path.points=[[0,0],[0,1e300]]", "1e299", "path.points: point 2 lies farther than 100 km from [0, 0]."),
        ("path.points=[[0,0],[0,20000]]", "5000", "path.time=5000 at fps=30 makes more than 100000 frames: 3333 s are"),
    ],
)
def test_what_would_not_fit_into_memory_is_refused(
    points: str,
    time: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert command(monkeypatch, tmp_path / "no", points, f"path.time={time}") == 1
    assert said in capsys.readouterr().err


def test_a_run_on_a_slope_is_put_on_it(runs: Runs, tmp_path: Path) -> None:
    level, hill = runs(*STRAIGHT), runs(*STRAIGHT, "ground=slope", "ground.angle=8", "ground.start=[0,2]")
    rows, raised = frames(level)[1], frames(hill)[1]
    rise = np.tan(np.radians(8.0)) * np.maximum(rows[:, 2] - 2.0, 0.0)
    assert np.abs(raised[:, 1] - rows[:, 1] - rise).max() < 0.15
    assert np.array_equal(raised[:, [0, 2]], rows[:, [0, 2]])
    found = metrics(hill)
    assert found["ground_rise"] == pytest.approx(18.0 * math.tan(math.radians(8.0)), abs=0.01)
    assert found["ground_depth"] < 0.005
    assert found["speed"] == metrics(level)["speed"]
    assert "ground_rise" not in metrics(level)
    assert "foot_slip" not in found
