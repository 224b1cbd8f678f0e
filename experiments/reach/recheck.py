"""The runs of the table priced again from their genes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import torch

from experiments.provenance import Recheck, compared
from experiments.report import read_table
from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.problem import RunProblem

ASKED = ("speed", "beta", "seed")


def recheck(folder: Path) -> Recheck:
    """Cost, gamma, energy and times of every run of runs.csv, from genes.csv."""
    return compared(_pairs(folder))


def _pairs(folder: Path) -> Iterator[tuple[str, dict[str, float], dict[str, float]]]:
    rows = list(zip(read_table(folder / "runs.csv"), read_table(folder / "genes.csv"), strict=True))
    for (speed, beta), group in groupby(rows, lambda pair: (pair[0]["speed"], pair[0]["beta"])):
        runs = list(group)
        problem = build_job(compose(["model=smooth", f"speed={speed}", f"beta={beta}"])).problem
        assert isinstance(problem, RunProblem)
        values = [[float(genes[name]) for name in problem.table.names] for _, genes in runs]
        genes = problem.table.to_unit(torch.tensor(values, dtype=torch.float64))
        found, steps = problem.evaluate(genes, False), problem.trajectory(genes)
        today = {
            "cost": found.cost,
            "gamma": found.terms["gamma"],
            "energy_rate": found.terms["energy"],
            "contact_time": steps.contact_time,
            "flight_time": steps.flight_time,
        }
        for k, (row, asked) in enumerate(runs):
            name = ", ".join(f"{key} {row[key]}" for key in ASKED)
            assert all(float(row[key]) == float(asked[key]) for key in ASKED)
            yield name, {key: float(row[key]) for key in today}, {key: float(v[k]) for key, v in today.items()}
