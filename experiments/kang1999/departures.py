"""What departs from print in model=thesis, and what it does: python -m experiments.kang1999.departures"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

import hopdiff
from experiments.kang1999 import take_off
from experiments.kang1999.variants import (
    ASKED,
    COLUMNS,
    LEGS,
    VARIANTS,
    Connection,
    draws,
    measured,
    problem_of,
    shares,
    take_offs,
)
from experiments.report import markdown, origin
from hopdiff.io.files import write_whole
from hopdiff.io.record import write_table
from hopdiff.limits import excesses
from hopdiff.metrics import loop_error
from hopdiff.models.base import hopper_cycle
from hopdiff.models.gait import stride_motion
from hopdiff.models.thesis import ThesisModel
from hopdiff.physics.stepping import flight_blend, step_hopper
from hopdiff.plots.save import save_figure
from hopdiff.search.ga import GA
from hopdiff.search.loop import Budget
from hopdiff.types import Status

HERE = Path(__file__).parent
SPEEDS = (2.0, 5.0, 10.0)


def main(arguments: Sequence[str] | None = None) -> None:
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(prog="python -m experiments.kang1999.departures", description=__doc__)
    parser.add_argument("--count", type=int, default=256, help="random genes a row")
    parser.add_argument("--evaluations", type=int, default=3000, help="of each search for the least gamma")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for departures.md, .csv and take_off.png")
    options = parser.parse_args(words)
    options.out.mkdir(parents=True, exist_ok=True)
    made = origin("kang1999.departures", words)
    rows = [(variant, measured(variant, options.count)) for variant in VARIANTS]
    table = [(variant.name, options.count, *(format(row[name], ".8g") for name in COLUMNS)) for variant, row in rows]
    write_table(options.out / "departures.csv", ("variant", "count", *COLUMNS), table)
    parts = [
        f"{made} Settings: `{' '.join(ASKED)}` and, unless a row says otherwise, those that follow from them:"
        " `costs=thesis genes=thesis model.knee=printed`.",
        *departures(options.count),
        "## Rows of settings\n\nMedians over the possible ones of the same"
        f" {options.count} random genes (with `genes=default` other genes).",
        markdown(("settings", *COLUMNS), ([v.name, *(f"{row[c]:.4g}" for c in COLUMNS)] for v, row in rows)),
        *connections(options.count, options.evaluations),
    ]
    text = "\n\n".join(("# Where model=thesis departs from print", *parts)) + "\n"
    write_whole(options.out / "departures.md", text)
    found = [take_off.best(knee, 2 * options.evaluations) for knee in ("printed", "joined")]
    save_figure(take_off.figure(found), options.out / "take_off.png", dpi=110)
    print(text)


def departures(count: int) -> Iterator[str]:
    """The table of what departs, with what only a computation of its own can show."""
    problem = problem_of()
    genes = draws(problem, count)
    found = problem.evaluate(genes, False)
    possible = found.status == int(Status.OK)
    steps = problem.trajectory(genes[possible])
    take = take_offs(problem, steps)
    h, guard = problem.model.step, problem.settings.gamma_guard  # type: ignore[attr-defined]
    gamma = shares(take, guard)
    four, all_of_them = gamma[:, : len(LEGS)].sum(-1), gamma.sum(-1)
    ahead = take.last + take.change  # without the h that is missing in print
    missing = ((take.after - ahead) ** 2 / (torch.minimum(take.after**2, ahead**2) + guard**2))[:, : len(LEGS)].sum(-1)

    genes_si = problem.table.decode(genes)
    speed = torch.full((count,), problem.speed, dtype=genes.dtype)
    cycle = hopper_cycle(problem.character, genes_si, speed)
    still = step_hopper(
        cycle.leg_length, cycle.touchdown_angle, speed, cycle.stiffness, torch.zeros_like(speed), h, 1, 400
    )
    flies = still.alive.sum(-1) > 0
    flies &= (still.hop[:, -1] > 0) & possible
    air = (still.flight.amax(-1))[flies]
    ground = ((still.alive & ~still.in_flight).sum(-1) * h)[flies]

    alpha, duration = genes_si["alpha"][possible], take.duration
    literal = 1.0 / (1.0 - 2.0 * alpha) - 2.0 * alpha * duration / (duration + 1.0 - 2.0 * alpha)
    whole = flight_blend(torch.ones(len(alpha), 1, dtype=alpha.dtype), alpha)

    sums = {step: _printed_energy(step, count) for step in (0.01, 0.005, 0.0025)}
    everyday = problem.table.everyday
    gaps = {
        strides: loop_error(stride_motion(ThesisModel(problem.character, h, strides).gait(everyday, speed[:1]), 60.0))
        for strides in (0, 8, 40)
    }
    excess = excesses(problem.trajectory(genes), problem.character, problem.settings.limits)
    broken = ", ".join(f"{kind.name.lower()} {int((value > 0).sum())}" for kind, value in excess.items())

    def middle(values: torch.Tensor) -> str:
        return f"{float(values.median()):.4g}"

    yield (
        "## Departures\n\nWhere a setting brings a departure or takes it away, its effect is a row of the next table."
    )
    yield markdown(
        ("what", "in print", "here", "effect"),
        (
            (
                "vertical speed at touchdown",
                "missing",
                "that of the hop which repeats itself",
                f"from 0 m/s {int(flies.sum())} of {int(possible.sum())} possible runs take off at all: contact"
                f" {middle(ground)} s and flight {middle(air)} s, against {middle(steps.contact_time)} and"
                f" {middle(steps.flight_time)} s",
            ),
            (
                "mass",
                "a gene",
                "none: m stands under kappa only",
                "none",
            ),
            (
                "knee in flight, (5)",
                "theta_l linear in time",
                "the same; `model.knee=flexion` blends the knee's flexion, as runs before did",
                "rows `model.knee`",
            ),
            (
                "B_c, (6)",
                "denominator T + (1 - 2 alpha)",
                "T (1 - 2 alpha), for which B_c(T) = 1",
                f"at t = T printed {middle(literal)}, here {middle(whole)} (medians): the leg would land elsewhere",
            ),
            (
                "balance, (10)",
                "from frame to frame, no start given",
                "from an upright body at rest; a step for the costs, 8 strides before the one that is shown",
                "jump at the end of the everyday stride after "
                + ", ".join(f"{strides} strides {gap:.3g}" for strides, gap in gaps.items())
                + " rad or m",
            ),
            (
                "where the balance aims, (7)",
                "at the foot",
                "the same; with `genes=default` ahead of it by `com_lead`",
                "row `genes.fixed.com_lead`",
            ),
            (
                "gamma, (12): prediction",
                "rate + acceleration",
                "rate + h acceleration",
                f"median {middle(missing)} without the h, {middle(four)} with it",
            ),
            (
                "gamma, (12): ratio",
                "max / min of signed rates",
                "larger over smaller, 1 rad/s added in quadrature; a change of sign counts",
                "row `costs.gamma=printed`",
            ),
            (
                "gamma, (12): joints",
                "all n",
                "the four of the legs",
                f"median {middle(four)} of four, {middle(all_of_them)} of all nineteen channels",
            ),
            (
                "E_r, (12): sum",
                "over frames, without dt",
                "integral over time",
                "the printed sum at h .01, .005, .0025 s: "
                + ", ".join(f"{value:.4g}" for value in sums.values())
                + "; here rows `model.step`",
            ),
            (
                "E_r, (12): units",
                "rad^2 kg m^2 / s^4 and N m added",
                "each made dimensionless, over m g times the way, in units of four everyday runs",
                f"the unit is {problem.ordinary.energy_unit:.4g} here",
            ),
            (
                "E_r, (12): take-off",
                "the jump of rates is in the sum",
                "left out (`model.impulse=true` puts it in)",
                "rows `model.impulse`: it grows as 1 / h",
            ),
            (
                "pelvis and arms",
                "not spoken of",
                "the pelvis does not turn; arms do nothing but answer the balance",
                "row `genes=default`: arms that swing, posture as genes",
            ),
            (
                "what is impossible",
                "not said",
                "limits of leg force, joints, ground, reach, flight (conf/costs/default.yaml)",
                f"of {count} random genes {int((~steps_solved(found)).sum())} have no repeating hop; broken: {broken}",
            ),
            (
                "other terms of the merit",
                "none",
                "none; `costs=default` has them",
                "row `costs=default`",
            ),
        ),
    )


def steps_solved(found: hopdiff.search.base.Eval) -> torch.Tensor:
    return found.status != int(Status.STANCE_UNSOLVED)


def _printed_energy(step: float, count: int) -> float:
    """Median of E_r, equation (12), to the letter: a sum over frames without dt, in SI units."""
    problem = problem_of(f"model.step={step}", "model.impulse=true")
    genes = draws(problem, count)
    possible = problem.evaluate(genes, False).status == int(Status.OK)
    steps, body = problem.trajectory(genes[possible]), problem.character
    from_joints = hopdiff.costs.joint_effort(steps, body).sum(-1) / step
    torque = body.mass * 9.81 * steps.balance_error.norm(dim=-1)
    from_torque = (torque * steps.weights).sum(-1) / step
    return float(((from_joints + from_torque) / (steps.speed * steps.duration)).median())


def connections(count: int, evaluations: int) -> Iterator[str]:
    """Whether any run connects stance to flight, by speed, table of genes and knee."""
    yield (
        "## Does any run connect?\n\ngamma, form ratio, of the possible ones of"
        f" {count} random genes, and the least that a search for gamma alone (`ga`, {evaluations} evaluations) finds."
        " The last columns are medians of what each leg channel adds. Where gamma is 4, the carrying knee turns its"
        " rate x into -x: 4 x^2 / (x^2 + 1)."
    )
    rows = []
    for speed in SPEEDS:
        for words in (("genes=default",), (), ("model.knee=joined",)):
            problem = problem_of(f"speed={speed:g}", *words)
            genes = draws(problem, count)
            found = problem.evaluate(genes, False)
            possible = found.status == int(Status.OK)
            take = take_offs(problem, problem.trajectory(genes[possible]))
            parts = shares(take, problem.settings.gamma_guard)[:, : len(LEGS)]
            turned = (take.before[:, 2] * take.after[:, 2] < 0).double().mean()
            gamma = parts.sum(-1)
            least = hopdiff.optimise(Connection(problem), GA(), Budget(evaluations)).best_cost
            rows.append(
                (
                    f"{speed:g} m/s {' '.join(words)}",
                    f"{int((gamma < 4).sum())} of {len(gamma)}",
                    f"{float(gamma.min()):.3g}",
                    f"{float(gamma.median()):.3g}",
                    f"{least:.3g}",
                    f"{100 * float(turned):.0f} %",
                    *(f"{float(value):.3g}" for value in parts.median(0).values),
                )
            )
    heading = ("runs", "gamma below 4", "least", "median", "searched", "carrying knee turns", *LEGS)
    yield markdown(heading, rows)


if __name__ == "__main__":
    main()
