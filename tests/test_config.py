"""Every file in conf/ composes and builds, and every experiment runs once in a tiny version."""

from __future__ import annotations

import json
import math

import pytest
import torch
from omegaconf import OmegaConf

from hopdiff.choices import build_search
from hopdiff.composing import compose, known_settings
from hopdiff.config import build_job, checked, with_saved
from hopdiff.doors import SEARCHES as DOOR
from hopdiff.doors import config_folder
from hopdiff.job import search_run
from hopdiff.types import HopdiffError

CONF = config_folder()
SEARCHES = {name: DOOR.load(name) for name in DOOR.own}
GROUPS = ("model", "search", "character", "costs", "genes")
CHOICES = [
    (group, path.stem)
    for group in GROUPS
    for path in sorted((CONF / group).glob("*.yaml"))
    if not path.stem.startswith("of_")
]
# The model of choices that are not for the default one.
MODEL_OF = {
    (group, name): model
    for group in ("costs", "genes")
    for name, model in (("default", "smooth"), ("thesis", "thesis"))
}
EXPERIMENTS = sorted(path.stem for path in (CONF / "experiment").glob("*.yaml"))
BRIEF = ("neutral", "thesis")  # experiments; the others are searched longer, or much the same
TINY = ("budget.evaluations=200", "threads=1")
# Some least run of a body, which is not searched for then.
LEAST = ("costs.least.external_work=0.2", "costs.least.contact_time=0.25")


def test_every_group_has_choices() -> None:
    assert {group for group, _ in CHOICES} == set(GROUPS)
    assert {name for group, name in CHOICES if group == "search"} == set(SEARCHES)
    assert {name for group, name in CHOICES if group == "model"} == {"body", "smooth", "thesis"}
    assert {"human", "child", "cartoon"} <= {name for group, name in CHOICES if group == "character"}
    assert {"brisk", "neutral"} <= set(EXPERIMENTS)


@pytest.mark.few(3)
@pytest.mark.parametrize(("group", "name"), CHOICES)
def test_every_choice_composes_and_builds(group: str, name: str) -> None:
    # Every body at a speed that is a run for its size.
    chosen = [f"model={MODEL_OF.get((group, name), 'body')}", f"{group}={name}"]
    config = compose(chosen)
    # A body's run of beta 0.2 is not told in another one, which would be searched for.
    chosen += ["beta=0.2"] if config.model.name == "body" else []
    job = build_job(compose([*chosen, f"speed={2.5 * math.sqrt(config.character.height)}"]))
    assert job.settings[group]["name"] == name
    result = job.problem.evaluate(job.problem.start.unsqueeze(0), with_grad=False)
    # The whole body's start is only where searches begin: it has a merit, but need not be a possible run.
    assert torch.isfinite(result.merit if config.model.name == "body" else result.cost).all()


def test_a_replay_at_another_speed_forgets_the_least_run() -> None:
    saved = {"costs": {**compose(["model=body"]).costs, "least": {"external_work": 0.1, "contact_time": 0.2}}}
    kept = with_saved(compose(["beta=0.5"]), saved, ["beta"])
    assert kept.costs.least.external_work == 0.1
    for typed in (["speed"], ["character.proportions.legs"], ["costs.torque"]):
        assert with_saved(compose([]), saved, typed).costs.least.external_work is None
    typed = ["speed", "costs.least.external_work"]
    assert with_saved(compose(["costs.least.external_work=0.3"]), saved, typed).costs.least.external_work == 0.3


@pytest.mark.few(4)
@pytest.mark.parametrize("model", ["body", "smooth", "thesis"])
@pytest.mark.parametrize("group", ["costs", "genes"])
def test_costs_and_genes_follow_the_model(group: str, model: str) -> None:
    default = {"body": {"costs": "human", "genes": "body"}[group], "thesis": "thesis"}.get(model, "default")
    assert compose([f"model={model}"])[group] == compose([f"model={model}", f"{group}={default}"])[group]
    assert compose([f"model={model}"])[group].name == default


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in BRIEF else pytest.mark.thorough) for name in EXPERIMENTS]
)
def test_every_experiment_runs(name: str) -> None:
    config = compose([f"+experiment={name}", *TINY])
    run = search_run(build_job(config))
    assert math.isfinite(run.metrics["cost"])
    assert run.metrics["speed"] == pytest.approx(config.speed, rel=1e-9)
    assert run.metrics["evaluations"] <= 200
    assert run.clip.frames == run.metrics["frames"] > 10


@pytest.mark.parametrize("name", SEARCHES)
def test_search_files_set_what_the_class_knows(name: str) -> None:
    settings = OmegaConf.to_container(OmegaConf.load(CONF / "search" / f"{name}.yaml"))
    assert settings["name"] == name
    assert build_search(settings) == SEARCHES[name](**settings)


def test_search_settings_are_typed() -> None:
    with pytest.raises(HopdiffError, match="population"):
        build_search({"name": "ga", "population": "many"})
    with pytest.raises(HopdiffError, match="Unknown setting of search ga 'popsize'"):
        build_search({"name": "ga", "popsize": 5})
    with pytest.raises(HopdiffError, match=r"Unknown search\.name 'None'"):
        build_search({"population": 5})


def test_experiments_are_differences() -> None:
    for name in EXPERIMENTS:
        text = (CONF / "experiment" / f"{name}.yaml").read_text()
        assert text.startswith("# @package _global_\n"), name
        assert len(text.splitlines()) < 30, name


def test_known_settings_name_the_top_level() -> None:
    known = known_settings()
    assert {"speed", "beta", "seed", "device", "dtype", "fps", "runs", "genes_file"} <= set(known)
    assert {"budget.evaluations", "character.height", "model.step", "edit.alpha", "costs.torque"} <= set(known)
    assert {"search.population", "search.starts"} <= set(known_settings("search.popul"))
    assert "exports.glb.cycles" in known_settings("exports.glb.cycle")


def test_a_genes_file_brings_its_settings_along() -> None:
    saved = {"speed": 3.0, "beta": 0.2, "model": {"name": "smooth", "nodes": 9}, "unheard": 1}
    merged = checked(with_saved(compose(), saved, []))
    assert (merged.speed, merged.beta, merged.model["nodes"]) == (3.0, 0.2, 9)
    assert merged.fps == 60.0


def test_what_is_typed_wins_over_a_genes_file() -> None:
    saved = {"speed": 3.0, "beta": 0.2, "model": {"name": "smooth", "nodes": 9, "sweeps": 1}}
    typed = compose(["speed=4", "model.nodes=7"])
    merged = checked(with_saved(typed, saved, ["speed", "model.nodes", "search.population"]))
    assert (merged.speed, merged.beta, merged.model["nodes"], merged.model["sweeps"]) == (4.0, 0.2, 7, 1)
    whole = checked(with_saved(compose(["model=smooth"]), saved, ["model"]))
    assert whole.model == checked(compose(["model=smooth"])).model


@pytest.mark.parametrize("words", [("beta=0.2",), LEAST, ("model=smooth",)], ids=" ".join)
def test_settings_survive_json(words: tuple[str, ...]) -> None:
    job = build_job(compose(words))
    saved = json.loads(json.dumps(job.saved))
    again = build_job(with_saved(compose(["speed=7", "beta=0.1"]), saved, []))
    assert again.problem.speed == job.problem.speed
    assert torch.equal(again.table.low, job.table.low)
    assert torch.equal(again.problem.start, job.problem.start)
