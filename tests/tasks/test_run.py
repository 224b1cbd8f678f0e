from __future__ import annotations

import csv
import json
import math
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image, ImageSequence
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import hopdiff
from hopdiff.cli import main
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.job import search_run
from hopdiff.search.loop import OnStep
from hopdiff.tasks.results import densely
from tests.tasks.conftest import LEAST

FILES = {
    "motion.bvh",
    "motion.npz",
    "motion_in_place.bvh",
    "genes.json",
    "metrics.json",
    "history.csv",
    "strip.png",
    "convergence.png",
    "com_track.png",
    "angles.png",
    "motion.gif",
    "config.yaml",
    "status.json",
    "versions.json",
    "git.json",
}
METRICS = {
    "speed",
    "beta",
    "cost",
    "gamma",
    "energy_rate",
    "energy_rate_raw",
    "energy_unit",
    "energy_target",
    "contact_time",
    "flight_time",
    "step_frequency",
    "step_length",
    "duty_factor",
    "com_oscillation",
    "peak_leg_force_bw",
    "knee_touchdown_deg",
    "knee_stance_max_deg",
    "knee_swing_max_deg",
    "trunk_lean_deg",
    "stance_foot_drift",
    "min_foot_clearance",
    "loop_error",
    "evaluations",
    "gradient_evaluations",
    "invalid_fraction",
    "wall_seconds",
    "compiled",
    "stopped",
    "search",
    "model",
    "seed",
    "frame_time",
}
# Of the whole body in their place, or besides.
BODY_METRICS = METRICS - {"stance_foot_drift"} | {
    "foot_slip",
    "flight_residual_bw",
    "stance_residual_bw",
    "moment_residual_nm",
    "momentum_drift",
    "cop_excess",
    "friction_needed",
    "external_work",
    "cost_of_transport",
    "torque_knee_flexion_nm",
}
MODELS = [("body", "body", 3.0), ("smooth", "default", 4.0)]  # with the gene table, and a speed that its start can run


def read(folder: Path, name: str) -> dict:
    return json.loads((folder / name).read_text())


def history(folder: Path) -> list[dict[str, float]]:
    with open(folder / "history.csv") as file:
        return [{name: float(value or "nan") for name, value in row.items()} for row in csv.DictReader(file)]


def test_the_folder_holds_everything_and_nothing_else(either: Path) -> None:
    names = {path.name for path in either.iterdir()}
    events = {name for name in names if name.startswith("events.out.tfevents")}
    assert events
    assert names - events == FILES


@pytest.mark.parametrize(("model", "wanted"), [("body", BODY_METRICS), ("smooth", METRICS)], ids=["body", "smooth"])
def test_metrics_hold_every_number(model: str, wanted: set[str], request: pytest.FixtureRequest) -> None:
    metrics = read(request.getfixturevalue("finished" if model == "body" else "finished_smooth"), "metrics.json")
    assert wanted - set(metrics) == set()
    numbers = {name: metrics[name] for name in wanted - {"search", "stopped", "model"}}
    assert all(isinstance(value, int | float) and math.isfinite(value) for value in numbers.values())
    assert metrics["speed"] == pytest.approx(4.0, rel=1e-9)
    assert (metrics["beta"], metrics["seed"], metrics["search"], metrics["model"]) == (0.5, 3, "ga", model)
    assert metrics["evaluations"] == 200
    assert metrics["step_length"] * metrics["step_frequency"] == pytest.approx(4.0, rel=1e-3)


def test_history_is_the_search(either: Path) -> None:
    rows = history(either)
    assert [row["step"] for row in rows] == list(range(len(rows)))
    assert rows[-1]["evaluations"] == 200
    best = [row["best"] for row in rows]
    assert best == sorted(best, reverse=True)
    assert best[-1] == pytest.approx(read(either, "metrics.json")["cost"], rel=1e-6)


def test_events_are_the_history_and_the_pictures(finished: Path) -> None:
    events = EventAccumulator(str(finished), size_guidance={"scalars": 0})
    events.Reload()
    best = [event.value for event in events.Scalars("search/best")]
    assert best == pytest.approx([row["best"] for row in history(finished)], rel=1e-6)
    assert {"strip", "convergence", "com_track", "angles"} <= set(events.Tags()["images"])
    assert "_hparams_/session_start_info" in events.PluginTagToContent("hparams")


def test_settings_are_whole(finished: Path) -> None:
    settings = yaml.safe_load((finished / "config.yaml").read_text())
    assert settings["speed"] == 4.0
    assert settings["search"]["population"] == 40
    assert settings["character"]["joints"]["neck"]["parent"] == "waist"
    assert "speed=4" in read(finished, "versions.json")["command"]
    assert read(finished, "versions.json")["hopdiff"] == hopdiff.__version__


def test_pictures_can_be_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("search=ordinary", "speed=3", "beta=0.2", "pictures=false", f"hydra.run.dir={tmp_path / 'run'}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 0
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert {name for name in names if "tfevents" not in name} == {
        name for name in FILES if not name.endswith(("png", "gif"))
    }
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    assert not events.Tags()["images"]


@pytest.mark.parametrize(("model", "table", "speed"), MODELS)
def test_a_run_without_a_search(
    model: str, table: str, speed: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("search=ordinary", "genes.fixed.step_width=0.1", "pictures=false", f"speed={speed}", "beta=0.2")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words, f"model={model}", f"hydra.run.dir={tmp_path}"])
    assert main() == 0
    metrics = read(tmp_path, "metrics.json")
    assert (metrics["evaluations"], metrics["search"], metrics["genes"]) == (1, "ordinary", f"{table}+step_width=0.1")
    assert metrics["energy_rate"] == pytest.approx(0.25, rel=0.2)
    assert read(tmp_path, "genes.json")["genes"]["step_width"] == {"value": 0.1, "unit": "leg"}


def test_a_run_without_a_search_that_is_impossible_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("model=smooth", "search=ordinary", "genes.fixed.touchdown_angle=70", f"hydra.run.dir={tmp_path}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 1
    said = capsys.readouterr().err
    assert said == "hopdiff: The one candidate tried is not a possible run: A foot passes below the ground.\n"


def test_the_gif_moves_at_true_speed(finished: Path) -> None:
    with Image.open(finished / "motion.gif") as image:
        assert image.n_frames > 10
        shown = sum(frame.info["duration"] for frame in ImageSequence.Iterator(image))  # ms
    metrics = read(finished, "metrics.json")
    stride = 1000 * (metrics["frames"] - 1) * metrics["frame_time"]
    assert shown == pytest.approx(max(1, round(shown / stride)) * stride, abs=5.0)


def ordinary(folder: Path, monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    fixed = ("model=smooth", "search=ordinary", "speed=3", "beta=0.2", f"hydra.run.dir={folder}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *fixed, *words])
    return main()


def test_films_of_other_kinds_and_pictures_that_leave_the_motion_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is drawn is sampled far denser than what is written."""
    made = []
    monkeypatch.setattr("hopdiff.tasks.results.write_film", lambda path, film: made.append((path.name, film)))
    assert ordinary(tmp_path / "bare", monkeypatch, "pictures=false", "animation=mp4") == 0
    assert not made
    assert ordinary(tmp_path / "drawn", monkeypatch, "animation=gif") == 0
    (name, film) = made.pop()
    assert name == "motion.gif"
    metrics = read(tmp_path / "drawn", "metrics.json")
    stride, frames = 2.0 / metrics["step_frequency"], metrics["frames"]
    assert film.caption == (
        "3 m/s, beta 0.2",
        f"model smooth, ordinary search; a stride of {stride:.3f} s at true speed",
    )
    assert (tmp_path / "drawn" / "strip.png").is_file()
    for file in ("motion.bvh", "motion_in_place.bvh", "genes.json"):
        written = (tmp_path / "drawn" / file).read_text()
        assert written == (tmp_path / "bare" / file).read_text()
        assert ("Frames: " in written) == file.endswith("bvh")
        assert f"Frames: {frames}" in written or file == "genes.json"
    monkeypatch.setattr("hopdiff.tasks.results.write_pictures", lambda *_: {})
    for kind in ("webp", "none"):
        if "WEBP" in Image.SAVE_ALL or kind == "none":
            assert ordinary(tmp_path / kind, monkeypatch, f"animation={kind}") == 0
    assert [name for name, _ in made] in ([], ["motion.webp"])


def test_a_replay_has_no_search_to_tell_of(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr("hopdiff.tasks.results.write_film", lambda path, film: made.append(film.caption))
    monkeypatch.setattr("hopdiff.tasks.results.write_pictures", lambda *_: {})
    words = ("task=replay", f"genes_file={finished / 'genes.json'}", f"hydra.run.dir={tmp_path}")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    assert main() == 0
    assert made[0][0] == "4 m/s, beta 0.5"
    model = read(finished, "metrics.json")["model"]
    assert made[0][1].startswith(f"model {model}, replayed; a stride of ")


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("mpg", "hopdiff: Unknown animation 'mpg': choose one of gif, mp4, none, webp."),
        ("mp4", "hopdiff: animation=mp4 needs an ffmpeg with"),
    ],
)
def test_a_film_that_cannot_be_is_refused_before_the_search(
    kind: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("hopdiff.plots.encoders.imageio_ffmpeg", None)
    assert ordinary(tmp_path / "run", monkeypatch, f"animation={kind}") == 1
    err = capsys.readouterr().err
    assert err.startswith(said)
    assert err.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_pictures_are_drawn_from_dense_frames() -> None:
    job = build_job(compose(["model=smooth", "search=ordinary", "speed=3", "beta=0.2", "fps=30"]))
    run = search_run(job)
    drawn = densely(job, run).motion
    assert float(drawn.times[1]) == pytest.approx(1e-3, rel=0.01)
    assert drawn.phases == run.motion.phases
    assert drawn.times[-1] == run.motion.times[-1]
    for name, curve in run.motion.angles.items():
        at = np.interp(run.motion.times, drawn.times, drawn.angles[name])
        np.testing.assert_allclose(at, curve, atol=2e-3)
    assert run.motion.clip.frames < 40


def test_python_fixes_genes_as_the_command_line_does() -> None:
    settings = ("genes.fixed.step_width=0.1", "genes.common_eta=true")
    run = hopdiff.generate(4, 0.2, model="smooth", search="ordinary", settings=settings)
    assert run.genes["step_width"] == 0.1
    assert run.metrics["genes"] == "default+common_eta+step_width=0.1"


def test_python_gives_the_same_run(either: Path) -> None:
    model = read(either, "metrics.json")["model"]
    settings = ("search.population=40", *(LEAST if model == "body" else ()))
    run = hopdiff.generate(4, 0.5, model=model, seed=3, fps=30, search="ga", evaluations=200, settings=settings)
    genes = {name: entry["value"] for name, entry in read(either, "genes.json")["genes"].items()}
    assert genes == run.genes


def test_ctrl_c_keeps_the_best_so_far(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def impatient(evaluations: int) -> Iterator[OnStep]:
        def on_step(row: object, result: object) -> None:
            if getattr(row, "step") == 2:  # noqa: B009
                os.kill(os.getpid(), signal.SIGINT)

        yield on_step

    monkeypatch.setattr("hopdiff.tasks.run.progress", impatient)
    monkeypatch.chdir(tmp_path)
    words = ("speed=3", "beta=0.2", "search=ga", "search.population=20", "fps=30", "hydra.run.dir=run")
    monkeypatch.setattr("sys.argv", ["hopdiff", *words])
    # A shell's background jobs ignore the signal, and so would this process if it is one.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as done:
            main()
    finally:
        signal.signal(signal.SIGINT, before)
    assert done.value.code == 130
    assert "Interrupted" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "run").iterdir()} >= FILES
    assert len(history(tmp_path / "run")) == 3


def test_the_default_folder_says_what_is_in_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("hopdiff.tasks.results.write_pictures", lambda *_: {})
    monkeypatch.setattr("hopdiff.tasks.results.write_moving", lambda *_: None)
    arguments = ("+experiment=neutral", "model=smooth", "speed=3", "search=random", "budget.evaluations=20")
    monkeypatch.setattr("sys.argv", ["hopdiff", *arguments])
    assert main() == 0
    (folder,) = (tmp_path / "outputs").iterdir()
    assert folder.name.endswith("_v3.0_beta0.2_random_seed0")
