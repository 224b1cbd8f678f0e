"""Writing a finished run into its folder, and telling the user about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from hopdiff.export.tables import write_npz
from hopdiff.io.bvh import write_bvh
from hopdiff.io.events import final_numbers, write_events
from hopdiff.io.genes_file import write_genes
from hopdiff.io.record import write_json, write_settings, write_table
from hopdiff.io.run_folder import Note
from hopdiff.job import Job, Run
from hopdiff.messages import plural
from hopdiff.plots.angles import angles_figure
from hopdiff.plots.animation import stride_film
from hopdiff.plots.com_track import com_track_figure
from hopdiff.plots.convergence import convergence_figure
from hopdiff.plots.film import Film, write_film
from hopdiff.plots.front import front_figure
from hopdiff.plots.save import save_figure
from hopdiff.plots.strip import strip_figure
from hopdiff.runs.settings import typed_values
from hopdiff.search.loop import BUDGET, CONVERGED, HistoryRow, SearchResult

# Said of a search that ended by itself, or by its budget: whether there was more to gain.
ENDINGS = {CONVERGED: ", nothing more to gain", BUDGET: ", budget spent"}
DRAWN_FPS = 1000.0  # frames/s of what is drawn: curves are smooth, and poses are those of their moments


def write_found(folder: Path, job: Job, result: SearchResult) -> None:
    """Write what a search has found, before anything is made of it: genes and history. The settings are there."""
    values = job.table.to_physical(result.best_genes).tolist()
    write_genes(folder / "genes.json", job.saved, dict(zip(job.table.names, values, strict=True)), job.table.units)
    write_history(folder, result.history)


def write_run(folder: Path, job: Job, run: Run, command: Sequence[str]) -> None:
    """Write everything a run leaves behind, numbers first. command: the overrides typed by the user.

    Raises HopdiffError if a file cannot be written.
    """
    write_numbers(folder, job, run)
    write_motion(folder, run)
    write_bvh(folder / "motion_in_place.bvh", run.clip.in_place())
    pictures = {}
    if job.settings["pictures"]:
        drawn = densely(job, run)
        pictures = write_pictures(folder, stride_figures(drawn))
        write_moving(folder, job, stride_film(drawn.motion, caption(run)))
    write_run_events(folder, run, command, pictures)


def write_motion(folder: Path, run: Run) -> None:
    """Write the motion: for other programs, and with everything known of it for task=export."""
    write_bvh(folder / "motion.bvh", run.clip)
    write_npz(folder / "motion.npz", run.take())


def write_numbers(folder: Path, job: Job, run: Run) -> None:
    """Write all of a run that is no motion: genes, metrics, history, and the settings as they were used."""
    write_genes(folder / "genes.json", job.saved, run.genes, job.table.units)
    write_json(folder / "metrics.json", run.metrics)
    write_history(folder, run.history)
    write_settings(folder, job.settings)


def write_history(folder: Path, history: Sequence[HistoryRow]) -> None:
    """Write every step of a search, with the terms of its best candidate's cost, if there was a search."""
    if history:
        rows = [row.flat() for row in history]
        columns = list(dict.fromkeys(name for row in rows for name in row))
        write_table(folder / "history.csv", columns, ([row.get(name) for name in columns] for row in rows))


def write_run_events(folder: Path, run: Run, command: Sequence[str], pictures: Mapping[str, Path]) -> None:
    """Write TensorBoard events of a run, with its pictures in them."""
    write_events(
        folder,
        scalars=[_scalars(row) for row in run.history],
        settings=typed_values(command),
        results=final_numbers(run.metrics),
        pictures=pictures,
    )


Figures = dict[str, Callable[[], Figure]]  # name -> what draws it


def stride_figures(run: Run) -> Figures:
    """The pictures of one stride."""
    title = name_of(run)
    figures: Figures = {
        "strip": lambda: strip_figure(run.motion, title),
        "com_track": lambda: com_track_figure(run.motion, title=title),
        "angles": lambda: angles_figure(run.motion, title),
    }
    if limps(run):
        figures["front"] = lambda: front_figure(run.motion, title)
    return figures | search_figures(run)


def search_figures(run: Run) -> Figures:
    """The picture of the search, if there was one."""
    if len(run.history) < 2:
        return {}
    title = f"{name_of(run)}: {run.metrics['search']} search"
    return {"convergence": lambda: convergence_figure(run.history, title, run.metrics["energy_target"])}


def densely(job: Job, run: Run) -> Run:
    """A straight run with so many frames that pictures do not show them; its numbers are the same."""
    genes = job.table.to_unit(job.table.low.new_tensor(list(run.genes.values())))
    return replace(run, motion=job.problem.motion(genes, DRAWN_FPS))


def name_of(run: Run) -> str:
    """What a run is asked for, for titles."""
    return f"{run.metrics['speed']:.3g} m/s, beta {run.metrics['beta']:g}"


def caption(run: Run) -> tuple[str, str]:
    """The lines over a film: what was asked for, and how the run was come by."""
    how = f"{run.metrics['search']} search" if run.history else "replayed"
    return name_of(run), f"model {run.metrics['model']}, {how}"


def write_moving(folder: Path, job: Job, film: Film) -> None:
    """Write motion.gif, or what the setting `animation` says instead, if anything."""
    if (kind := job.settings["animation"]) != "none":
        write_film(folder / f"motion.{kind}", film)


def write_pictures(folder: Path, figures: Figures) -> dict[str, Path]:
    """Draw and write; returns the pictures by name."""
    paths = {name: folder / f"{name}.png" for name in figures}
    for name, draw in figures.items():
        save_figure(draw(), paths[name])
    return paths


def limps(run: Run) -> bool:
    """Whether one leg carries longer than the other, beyond the frames of the stepping model."""
    left, right = run.metrics["contact_time_left"], run.metrics["contact_time_right"]
    return bool(abs(left - right) > 0.01 * max(left, right))


def summary(folder: Path, job: Job, run: Run, notes: Sequence[Note] = ()) -> str:
    """The table at the end of a run: what was asked, what was reached, where the files are."""
    m = run.metrics
    # At beta 0 the target is zero, which nobody reaches: there is no percentage to give.
    miss = f" ({100.0 * (m['energy_rate'] / m['energy_target'] - 1.0):+.1f} %)" if m["energy_target"] else ""
    searched = (
        f"{m['search']}, {plural(m['evaluations'], 'evaluation')}, {plural(m['gradient_evaluations'], 'gradient')},"
        f" {m['wall_seconds']:.1f} s, {100 * m['invalid_fraction']:.0f} % impossible{ENDINGS.get(m['stopped'], '')}"
    )
    rows = [
        ("asked", f"speed {m['speed']:g} m/s, beta {m['beta']:g}, so energy {m['energy_target']:.3f}"),
        ("reached", f"energy {m['energy_rate']:.3f}{miss}, cost {m['cost']:.4f}, {_quality(m)}"),
        (
            "",
            f"contact {m['contact_time']:.3f} s, flight {m['flight_time']:.3f} s, bounce {m['com_oscillation']:.3f} m",
        ),
        (
            "",
            f"{m['step_frequency']:.2f} steps/s of {m['step_length']:.2f} m, knee to {m['knee_swing_max_deg']:.0f} deg",
        ),
        *([("limp", _limp(m))] if limps(run) else []),
        ("searched", searched if run.history else "not at all: replayed from a genes file"),
        *(("note", note.sentence) for note in notes),
        ("files", shown(folder)),
    ]
    return "\n".join(f"{name:<9} {text}" for name, text in rows)


def _quality(m: Mapping[str, Any]) -> str:
    """What a run of its model is judged by besides: of the whole body the ground force, else connectivity."""
    if "friction_needed" in m:
        return f"force up to {m['peak_force_bw']:.2f} body weights, friction {m['friction_needed']:.2f}"
    return f"gamma {m['gamma']:.3f}"


def _limp(m: Mapping[str, Any]) -> str:
    carried = f"contact left {m['contact_time_left']:.3f} s, right {m['contact_time_right']:.3f} s"
    if abs(m["trunk_side_deg"]) < 0.05:
        return carried
    side = "left" if m["trunk_side_deg"] > 0 else "right"
    return f"{carried}, trunk {abs(m['trunk_side_deg']):.1f} deg to the {side}"


def shown(folder: Path) -> str:
    """A folder as the user would type it."""
    return str(folder.relative_to(Path.cwd())) if folder.is_relative_to(Path.cwd()) else str(folder)


def _scalars(row: HistoryRow) -> dict[str, float]:
    return {f"search/{name}": float(value) for name, value in row.flat().items() if name != "step"}
