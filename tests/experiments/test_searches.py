"""The comparison of searches: one meter for all, traces that survive a kill, and the arithmetic of running times."""

from __future__ import annotations

import importlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from hopdiff.search.base import Eval
from hopdiff.search.gradient import Gradient
from hopdiff.types import Status

ROOT = Path(__file__).resolve().parents[2]
SMALL = "--models smooth --characters human --speeds 5 --betas .5 --repeats 1"


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


class Bowl:
    """A sphere about .3 whose far end is impossible. Keeps what it was asked."""

    dimension, dtype, device = 29, torch.float64, torch.device("cpu")
    start, spread, starts, screen = torch.full((29,), 0.5, dtype=torch.float64), 0.1, 3, 18

    def __init__(self) -> None:
        self.asked: list[Tensor] = []
        self.rows = self.grads = 0

    def evaluate(self, genes: Tensor, with_grad: bool) -> Eval:
        self.asked.append(genes.clone())
        self.rows += len(genes)
        self.grads += len(genes) * with_grad
        merit = 1.0 + ((genes - 0.3) ** 2).mean(1)
        bad = genes[:, 0] > 0.7
        status = torch.where(bad, int(Status.NOT_FINITE), int(Status.OK))
        return Eval(merit.masked_fill(bad, math.inf), 2 * (genes - 0.3) / 29 if with_grad else None, merit, {}, status)


def peer(name: str) -> object:
    from experiments.searches.methods import PEERS

    pytest.importorskip(PEERS[name][0])
    return importlib.import_module(f"experiments.searches.peers.{name}")


NAMES = ("pycma", "scipy_lbfgsb", "scipy_de", "evotorch_snes", "nevergrad_ngopt", "pymoo_ga")


@pytest.mark.filterwarnings("ignore")  # the libraries' own
@pytest.mark.parametrize("name", NAMES)
def test_peers_spend_the_budget_as_counted_and_repeat_themselves(name: str) -> None:
    from experiments.searches.meter import Meter, Spent

    ends, firsts = [], []
    for seed in (3, 3, 4):
        bowl = Bowl()
        meter = Meter(bowl, 700, 2.0)
        with pytest.raises(Spent):
            peer(name).run(meter, torch.Generator().manual_seed(seed))  # type: ignore[attr-defined]
        assert (meter.evaluations, meter.gradient_evaluations) == (bowl.rows, bowl.grads)
        spent = bowl.rows + 2.0 * bowl.grads
        assert 700 - 3.0 < spent <= 700
        assert (bowl.grads > 0) == (name == "scipy_lbfgsb")
        assert all(((genes >= 0) & (genes <= 1)).all() for genes in bowl.asked)
        assert meter.log.genes is not None
        again = Bowl().evaluate(meter.log.genes[None], False).cost
        assert float(again) == meter.best == meter.log.points[-1].best
        assert meter.best < 1.05
        ends.append(meter.best)
        firsts.append(torch.cat(bowl.asked)[:50])
    assert ends[0] == ends[1]
    assert torch.equal(firsts[0], firsts[1])
    assert not torch.equal(firsts[0], firsts[2])
    # all begin about the start, none anywhere in the box
    assert float((firsts[0][:4] - 0.5).abs().max()) < 0.5


def test_descents_of_a_peer_begin_where_those_of_hopdiff_do() -> None:
    from experiments.searches.meter import Meter, Spent

    bowl, meter_bowl = Bowl(), Bowl()
    meter = Meter(meter_bowl, 200, 1.0)
    with pytest.raises(Spent):
        peer("scipy_lbfgsb").run(meter, torch.Generator().manual_seed(7), screened=True)  # type: ignore[attr-defined]
    search, generator = Gradient(), torch.Generator().manual_seed(7)
    state = search.init(bowl, generator)
    screened, _ = search.ask(state, generator)
    assert torch.equal(meter_bowl.asked[0], screened)
    state = search.tell(state, screened, bowl.evaluate(screened, False), generator)
    assert torch.equal(meter_bowl.asked[1], search.ask(state, generator)[0])


def test_values_of_impossible_runs_are_finite_and_in_order() -> None:
    from experiments.searches.meter import BEYOND, finite_values

    cost = torch.tensor([2.0, math.inf, math.inf, math.inf, 1.0])
    merit = torch.tensor([2.0, 5.0, 4.0, math.inf, 1.0])
    values = finite_values(cost, merit)
    assert np.argsort(values).tolist() == [4, 0, 2, 1, 3]
    assert values[0] == 2.0
    assert values[3] == 2 * BEYOND


def test_lockstep_prices_what_waits_together_and_passes_failures_on() -> None:
    from experiments.searches.lockstep import Ask, lockstep

    batches: list[list[float]] = []
    kept: dict[int, list[float]] = {0: [], 1: [], 2: []}

    def answer(points: np.ndarray) -> Sequence[float]:
        batches.append(points[:, 0].tolist())
        return (10 * points[:, 0]).tolist()

    def job(number: int) -> object:
        def work(ask: Ask) -> None:
            for step in range(number + 1):
                kept[number].append(ask(np.array([number + 0.1 * step])))

        return work

    lockstep(answer, [job(number) for number in range(3)])  # type: ignore[misc]
    assert batches == [[0.0, 1.0, 2.0], [1.1, 2.1], [2.2]]
    assert kept[2] == [20.0, 21.0, 22.0]

    def broken(ask: Ask) -> None:
        ask(np.zeros(1))
        raise ValueError("mine")

    with pytest.raises(ValueError, match="mine"):
        lockstep(answer, [broken, job(2)])  # type: ignore[list-item]
    with pytest.raises(KeyError):
        lockstep(lambda points: {}["gone"], [job(0), job(2)])  # type: ignore[list-item]


def test_expected_running_time_counts_the_failures() -> None:
    from experiments.searches.analysis import TARGETS, Study, priced
    from experiments.searches.cases import Case
    from experiments.searches.meter import Point
    from experiments.searches.traces import Trace

    case = Case("smooth", 3.0, 0.5)
    luck = Trace("a", case, 0, [Point(100, 0, 1.0, 2.0), Point(200, 50, 2.0, 1.0)])
    loss = Trace("a", case, 1, [Point(100, 0, 1.0, 3.0), Point(400, 100, 4.0, 1.5)])
    study = Study([luck, loss])
    hits = study.hits("a", case, 0.1, priced(2.0))
    assert hits.when.tolist() == [300, math.inf]
    assert hits.expected == 300 + 600
    # of the draws of two seeds a quarter misses twice, a quarter hits twice
    draws = hits.resampled(4000)
    assert np.isinf(draws).mean() == pytest.approx(0.25, abs=0.03)
    assert {300.0, 900.0} == set(draws[np.isfinite(draws)].tolist())
    assert hits.interval() == (300.0, math.inf)
    # a run that is started again misses n times before it hits: 300 + 600 n, on average its expected running time
    restarted = hits.restarted(20_000)
    assert set((restarted - 300) % 600) == {0}
    assert restarted.mean() == pytest.approx(hits.expected, rel=0.03)
    assert study.hits("a", case, 0.5, priced(1.0)).expected == (250 + 500) / 2
    assert study.success("a", 0.1) == 0.5
    assert study.ecdf("a", priced(2.0))[1][-1] == 1.0
    assert len(study.ecdf("a", priced(2.0))[0]) % len(TARGETS) == 0
    # an earlier study may have known better
    assert not np.isfinite(Study([luck, loss], {case: 0.5}).hits("a", case, 0.3, priced(2.0)).when).any()


def test_claims_are_judged_problem_by_problem() -> None:
    from experiments.searches import claims
    from experiments.searches.analysis import Study, priced
    from experiments.searches.cases import Case
    from experiments.searches.meter import Point
    from experiments.searches.report import lost
    from experiments.searches.traces import Trace

    good, bad = Case("body", 3.0, 0.2), Case("body", 5.0, 0.2)

    def trace(method: str, case: Case, *points: tuple[int, int, float, float]) -> Trace:
        return Trace(method, case, 0, [Point(*point) for point in points])

    study = Study(
        [
            trace("ga", good, (10_000, 0, 50.0, 1.2)),
            trace("hybrid", good, (200, 100, 4.0, 1.1), (1000, 500, 20.0, 1.0)),
            trace("pycma", good, (9000, 0, 60.0, 1.0)),
            trace("ga", bad, (10_000, 0, 50.0, 1.2)),
            trace("hybrid", bad, (400, 200, 4.0, 1.1), (1000, 500, 20.0, 1.0)),
            trace("pycma", bad, (100, 0, 1.0, 1.0)),
        ]
    )
    clock = priced(1.0)
    first = claims.hybrid_beats_ga(study, "hybrid", "ga", clock)
    assert [(v.case, v.holds) for v in first] == [(good, True), (bad, False)]
    assert "16.7 x fewer evaluations, 12.5 x less time" in first[1].told
    second = claims.ours_beat_peers(study, claims.ours(study), clock)
    assert [v.holds for v in second] == [True, False]
    text = claims.told(second)
    assert text.startswith("Holds on 1 of 2 problems (50 %): **no**")
    assert "- body, human, 5 m/s, beta 0.2: hybrid: 20 s, 1500 evaluations; soonest peer pycma: 1 s" in text
    rows = lost(study, {"evaluations": clock})
    assert {row[1] for row in rows} == {str(bad)}
    assert rows[0][3] == "pycma"


def test_methods_are_told_apart() -> None:
    from experiments.searches.methods import METHODS, claimed, missing, takes_gradients

    claimed_ones = ["gradient:method=bfgs", "gradient:method=lm", "hybrid", "hybrid:write_back=false"]
    assert [m for m in METHODS if claimed(m)] == claimed_ones
    assert takes_gradients("scipy_lbfgsb:starts=1")
    assert not takes_gradients("scipy_de")
    assert missing("gradient:starts=2") is None
    assert "no search 'nonsense'" in str(missing("nonsense"))


def test_briskness_is_told_in_one_run_of_least_cost(tmp_path: Path) -> None:
    from experiments.searches.cases import Case, build_problem, settings

    (tmp_path / "least_human_v5.json").write_text('{"external_work": 0.11, "contact_time": 0.21}')
    case = Case("body", 5.0, 0.5)
    problem = build_problem(case, tmp_path)
    assert problem.least[:2] == (0.11, 0.21)  # type: ignore[union-attr,index]
    assert problem.spread == 0.1  # type: ignore[union-attr]
    assert not any("least" in word for word in settings(case._replace(beta=0.2), tmp_path))


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
def test_searches_goes_on_where_it_stopped_and_reports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from experiments.searches.__main__ import main

    some = "random ga gradient:starts=4,screen=20 hybrid scipy_lbfgsb:starts=2 scipy_de nonsense"
    arguments = f"{SMALL} --evaluations 400 --traces {tmp_path}/traces --out {tmp_path} --methods {some}".split()
    main([*arguments, "--seeds", "0"])
    said = capsys.readouterr().out
    assert "nonsense is left out: hopdiff has no search 'nonsense'" in said
    assert said.count("seed 0:") == 6
    main([*arguments, "--seeds", "0-1", "--plan"])
    assert "| all | 6 |" in capsys.readouterr().out
    main([*arguments, "--seeds", "0-1"])
    said = capsys.readouterr().out
    assert "seed 0:" not in said
    assert said.count("seed 1:") == 6
    text = (tmp_path / "results.md").read_text()
    assert "| gradient:starts=4,screen=20 |" in text
    assert "| scipy_de (peer) |" in text
    assert "Left out: `nonsense`" in text
    assert "| ordinary | 0.4 | style |" in text
    assert str(tmp_path) not in text
    for name in ("results_ecdf_smooth.png", "results_convergence_smooth_human.png"):
        assert (tmp_path / name).stat().st_size > 10_000
    rows = (tmp_path / "results_running_times.csv").read_text().splitlines()
    assert len(rows) == 1 + 6 * 8 * 3
    # a budget is part of what a trace says
    with pytest.raises(SystemExit, match="run with a budget of 400, not 300"):
        main([*arguments, "--seeds", "0", "--evaluations", "300"])
    # the best runs are kept whole, and tell when they are no longer what they were
    main(["--check", str(tmp_path / "results_best.json")])
    best = json.loads((tmp_path / "results_best.json").read_text())
    only = next(iter(best.values()))
    assert len(only["genes"]) > 20
    only["cost"] *= 1.001
    (tmp_path / "changed.json").write_text(json.dumps(best))
    with pytest.raises(SystemExit, match="make the study anew"):
        main(["--check", str(tmp_path / "changed.json")])
    # with a reference of a bad run all runs end at once
    only["cost"] *= 100
    (tmp_path / "easy.json").write_text(json.dumps(best))
    easy = [*arguments, "--seeds", "0", "--traces", f"{tmp_path}/more", "--reference", str(tmp_path / "easy.json")]
    main(easy)
    table = (tmp_path / "results.md").read_text().split("### At the end of the budget")[1].split("###")[0]
    cells = [line.split("|") for line in table.splitlines() if line.startswith("| ") and "---" not in line]
    ends = [int(row[5]) for row in cells[1:]]
    assert len(ends) == 6
    assert max(ends) <= 128


@pytest.mark.thorough
def test_a_study_that_was_killed_goes_on_and_two_share_a_folder(tmp_path: Path) -> None:
    traces = tmp_path / "traces"
    command = [sys.executable, "-m", "experiments.searches", *SMALL.split(), "--evaluations", "200", "--seeds", "0-5"]
    command += ["--methods", "random", "ga", "--traces", str(traces), "--out", str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    first = subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.DEVNULL)
    while first.poll() is None and len(list(traces.glob("*/*.json"))) < 3:
        time.sleep(0.05)
    first.send_signal(signal.SIGKILL)
    first.wait()
    made = {path: path.stat().st_mtime_ns for path in traces.glob("*/*.json")}
    assert 3 <= len(made) < 12
    both = [
        subprocess.Popen([*command, *more], env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        for more in ([], ["--workers", "2", "--name", "other"])
    ]
    said = "".join(process.communicate()[0] for process in both)
    assert [process.returncode for process in both] == [0, 0]
    assert said.count("; seed ") == 12 - len(made)  # each of the others was run once
    assert all(path.stat().st_mtime_ns == when for path, when in made.items())
    assert len(list(traces.glob("*/*.json"))) == 12
    assert not list(traces.glob("*/*.part"))
    assert (tmp_path / "other.md").is_file()


def test_versions_of_the_libraries_behind_methods_are_told() -> None:
    from experiments.searches.methods import packages

    assert set(packages(["cmaes", "hybrid", "scipy_de"])) == {"torch", "cma", "scipy"}
