from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from hopdiff.genes import GeneTable
from hopdiff.io.genes_file import read_genes, unit_genes, write_genes
from hopdiff.types import HopdiffError

LOW, HIGH = torch.tensor([0.0, -2.0, 5.0]).double(), torch.tensor([1.0, 2.0, 6.0]).double()
TABLE = GeneTable("test", ("a", "b", "c"), ("deg", "1", "leg"), LOW, HIGH, (LOW + HIGH) / 2, torch.ones(3).double())
VALUES = {"a": 0.1 + 0.2, "b": -2.0, "c": 6.0}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "genes.json"
    write_genes(target, {"speed": 5.0, "table": {0.4: 1.0}}, VALUES, TABLE.units)
    return target


def edit(path: Path, **genes: Any) -> None:
    content = json.loads(path.read_text())
    for name, entry in genes.items():
        if entry is None:
            del content["genes"][name]
        else:
            content["genes"][name] = entry
    path.write_text(json.dumps(content))


def test_what_was_written_is_read(path: Path) -> None:
    file = read_genes(path)
    assert {name: value for name, (value, _) in file.genes.items()} == VALUES
    assert file.settings["speed"] == 5.0
    unit = unit_genes(file, TABLE)
    assert TABLE.to_physical(unit).tolist() == pytest.approx(list(VALUES.values()), abs=1e-15)
    assert unit.min() >= 0
    assert unit.max() <= 1


def test_order_in_the_file_does_not_matter(path: Path) -> None:
    before = unit_genes(read_genes(path), TABLE)
    content = json.loads(path.read_text())
    content["genes"] = dict(reversed(content["genes"].items()))
    path.write_text(json.dumps(content))
    assert torch.equal(unit_genes(read_genes(path), TABLE), before)


def test_rounding_at_the_edge_is_forgiven(path: Path) -> None:
    edit(path, c={"value": 6.0000001, "unit": "leg"})
    assert unit_genes(read_genes(path), TABLE)[2] == 1.0


def test_a_fixed_gene_keeps_its_value(path: Path) -> None:
    low, high = LOW.clone(), HIGH.clone()
    low[1] = high[1] = -2.0
    table = GeneTable("test", TABLE.names, TABLE.units, low, high, high, TABLE.scale)
    assert table.to_physical(unit_genes(read_genes(path), table))[1] == -2.0
    edit(path, b={"value": -1.5, "unit": "1"})
    with pytest.raises(HopdiffError, match=r"gene 'b' is -1\.5, but fixed at -2 \[1\]\."):
        unit_genes(read_genes(path), table)


def test_bare_numbers_will_do(path: Path) -> None:
    edit(path, b=1.5)
    assert TABLE.to_physical(unit_genes(read_genes(path), TABLE))[1] == 1.5


@pytest.mark.parametrize(
    ("genes", "says"),
    [
        ({"b": None}, "lacks the gene 'b'"),
        ({"bb": {"value": 1.0, "unit": "1"}}, "unknown gene 'bb'. Did you mean 'b'?"),
        ({"b": {"value": float("nan"), "unit": "1"}}, "'b' must have a finite number"),
        ({"b": {"value": float("inf"), "unit": "1"}}, "'b' must have a finite number"),
        ({"b": {"value": "1", "unit": "1"}}, "'b' must have a finite number"),
        ({"b": {"value": True, "unit": "1"}}, "'b' must have a finite number"),
        ({"b": {"unit": "1"}}, "'b' must have a finite number"),
        ({"b": {"value": 2.5, "unit": "1"}}, "'b' is 2.5, outside its range of -2 to 2"),
        ({"a": {"value": 0.5, "unit": "rad"}}, "'a' must be in the unit 'deg', not 'rad'"),
    ],
)
def test_wrong_genes_are_named(path: Path, genes: dict[str, Any], says: str) -> None:
    edit(path, **genes)
    with pytest.raises(HopdiffError) as caught:
        unit_genes(read_genes(path), TABLE)
    assert says in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not a JSON file"),
        ("{'a': 1}", "not a JSON file"),
        ('{"genes": {"a": 1,\n}}', "in line"),
        ("[1, 2]", "lacks its table of genes"),
        ("{}", "lacks its table of genes"),
        ('{"genes": [1]}', "lacks its table of genes"),
        ('{"genes": {}, "settings": 3}', "settings must be a table"),
        ('{"genes": {"a": 1, "a": 2}}', "holds 'a' twice"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_broken_files_are_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "genes.json"
    path.write_text(text)
    with pytest.raises(HopdiffError, match=says):
        read_genes(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(HopdiffError, match=r"none\.json"):
        read_genes(tmp_path / "none.json")
    with pytest.raises(HopdiffError, match=tmp_path.name):
        read_genes(tmp_path)
