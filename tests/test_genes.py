"""The gene table: what it may hold, and the way from the unit box to physics and back."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from hopdiff.genes import ETAS_BEGIN, GeneTable, always_there, senses
from hopdiff.numerics import GRAVITY
from hopdiff.physics.legs import flight_alpha
from hopdiff.types import HopdiffError
from tests.builders import make_character, settings_of

KNOWN_GENES = {name: senses()[name] for name in always_there(senses())}
ETAS = tuple(name for name in KNOWN_GENES if name.startswith(ETAS_BEGIN))
LEG = make_character().leg_length


def build(plain: dict[str, Any], speed: float = 5.0, leg: float = LEG) -> GeneTable:
    return GeneTable.build(OmegaConf.create(plain), leg, speed)


@pytest.fixture
def plain() -> dict[str, Any]:
    return settings_of("genes", "default")


@pytest.mark.parametrize("name", list(KNOWN_GENES))
def test_a_missing_gene_is_named(plain: dict[str, Any], name: str) -> None:
    del plain["genes"][name]
    with pytest.raises(HopdiffError, match=f"gene '{name}' is missing"):
        build(plain)


@pytest.mark.parametrize(
    ("gene", "change", "said"),
    [
        ("arm_swing", {"unit": "furlong"}, "unknown unit 'furlong' of gene 'arm_swing'"),
        ("arm_swing", {"low": 50, "high": 40}, "range of 'arm_swing'"),
        ("arm_swing", {"low": None}, "arm_swing.low is missing"),
        ("arm_swing", {"low": "wide"}, "arm_swing.low must be a finite number, not 'wide'"),
        ("arm_swing", {"high": math.nan}, "arm_swing.high must be a finite number"),
        ("arm_swing", {"high": {}}, "arm_swing.high is an empty table"),
        ("arm_swing", {"high": {"fast": 20}}, "arm_swing.high must be a finite number, not 'fast'"),
        ("arm_swing", {"ordinary": 120}, "ordinary 'arm_swing' of 120 lies outside"),
        ("duty_factor", {"high": 0.5}, "range of 'duty_factor' must satisfy 0 < low <= high < 0.5"),
        ("duty_factor", {"low": 0}, "range of 'duty_factor'"),
        ("leg_extension", {"high": 0.9999}, "range of 'leg_extension'"),
        ("swing_reach", {"low": 0}, "range of 'swing_reach' must satisfy 0 < low"),
        ("touchdown_angle", {"high": 90}, "range of 'touchdown_angle'"),
    ],
)
def test_one_sentence_names_what_is_wrong(plain: dict[str, Any], gene: str, change: dict[str, Any], said: str) -> None:
    plain["genes"][gene].update(change)
    with pytest.raises(HopdiffError) as caught:
        build(plain)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_gene_is_named(plain: dict[str, Any]) -> None:
    plain["genes"]["tail_wag"] = plain["genes"]["arm_swing"]
    with pytest.raises(HopdiffError, match="unknown gene 'tail_wag'"):
        build(plain)


def test_a_table_over_froude_speed_is_linear_between_and_constant_beyond(plain: dict[str, Any]) -> None:
    plain["genes"]["arm_swing"] |= {"high": {1.0: 40, 2.0: 60}, "ordinary": 20}

    def high(froude: float, leg: float = LEG) -> float:
        table = build(plain, froude * math.sqrt(GRAVITY * leg), leg)
        return float(table.high[table.names.index("arm_swing")])

    assert [high(f) for f in (0.5, 1.0, 1.25, 2.0, 3.0)] == pytest.approx([40, 40, 45, 60, 60])
    # The same Froude speed means the same range, whatever the leg.
    assert high(1.25, leg=0.3) == pytest.approx(45)


def test_the_default_table_serves_every_speed_and_body(plain: dict[str, Any]) -> None:
    for name in ("human", "child", "cartoon"):
        for speed in (1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0):
            table = build(plain, speed, make_character(name).leg_length)
            assert (table.low < table.high).all()
            assert ((table.low <= table.ordinary) & (table.ordinary <= table.high)).all()
            assert 25 <= table.dimension <= 35


@given(st.lists(st.floats(0.0, 1.0), min_size=len(KNOWN_GENES), max_size=len(KNOWN_GENES)), st.floats(1.0, 12.0))
def test_unit_box_to_table_units_and_back(values: list[float], speed: float) -> None:
    table = build(settings_of("genes", "default"), speed)
    unit = torch.tensor(values, dtype=torch.float64)
    physical = table.to_physical(unit)
    assert ((physical >= table.low - 1e-9) & (physical <= table.high + 1e-9)).all()
    assert torch.allclose(table.to_unit(physical), unit, atol=1e-12)
    # What a genes file does to the numbers: decimal text and back.
    assert torch.equal(torch.tensor(json.loads(json.dumps(physical.tolist())), dtype=torch.float64), physical)


def test_a_pinned_gene_goes_to_the_corner_of_the_box(plain: dict[str, Any]) -> None:
    plain["genes"]["elbow_flexion"] |= {"low": 90, "high": 90, "ordinary": 90}
    table = build(plain)
    pinned = table.names.index("elbow_flexion")
    assert table.to_unit(table.ordinary)[pinned] == 0.0
    assert table.to_physical(torch.ones(table.dimension).double())[pinned] == 90.0


def test_a_fixed_gene_has_one_value_even_outside_its_range(plain: dict[str, Any]) -> None:
    table = build(plain | {"fixed": {"step_width": 0.3}})
    fixed = table.names.index("step_width")
    assert plain["genes"]["step_width"]["high"] < 0.3
    assert (table.low[fixed], table.high[fixed], table.ordinary[fixed]) == (0.3, 0.3, 0.3)
    assert table.free.tolist() == [float(name != "step_width") for name in table.names]
    for unit in torch.rand(3, 1, table.dimension, dtype=torch.float64):
        assert float(table.decode(unit)["step_width"]) == pytest.approx(0.3 * LEG, rel=1e-12)


def test_an_entry_that_is_no_table_is_named(plain: dict[str, Any]) -> None:
    plain["genes"]["arm_swing"] = 5
    with pytest.raises(HopdiffError, match="gene 'arm_swing' must be a table of unit, low, high and ordinary, not 5"):
        build(plain)


@pytest.mark.parametrize(
    ("fixed", "common", "said"),
    [
        ({"stepwidth": 0.1}, False, "genes.fixed.stepwidth: there is no gene 'stepwidth'"),
        ({"stepwidth": 0.1}, False, "Did you mean 'step_width'?"),
        ({"step_width": 1.0}, False, "genes.fixed.step_width must lie between -1 and 1 [leg], not 1."),
        ({"arm_swing": math.nan}, False, "genes.fixed.arm_swing must lie between -180 and 180 [deg], not nan."),
        ({"eta": 5.0}, False, "genes.fixed.eta needs genes.common_eta=true"),
        ({"eta_elbow": 5.0}, True, "genes.fixed.eta_elbow has no effect with genes.common_eta=true"),
        ({"lame_swing_reach": 20.0}, False, "genes.fixed.lame_swing_reach is a gene of the lame leg"),
    ],
)
def test_a_wrong_fixed_gene_is_named(plain: dict[str, Any], fixed: dict[str, float], common: bool, said: str) -> None:
    plain["genes"]["lame_swing_reach"] = plain["genes"]["swing_reach"]
    with pytest.raises(HopdiffError) as caught:
        build(plain | {"fixed": fixed, "common_eta": common})
    assert said in str(caught.value)


def test_a_common_eta_takes_the_place_of_all_gains(plain: dict[str, Any]) -> None:
    table = build(plain | {"common_eta": True})
    assert set(table.names) == (set(KNOWN_GENES) - set(ETAS)) | {"eta"}
    unit = torch.rand(4, table.dimension, dtype=torch.float64)
    decoded = table.decode(unit)
    assert set(decoded) == set(KNOWN_GENES)
    for name in ETAS:
        assert torch.equal(decoded[name], table.to_physical(unit)[:, table.names.index("eta")])
    fixed = build(plain | {"common_eta": True, "fixed": {"eta": 5.0}})
    assert {float(fixed.decode(unit[:1])[name]) for name in ETAS} == {5.0}


def test_a_common_eta_needs_its_entry(plain: dict[str, Any]) -> None:
    del plain["genes"]["eta"]
    assert len(build(plain).names) == len(KNOWN_GENES)
    with pytest.raises(HopdiffError, match="the gene 'eta' is missing"):
        build(plain | {"common_eta": True})


def test_everyday_running_is_the_same_whatever_is_fixed(plain: dict[str, Any]) -> None:
    table = build(plain)
    assert {name: float(value) for name, value in table.everyday.items()} == pytest.approx(
        {name: float(value) for name, value in table.decode(table.to_unit(table.ordinary)[None]).items()}
    )
    other = build(plain | {"common_eta": True, "fixed": {"eta": 9.0, "duty_factor": 0.2}})
    assert other.everyday == table.everyday
    assert set(table.everyday) == set(KNOWN_GENES)


def test_lame_genes_exist_only_in_a_limp(plain: dict[str, Any]) -> None:
    plain["genes"]["lame_swing_reach"] = plain["genes"]["swing_reach"] | {"low": 10}
    settings = OmegaConf.create(plain)
    assert set(GeneTable.build(settings, LEG, 5.0).names) == set(KNOWN_GENES)
    limping = GeneTable.build(settings, LEG, 5.0, limping=True)
    assert set(limping.names) == set(KNOWN_GENES) | {name for name in plain["genes"] if name.startswith("lame_")}
    assert limping.low[limping.names.index("lame_swing_reach")] == 10
    assert set(limping.everyday) == set(KNOWN_GENES)
    del plain["genes"]["lame_swing_reach"]
    plain["genes"]["lame_arm_swing"] = plain["genes"]["arm_swing"]
    with pytest.raises(HopdiffError, match="unknown gene 'lame_arm_swing'"):
        build(plain)


def test_a_lame_gene_makes_sense_where_its_twin_does(plain: dict[str, Any]) -> None:
    plain["genes"]["lame_swing_reach"] = plain["genes"]["swing_reach"] | {"low": 0}
    with pytest.raises(HopdiffError, match="range of 'lame_swing_reach' must satisfy 0 < low"):
        build(plain)


def test_physics_gets_si_units_and_radians(plain: dict[str, Any]) -> None:
    table = build(plain)
    unit = torch.rand(7, table.dimension, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    decoded, physical = table.decode(unit), table.to_physical(unit)
    assert set(decoded) == set(KNOWN_GENES)
    for name, factor in (("arm_swing", math.pi / 180), ("step_width", LEG), ("duty_factor", 1.0), ("eta_elbow", 1.0)):
        assert torch.allclose(decoded[name], physical[:, table.names.index(name)] * factor)


@given(st.floats(1e-6, 3.0), st.floats(-30.0, -0.01), st.floats(0.01, 0.6))
def test_alpha_cannot_reach_its_pole(reach: float, end_rate: float, duration: float) -> None:
    alpha = flight_alpha(*(torch.tensor(x, dtype=torch.float64) for x in (reach, end_rate, duration)))
    assert 0.5 < float(alpha) < 1.0


def test_the_whole_box_keeps_alpha_between_a_half_and_one(plain: dict[str, Any]) -> None:
    for speed in (2.0, 5.0, 10.0):
        table = build(plain, speed)
        corner = table.decode(torch.stack((torch.zeros(table.dimension), torch.ones(table.dimension))).double())
        # The fastest and slowest ends of swing that the box can ask for.
        reach, length = corner["swing_reach"], LEG * corner["leg_extension"]
        for angle in corner["touchdown_angle"]:
            contact = 2.0 * length * torch.sin(angle) / speed
            for duty in corner["duty_factor"]:
                flight = contact * (0.5 / duty - 1.0)
                alpha = flight_alpha(reach, -speed * torch.cos(angle) / length, flight)
                assert ((alpha > 0.5) & (alpha < 1.0)).all()
