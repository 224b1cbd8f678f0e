"""Settings of the whole-body costs that make no sense: one sentence that names the setting."""

from __future__ import annotations

import pytest

from hopdiff.composing import compose
from hopdiff.config import build_job
from hopdiff.types import HopdiffError


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (
            ["costs.strength.knee=[1,2]"],
            "costs.strength.knee must be three entries (flexion, turn, sideways), each a number above 0, a pair of them"
            " for the two directions, or null for a passive axis, not [1, 2].",
        ),
        (["costs.strength.hip=[0.1,0,0.1]"], "costs.strength.hip must be three entries"),
        (["costs.strength.hip=[[0.1,0.2,0.3],1,1]"], "costs.strength.hip must be three entries"),
        (["costs.strength.knee=strong"], "costs.strength.knee: "),
        (
            ["costs.strength.wing=[1,1,1]"],
            "costs.strength.wing: there is no such joint; joints are waist, chest, neck, hip, knee, ankle, shoulder,"
            " elbow.",
        ),
        (["costs.tendon.wing=1"], "costs.tendon.wing: there is no such joint"),
        (["costs.tendon.knee=-1"], "costs.tendon.knee must be a number above 0, not -1.0."),
        (["costs.transfer=2"], "costs.transfer must lie between 0 and 1, not 2."),
        (["costs.least.external_work=-1"], "costs.least.external_work must be a number above 0, not -1.0."),
        (["costs.least.contact_time=0"], "costs.least.contact_time must be a number above 0, not 0.0."),
        (["costs.torque=-1"], "costs.torque must be a number of 0 or more, not -1."),
        (["costs.torque=nan"], "costs.torque must be a finite number, not nan."),
        (["costs.positive_work=many"], "costs.positive_work must be a number, not 'many'."),
        (["costs.scale=0"], "costs.scale must lie above 0 and not above 2, not 0."),
        (["costs.limits.friction=0"], "costs.limits.friction must lie between 0.05 and 5, not 0."),
        (
            ["costs.limits.knee_deg=[10,5]"],
            "costs.limits.knee_deg must be [low, high] with low < high, not [10.0,",
        ),
        (["costs.limits.hip_deg=[10]"], "costs.limits.hip_deg must be [low, high] with low < high, not [10.0]."),
        (
            ["costs.limits.reach=0.52", "costs.limits.knee_deg=[10,5]"],
            "costs.limits.knee_deg must be [low, high]",
        ),
        (["costs.limits.reach=0.49"], "costs.limits.reach must lie between 0.5 and 1, not 0.49."),
        (["costs.limits.reach=inf"], "costs.limits.reach must be a finite number, not inf."),
        (["costs.human.trunk_lean_deg=nan"], "costs.human.trunk_lean_deg must be a finite number, not nan."),
        (["costs.human.swing_knee_deg=high"], "costs.human.swing_knee_deg must be a finite number, not 'high'."),
        (["costs.human.trunk_leen=3"], "costs.human.trunk_leen: Key 'trunk_leen' not in 'HumanSettings'"),
        (["costs.wrong=3"], "Unknown setting 'costs.wrong'"),
        (["model.rounds=1"], "model.rounds must lie between 4 and 100, not 1."),
        (["model.adjoint_rounds=0"], "model.adjoint_rounds must lie between 1 and 100, not 0."),
        (["costs=default"], "costs=default cannot judge runs of model=body: take costs=human or effort."),
        (["genes.common_eta=true"], "genes.common_eta has no effect here"),
        (["beta=1.5"], "beta must be at least 0 and below 1, not 1.5."),
        (["speed=-1"], "speed must be a number above 0 [m/s], not -1."),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_sentence(overrides: list[str], says: str) -> None:
    typed = {word.split("=")[0] for word in overrides}
    base = [word for word in ("model=body", "speed=3.5", "beta=0.2") if word.split("=")[0] not in typed]
    with pytest.raises(HopdiffError) as caught:
        build_job(compose([*base, *overrides]))
    message = str(caught.value)
    assert message.startswith(says)
    assert "\n" not in message


def test_one_direction_cannot_be_passive_alone() -> None:
    with pytest.raises(HopdiffError, match=r"costs\.strength\.hip"):
        build_job(compose(["model=body", "speed=3.5", "beta=0.2", "costs.strength.hip=[[0.3,null],0.1,0.2]"]))


def test_costs_of_the_whole_body_do_not_judge_other_models() -> None:
    with pytest.raises(HopdiffError, match="costs=human cannot judge runs of model=smooth"):
        build_job(compose(["model=smooth", "costs=human", "speed=3.5", "beta=0.2"]))
