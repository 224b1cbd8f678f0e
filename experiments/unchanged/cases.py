"""The commands whose motions are compared."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

SEARCHES = ("ga", "gradient", "hybrid", "cmaes", "random", "ordinary")
POINTS = "path.points=[[0,0],[2,6],[-2,12]]"


class Case(NamedTuple):
    """A command by its name. words: what follows `python -m hopdiff`; {NAME} stands for the folder of an earlier case
    of the same checkout, {clips} for a folder of captured clips."""

    name: str
    words: tuple[str, ...]


def cases() -> Iterator[Case]:
    """Every command, those that others need first."""
    short = "budget.evaluations=120"
    yield Case("body", (short, "beta=0.2", "speed=3.5"))
    yield Case("brisk", (short, "beta=0.7", "seed=1"))
    yield Case("effort", (short, "beta=0.2", "costs=effort"))
    yield Case("limp", (short, "+experiment=limp"))
    yield Case("child", (short, "beta=0.2", "speed=2.5", "character=child"))
    for model in ("smooth", "thesis"):
        for search in SEARCHES:
            words = (f"model={model}", f"search={search}", "seed=2", "budget.evaluations=600")
            yield Case(f"{model}_{search}", words)
    yield Case(
        "path_smooth", ("task=path", "model=smooth", "beta=0.2", POINTS, "path.time=4", "budget.evaluations=300")
    )
    yield Case("path_body", ("task=path", "beta=0.2", POINTS, "path.time=4", short))
    yield Case("replay", ("task=replay", "genes_file={body}/genes.json"))
    yield Case("replay_thesis", ("task=replay", "genes_file={thesis_ga}/genes.json", "fps=120"))
    ours = ("+experiment=edit", "model=smooth", "budget.evaluations=300", "target.position=[1,12]", "target.heading=45")
    yield Case("edit_own", ours)
    yield Case("edit_run", ("task=edit", "clip={path_body}/motion.bvh", "target.position=[1,8]", "target.heading=30"))
    yield Case("edit_path", ("task=edit", "clip={body}/motion.bvh", "path.points=[[0,0],[2,3],[0,6]]"))
    yield Case("edit_clip", ("task=edit", "clip={clips}/walk_straight_snu_30hz.bvh", "target.position=[0.5,2.5]"))
    yield Case("hopper", ("task=hopper",))
    yield Case("hopper_two", ("task=hopper", "hopper.legs=2", "hopper.hops=6"))
    rooms = ("task=navigate", "clips=[{clips}/wander_snu_93s_30hz.bvh]", "scene=two_rooms")
    yield Case("navigate", rooms)
    for source in ("body", "smooth_gradient"):
        yield Case(f"export_{source}", ("task=export", f"run={{{source}}}", "export=[bvh_unity,csv,glb]"))
