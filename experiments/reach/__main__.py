"""Does the default search keep its promises with the smooth model? python -m experiments.reach"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import hopdiff
from experiments.reach.bars import BARS, Row, energy_error, per_pair, trend_breaks
from experiments.reach.picture import trends_figure
from experiments.report import first_line, floats, integers, markdown, origin, read_table
from hopdiff.io.files import write_whole
from hopdiff.io.record import write_table
from hopdiff.plots.save import save_figure

HERE = Path(__file__).parent
ASKED = ("speed", "beta", "seed")  # of a run
KEPT = (
    *("speed", "beta", "seed", "cost", "energy_rate", "energy_target", "gamma", "contact_time", "flight_time"),
    *("flight_share", "com_oscillation", "arm_swing_deg", "peak_leg_force_bw", "knee_touchdown_deg"),
    *("knee_stance_max_deg", "knee_swing_max_deg", "trunk_lean_deg", "step_frequency", "step_length", "duty_factor"),
    *("stance_foot_drift", "min_foot_clearance", "loop_error", "joint_limit_excess_deg"),
    *("evaluations", "gradient_evaluations", "invalid_fraction", "wall_seconds"),
)


def main(arguments: Sequence[str] | None = None) -> None:
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = parser().parse_args(words)
    options.out.mkdir(parents=True, exist_ok=True)
    table, kept = options.out / "runs.csv", options.out / "genes.csv"
    if options.redraw:
        made = first_line(options.out / "results.md")
    else:
        made = origin("reach", words)
        found = runs(options)
        rows = [row for row, _ in found]
        write_table(table, list(rows[0]), ([format(cell, ".6g") for cell in row.values()] for row in rows))
        # What the runs are made from: `python -m experiments.check` prices them again.
        asked = [{name: row[name] for name in ASKED} | genes for row, genes in found]
        write_table(kept, list(asked[0]), ([format(cell, ".10g") for cell in row.values()] for row in asked))
    # As they were written, so that drawing them again gives the same digits.
    rows = [{name: float(cell) for name, cell in row.items()} for row in read_table(table)]
    text = f"{made}\n\n{report(rows)}"
    write_whole(options.out / "results.md", text)
    save_figure(trends_figure(rows, read_table(HERE / "humans.csv")), options.out / "trends.png", dpi=110)
    print(text)


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m experiments.reach", description=__doc__)
    parser.add_argument("--speeds", type=floats, default=[2, 3, 4.5, 6, 8, 10], help="m/s")
    parser.add_argument("--betas", type=floats, default=[0, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9])
    parser.add_argument("--seeds", type=integers, default=[0, 1, 2])
    parser.add_argument("--search", default=argparse.SUPPRESS, help="another one than the default")
    parser.add_argument("--evaluations", type=int, default=argparse.SUPPRESS, help="another budget than the default")
    parser.add_argument("--processes", type=int, default=1, help="runs side by side")
    parser.add_argument("--redraw", action="store_true", help="only table and picture again, from runs.csv")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for runs.csv, results.md and trends.png")
    return parser


def runs(options: argparse.Namespace) -> list[tuple[Row, Row]]:
    """Metrics and genes of each run, in order of speed, beta and seed."""
    chosen = {name: value for name, value in vars(options).items() if name in ("search", "evaluations")}
    asked = [(*run, chosen) for run in product(options.speeds, options.betas, options.seeds)]
    rows = []
    with ProcessPoolExecutor(options.processes) as pool:
        for row, genes in pool.map(measured, *zip(*asked, strict=True)):
            print(f"{row['speed']:g} m/s beta {row['beta']:g} seed {row['seed']:g}: cost {row['cost']:.4f}", flush=True)
            rows.append((row, genes))
    return rows


def measured(speed: float, beta: float, seed: int, chosen: dict[str, Any]) -> tuple[Row, Row]:
    """The metrics of one run, and its genes in the units of their table; `travel` is how fast the clip moves."""
    run = hopdiff.generate(speed, beta, seed=seed, model="smooth", **chosen)
    clip = run.clip
    travel = (clip.root_position[-1, 2] - clip.root_position[0, 2]) / (clip.frame_time * (clip.frames - 1))
    return {**{name: float(run.metrics[name]) for name in KEPT}, "travel": float(travel)}, run.genes


def report(rows: Sequence[Row]) -> str:
    """Markdown: every bar with the runs that miss it, the trends, and the table of all (speed, beta)."""
    seeds = len({row["seed"] for row in rows})
    lines = [f"# Reach: {len(rows)} runs, {seeds} seeds each\n", verdicts(rows)]
    failing = [
        f"- {bar.text}: {row['speed']:g} m/s, beta {row['beta']:g}, seed {row['seed']:g}:"
        f" {bar.shown} {shown(row, bar.shown):.4g}"
        for bar in BARS
        for row in rows
        if bar.asked(row) and not bar.met(row)
    ]
    lines += ["## Runs that miss a bar\n", "\n".join(failing) or "None.", ""]
    _, breaks = trend_breaks(rows)
    lines += ["## Steps of beta that go the wrong way\n", "\n".join(f"- {text}" for text in breaks) or "None.", ""]
    lines += ["## All runs\n", overview(rows)]
    return "\n".join(lines)


def verdicts(rows: Sequence[Row]) -> str:
    table = []
    for bar in BARS:
        asked = [bar.met(row) for row in rows if bar.asked(row)]
        table.append((bar.text, f"{sum(asked)} of {len(asked)}", "yes" if all(asked) else "**no**"))
    compared, breaks = trend_breaks(rows)
    trend = "each step of beta: contact shorter, flight share, bounce and arms larger"
    table.append((trend, f"{compared - len(breaks)} of {compared}", "**no**" if breaks else "yes"))
    return markdown(("bar", "kept", "all"), table)


def overview(rows: Sequence[Row]) -> str:
    """Worst of the seeds for energy, drift, clearance, loop; spread of the cost; the mean of all else."""

    def cells(speed: float, beta: float, group: Sequence[Row]) -> list[str]:
        def mean(name: str) -> float:
            return sum(row[name] for row in group) / len(group)

        error = max(energy_error(row) for row in group)
        costs = [row["cost"] for row in group]
        return [
            f"{speed:g}",
            f"{beta:g}",
            f"{100 * error:.2f}" if math.isfinite(error) else f"E = {mean('energy_rate'):.3f}",
            f"{mean('contact_time'):.3f}",
            f"{mean('flight_share'):.2f}",
            f"{100 * mean('com_oscillation'):.1f}",
            f"{mean('arm_swing_deg'):.0f}",
            f"{mean('peak_leg_force_bw'):.2f}",
            " / ".join(f"{mean(f'knee_{phase}_deg'):.0f}" for phase in ("touchdown", "stance_max", "swing_max")),
            f"{mean('trunk_lean_deg'):.0f}",
            f"{mean('step_frequency'):.2f}",
            f"{1e3 * max(row['stance_foot_drift'] for row in group):.1g}",
            f"{1e3 * min(row['min_foot_clearance'] for row in group):.1g}",
            f"{max(row['loop_error'] for row in group):.1g}",
            f"{min(costs):.4f}",
            f"{100 * (max(costs) / min(costs) - 1):.2g}",
            f"{mean('wall_seconds'):.1f}",
        ]

    heading = (
        *("speed m/s", "beta", "energy error %, worst", "contact s", "flight share", "bounce cm", "arms RMS deg"),
        *("leg force BW", "knee touchdown / stance / swing deg", "lean deg", "steps/s", "drift mm", "clearance mm"),
        *("loop error", "cost, best", "cost, worst above best %", "seconds"),
    )
    return markdown(heading, (cells(*key, group) for key, group in per_pair(rows).items()))


def shown(row: Row, column: str) -> float:
    return energy_error(row) if column == "energy_error" else row[column]


if __name__ == "__main__":
    main()
