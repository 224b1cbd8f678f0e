"""How far is the cost of a whole-body run from that on many more nodes? python -m experiments.nodes"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from experiments.report import floats, markdown, origin
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.effort.priced import Priced
from hopdiff.effort.problem import BodyProblem
from hopdiff.io.files import write_whole
from hopdiff.job import find
from hopdiff.whole_body.dynamics import dynamics
from hopdiff.whole_body.plan import FLIGHT, STANCE

HERE = Path(__file__).parent
TRIED = ((17, 11), (25, 15), (29, 17), (STANCE, FLIGHT), (41, 25))
MANY = (97, 57)  # what all are held against
ROUNDS = 60  # of every solution: what is left is the nodes' alone
NEAR, AWAY = 0.03, 0.1  # of candidates about the best run and about the start, in box widths
COUNT = 8  # of each


def main(arguments: Sequence[str] | None = None) -> None:
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(prog="python -m experiments.nodes", description=__doc__)
    parser.add_argument("--speeds", type=floats, default=[3, 5, 8], help="m/s")
    parser.add_argument("--evaluations", type=int, default=1000, help="budget of the search for the best run")
    parser.add_argument("--out", type=Path, default=HERE, help="folder for results.md")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    rows, parts = [], []
    for speed in options.speeds:
        job = build_job(compose([f"speed={speed}", "beta=0.2", f"budget.evaluations={options.evaluations}"]))
        assert isinstance(job.problem, BodyProblem)
        best = find(job).best_genes
        rows += errors(job.problem, best, f"{speed:g} m/s")
        parts += shares(job.problem, best, f"{speed:g} m/s")
    text = "\n".join(
        (
            "# Nodes: how far a cost is from that on many more",
            "",
            origin("nodes", arguments),
            "",
            f"Objective `{job.settings['costs']['name']}`, beta 0.2. Relative distance of the cost from that on"
            f" {MANY[0]} + {MANY[1]} nodes a step, the movement solved to rounding on both; a search works on {STANCE}"
            f" + {FLIGHT}. The best run, and medians and largest of {COUNT} candidates {NEAR:g} box widths about it and"
            f" {AWAY:g} about the start of searches (standard deviations).",
            "",
            markdown(("run", "nodes", "best", "about it", "largest", "about the start", "largest"), rows),
            f"Parts of the cost of the best run on {STANCE} + {FLIGHT} nodes, and how far each is off, both over the"
            " whole cost.",
            "",
            markdown(("run", "part", "share", "off by"), parts),
        )
    )
    write_whole(options.out / "results.md", text)
    print(text)


def priced(problem: BodyProblem, genes: Tensor, nodes: tuple[int, int]) -> tuple[Tensor, dict[str, Tensor]]:
    """Merit (P,) and terms of candidates (P, G) on so many nodes in stance and flight."""
    model = replace(problem.model, plan=replace(problem.model.plan, nodes=nodes))
    with torch.no_grad():
        speed = torch.full((len(genes),), problem.speed, dtype=genes.dtype, device=genes.device)
        movement = model.movement(problem.table.decode(genes), speed)
        state, moved = movement.solve(ROUNDS)
        body = movement.body(state)
        bill = problem.pricing.price(Priced(movement, body, dynamics(movement, body), moved))
    return bill.merit, bill.terms


def candidates(problem: BodyProblem, best: Tensor) -> Tensor:
    """(1 + 2 COUNT, G): the best run, some about it, and some about the start."""
    noise = torch.randn(2, COUNT, len(best), dtype=best.dtype, generator=torch.Generator().manual_seed(0))
    about = torch.cat((best + NEAR * noise[0], problem.start + AWAY * noise[1])).clamp(0.0, 1.0)
    return torch.cat((best.unsqueeze(0), about))


def errors(problem: BodyProblem, best: Tensor, name: str) -> list[tuple[str, ...]]:
    """A row for every number of nodes."""
    genes = candidates(problem, best)
    wanted, _ = priced(problem, genes, MANY)
    rows = []
    for nodes in TRIED:
        off = (priced(problem, genes, nodes)[0] / wanted - 1.0).abs()
        near, away = off[1 : 1 + COUNT], off[1 + COUNT :]
        shown = (off[0], near.median(), near.max(), away.nanmedian(), away[away.isfinite()].max())
        rows.append((name, f"{nodes[0]} + {nodes[1]}", *(f"{float(x):.1e}" for x in shown)))
    return rows


def shares(problem: BodyProblem, best: Tensor, name: str) -> list[tuple[str, ...]]:
    """A row for every part of the cost that is not nothing."""
    wanted, many = priced(problem, best.unsqueeze(0), MANY)
    _, own = priced(problem, best.unsqueeze(0), (STANCE, FLIGHT))
    rows = []
    for part, value in many.items():
        share, off = float(value / wanted), float((own[part] - value) / wanted)
        if part != "energy" and max(abs(share), abs(off)) > 1e-6:
            rows.append((name, part, f"{share:.3f}", f"{off:.0e}"))
    return rows


if __name__ == "__main__":
    main()
