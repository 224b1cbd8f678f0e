"""Runs along a curve on uneven ground: feet land on it and turn with it, bodies follow, treads are kept."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
import torch
from omegaconf import OmegaConf

from hopdiff.composing import compose
from hopdiff.config import build_job, checked, typed
from hopdiff.feet.contacts import contact_points, spans
from hopdiff.feet.planting import LOWEST_UNEVEN
from hopdiff.motion import SIDES, Motion
from hopdiff.tasks.path import PathTask, led_along, route_of
from hopdiff.tasks.uneven import exact_contacts, ground_notes, ground_rows, on_ground
from hopdiff.terrain.ground import Flat, Ground
from hopdiff.terrain.profile import slope, stairs
from tests.tasks.conftest import LEAST
from tests.terrain.grounds import bumps

MODELS = pytest.mark.parametrize("model", ["body", "smooth"])
GROUNDS = {
    "up": slope(math.radians(10.0), 0.0, (0.0, 2.0), 6.0),
    "down": slope(math.radians(-10.0), 0.0, (0.0, 2.0), 6.0),
    "stairs": stairs(0.17, 0.29, 0.0, (0.0, 2.0), 10),
    "downstairs": stairs(-0.17, 0.29, 0.0, (0.0, 2.0), 10),
    "bumps": bumps(),
}
EVERY = pytest.mark.parametrize("ground", GROUNDS.values(), ids=list(GROUNDS))


@cache
def level_run(model: str) -> Motion:
    """Six strides along a bend of 12 m, on level ground."""
    least = LEAST if model == "body" else ()
    config = compose(["task=path", f"model={model}", "path.points=[[0,0],[1,4],[-1,8],[0,12]]", "path.time=4", *least])
    settings = checked(config)
    route = route_of(settings, typed(config, PathTask))
    OmegaConf.update(config, "speed", route.speed)
    job = build_job(config, settings=replace(settings, speed=route.speed))
    with torch.no_grad():
        return led_along(job.problem, job.problem.start, route, 6, 60.0)


@MODELS
def test_level_ground_changes_nothing(model: str) -> None:
    motion = level_run(model)
    raised = on_ground(motion, Flat())
    assert raised.motion is motion
    assert raised.numbers == {}


@MODELS
def test_a_point_of_a_foot_stands_whenever_the_foot_does(model: str) -> None:
    motion = level_run(model)
    # What the run knows counts, not what the frames look like.
    fewer = motion.contact.clone()
    fewer[:60, 0] = False
    for one in (motion, replace(motion, contact=fewer)):
        contacts = exact_contacts(one)
        for k, leg in enumerate(contacts.legs):
            assert torch.equal(contacts.stands(k), one.contact[:, SIDES.index(leg.side)])
        assert (contacts.level == 0.0).all()


@MODELS
@EVERY
def test_feet_stand_on_the_ground(model: str, ground: Ground) -> None:
    motion = level_run(model)
    raised = on_ground(motion, ground)
    numbers = raised.numbers
    assert raised.motion.clip.frames == motion.clip.frames
    assert numbers["ground_depth"] < 0.005
    assert numbers["ground_gap"] < 0.02
    assert numbers["ground_given_up"] < 0.1
    assert numbers["ground_lowered"] <= LOWEST_UNEVEN + 1e-9
    assert numbers["foot_slide_max"] < 0.015
    # Where feet stand, where they did; others are only a few frames shorter.
    assert not (raised.motion.contact & ~motion.contact).any()
    # Measured anew: heights of points that stand, above the ground below them.
    contacts = exact_contacts(motion)
    above = ground.above(contact_points(raised.motion.clip, contacts)) - contacts.floor
    for k, (leg, _) in enumerate(contacts.points):
        stands = contacts.touching[:, k] & raised.motion.contact[:, SIDES.index(contacts.legs[leg].side)]
        assert above[stands, k].abs().max() < 0.02
        assert above[~stands, k].min() > -0.03


@MODELS
@EVERY
def test_the_body_follows_the_ground_smoothly(model: str, ground: Ground) -> None:
    motion = level_run(model)
    raised = on_ground(motion, ground).motion
    up = raised.clip.root_position[:, 1] - motion.clip.root_position[:, 1]
    below = ground.mean_height(motion.clip.root_position[:, [0, 2]], 0.5)
    assert (up - below).abs().max() < 0.25
    assert abs(float((up - below).mean())) < 0.06
    # No jolt: what is added is accelerated by less than the run itself is.
    own = motion.clip.root_position[:, 1].diff().diff().abs().max()
    assert up.diff().diff().abs().max() < 0.8 * own
    assert torch.equal(raised.clip.root_position[:, [0, 2]], motion.clip.root_position[:, [0, 2]])
    assert (raised.com - motion.com)[:, 1] == pytest.approx(up)


def test_feet_turn_with_a_slope() -> None:
    motion, ground = level_run("body"), GROUNDS["up"]
    raised = on_ground(motion, ground).motion
    old, new = motion.clip.forward()[1], raised.clip.forward()[1]
    contacts, seen = exact_contacts(motion), 0
    for leg in contacts.legs:
        k = SIDES.index(leg.side)
        for first, last in spans(raised.contact[:, k]):
            places = raised.feet[first : last + 1, k][:, [0, 2]]
            if not bool(((places[:, 1] > 2.3) & (places[:, 1] < 7.7)).all()):
                continue
            here = slice(first, last + 1)
            up = (new[here, leg.ankle] @ old[here, leg.ankle].transpose(-1, -2))[:, :, 1]
            # Heels may come up sooner at the end.
            assert (up - ground.normal(places)).norm(dim=-1).quantile(0.7) < 1e-6
            seen += 1
    assert seen >= 4


@MODELS
def test_feet_stand_on_treads(model: str) -> None:
    ground = GROUNDS["stairs"]
    level = level_run(model)
    contacts, motion = exact_contacts(level), on_ground(level, ground).motion
    points, heights = contact_points(motion.clip, contacts), []
    for k, leg in enumerate(contacts.legs):
        own = [i for i, (which, _) in enumerate(contacts.points) if which == k]
        for first, last in spans(motion.contact[:, SIDES.index(leg.side)]):
            under = ground.height(points[(first + last) // 2, own][:, [0, 2]])
            assert (under == under[0]).all()
            heights.append(float(under[0]))
    # Some steps are taken on the way up.
    assert len({round(height, 3) for height in heights}) >= 4


def test_the_points_of_feet_go_with_them() -> None:
    motion, ground = level_run("body"), GROUNDS["up"]
    raised = on_ground(motion, ground).motion
    assert raised.cop is not None
    stands = raised.contact & motion.contact
    assert ground.above(raised.cop)[stands].abs().max() < 0.01
    assert ground.above(raised.feet)[stands].abs().max() < 0.01
    assert ground.above(raised.com_target).abs().max() < 1e-9


def test_what_is_told_of_the_ground() -> None:
    numbers = on_ground(level_run("smooth"), GROUNDS["stairs"]).numbers
    assert numbers["ground_rise"] == pytest.approx(1.7)
    ((name, said),) = ground_rows(numbers)
    assert name == "ground"
    assert said.startswith("rises by 1.70 m;")
    assert ground_rows({}) == ground_notes({}) == ground_notes({"ground_given_up": 0.01}) == []
    (note,) = ground_notes({"ground_given_up": 0.126})
    assert "13 %" in note.sentence
