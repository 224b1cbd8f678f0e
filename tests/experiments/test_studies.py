from __future__ import annotations

import importlib
import math
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PEERS = ("cma", "evotorch", "nevergrad", "pymoo")  # of the extra of that name


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "experiments").rglob("*.py")
    if path.name not in ("in_blender.py", "in_browser.py")  # which other programs run
)


@pytest.mark.parametrize("module", MODULES)
def test_every_study_finds_what_it_takes_from_the_project(module: str) -> None:
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.split(".")[0] not in PEERS:
            raise
        pytest.skip(f"needs the extra peers: {error.name}")


def test_reach_measures_judges_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.reach.__main__ import main
    from experiments.report import read_table

    arguments = f"--speeds 3 --betas .2,.7 --seeds 0 --search random --evaluations 200 --out {tmp_path}"
    main(arguments.split())
    rows = read_table(tmp_path / "runs.csv")
    assert [float(row["beta"]) for row in rows] == [0.2, 0.7]
    assert all(float(row["travel"]) == pytest.approx(3.0, abs=1e-6) for row in rows)
    assert (tmp_path / "trends.png").stat().st_size > 10_000
    first = (tmp_path / "results.md").read_text()
    assert "| speed exact to 1e-9 | 2 of 2 | yes |" in first
    assert "`python -m experiments.reach --speeds 3 --betas .2,.7" in first.splitlines()[0]
    main(["--redraw", "--out", str(tmp_path)])
    assert (tmp_path / "results.md").read_text() == first
    (tmp_path / "results.md").unlink()
    main(["--redraw", "--out", str(tmp_path)])
    assert (tmp_path / "results.md").read_text().splitlines()[1:] == first.splitlines()[1:]
    assert "energy within 2 %" in capsys.readouterr().out


def test_reach_names_what_misses_a_bar() -> None:
    from experiments.reach.__main__ import KEPT, report
    from experiments.reach.bars import trend_breaks

    good = dict.fromkeys(KEPT, 0.0)
    good |= {"speed": 3.0, "travel": 3.0, "beta": 0.2, "cost": 1.0, "energy_rate": 0.25, "energy_target": 0.25}
    good |= {"contact_time": 0.28, "flight_share": 0.3, "com_oscillation": 0.08, "arm_swing_deg": 20.0}
    brisker = good | {"beta": 0.7, "energy_rate": 2.33, "energy_target": 7 / 3}
    brisker |= {"contact_time": 0.26, "flight_share": 0.4, "com_oscillation": 0.1, "arm_swing_deg": 30.0}
    assert "**no**" not in report([good, brisker])
    text = report([good | {"energy_rate": 0.256, "com_oscillation": 0.14}, brisker])
    assert "3 m/s, beta 0.2, seed 0: energy_error 0.024" in text
    assert "3 m/s: com_oscillation from beta 0.2 to 0.7 goes 0.14 to 0.1" in text
    assert trend_breaks([good, brisker | {"arm_swing_deg": 20.0}])[1] == [
        "3 m/s: arm_swing_deg from beta 0.2 to 0.7 goes 20 to 20"
    ]


@pytest.mark.thorough
def test_bench_prints_its_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.bench.__main__ import main

    small = "--sizes 2 --rounds 1 --evaluations 200 --crowds 3 --seconds 0.5"
    main([*small.split(), "--out", str(tmp_path)])
    text = (tmp_path / "results.md").read_text()
    # The whole body is priced in double precision only.
    assert text.count("| float32 | 2 |") == text.count("| smooth | float64 | 2 |") == 1
    assert text.count("| body | float64 | 2 |") == 1
    assert "| gradient |" in text
    for model in ("smooth", "thesis"):
        line = next(line for line in text.splitlines() if line.startswith(f"| {model} | 3 |"))
        numbers = [float(cell.replace(",", "")) for cell in line.strip("| ").split("|")[2:]]
        assert len(numbers) == 4
        assert all(math.isfinite(number) for number in numbers)
