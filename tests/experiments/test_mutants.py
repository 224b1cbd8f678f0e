"""The mutation study: its operators do what they say, and its verdicts hold on a project of three lines."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

TOY = '''"""A toy: 1 + 2."""
LIMIT = 3.0


def swing(left_arm, right_arm, share: float = 0.5, *, dim=-1):
    """Says 4 * 5."""
    if left_arm > right_arm and not share:
        raise ValueError("a - b")
    return (1.0 - share) * left_arm ** 2 + min(share * right_arm.abs(), 1e-12).sum(-1)
'''


@pytest.fixture(autouse=True)
def from_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


def changes(text: str) -> dict[str, set[str]]:
    from experiments.mutants.operators import mutants_of

    found: dict[str, set[str]] = {}
    for mutant in mutants_of("toy.py", text):
        found.setdefault(mutant.operator, set()).add(f"{mutant.before} -> {mutant.after}")
    return found


def test_operators_change_what_they_say() -> None:
    found = changes(TOY)
    product = "(1.0 - share) * left_arm ** 2"
    least = "min(share * right_arm.abs(), 1e-12).sum(-1)"
    assert found == {
        "sign": {"-1 -> 1", "1.0 - share -> 1.0 + share", f"{product} + {least} -> {product} - {least}"},
        "factor": {
            f"{product} -> (1.0 - share) / left_arm ** 2",
            "share * right_arm.abs() -> share / right_arm.abs()",
        },
        "drop": {
            f"{product} + {least} -> {product}",
            f"{product} + {least} -> {least}",
            f"{product} -> 1.0 - share",
            f"{product} -> left_arm ** 2",
            "1.0 - share -> 1.0",
            "share * right_arm.abs() -> share",
            "share * right_arm.abs() -> right_arm.abs()",
            "right_arm.abs() -> right_arm",
        },
        "exponent": {"2 -> 3", "2 -> 1"},
        "comparison": {"left_arm > right_arm -> left_arm >= right_arm", "left_arm > right_arm -> left_arm < right_arm"},
        "logic": {
            "left_arm > right_arm and not share -> (left_arm > right_arm or not share)",
            "not share -> share",
        },
        "constant": {"0.5 -> 0.55", "1.0 -> 1.1"},
        "name": {"left_arm -> right_arm", "right_arm -> left_arm"},
        "function": {"min -> max"},
    }


def test_a_mutant_knows_its_function_and_makes_its_text() -> None:
    from experiments.mutants.operators import is_sound, mutants_of

    text = "# ä\nclass A:\n    @property\n    def b(self):\n        return self.c * 2.0\n"
    mutants = mutants_of("a.py", text)
    halved = next(m for m in mutants if m.operator == "factor")
    assert (halved.function, halved.defined, halved.line) == ("A.b", 3, 5)
    assert halved.name == "a.py:A.b: self.c * 2.0 -> self.c / 2.0"
    assert halved.applied(text) == text.replace("*", "/")
    assert all(is_sound(m, text) for m in mutants)
    again = [m.name for m in mutants_of("a.py", "def f(a):\n    return a + (1 - a) + (1 - a)\n")]
    assert "a.py:f: 1 - a -> 1 + a (2)" in again
    assert len(set(again)) == len(again)


def test_a_draw_takes_files_and_operators_in_turn(tmp_path: Path) -> None:
    from experiments.mutants.__main__ import drawn
    from experiments.mutants.operators import in_turn, mutants_of

    (tmp_path / "one.py").write_text("def f(a):\n    return a * a * a * a * a * a\n")
    (tmp_path / "two.py").write_text("def g(b):\n    return b - 1\n")
    files = ["one.py", "two.py"]
    found = drawn(files, 5, 7, tmp_path)
    assert [m.file for m in found] == ["one.py", "two.py", "one.py", "two.py", "one.py"]
    assert found == drawn(files, 5, 7, tmp_path)
    assert found[::2] == drawn(["one.py"], 3, 7, tmp_path)
    assert found != drawn(files, 5, 8, tmp_path)
    ordered = in_turn(mutants_of("toy.py", TOY), random.Random(0))
    assert len({m.operator for m in ordered[:9]}) == 9


def test_a_named_change_must_be_there(tmp_path: Path) -> None:
    from experiments.mutants.__main__ import named

    (tmp_path / "toy.py").write_text(TOY)
    table = tmp_path / "named.yaml"
    table.write_text('- {name: half, file: toy.py, find: "(1.0 - share)", put: "(1.0)"}\n')
    (mutant,) = named(table, tmp_path, ["toy.py"])
    assert (mutant.function, mutant.line, mutant.name) == ("swing", 9, "toy.py:swing: half -> (1.0)")
    assert mutant.applied(TOY) == TOY.replace("(1.0 - share)", "(1.0)")
    assert not named(table, tmp_path, ["other.py"])
    table.write_text('- {name: half, file: toy.py, find: "(2.0 - share)", put: "(1.0)"}\n')
    with pytest.raises(ValueError, match=r"named.yaml, half: toy.py holds this not once: \(2.0 - share\)"):
        named(table, tmp_path, ["toy.py"])


def test_every_named_change_fits_the_code() -> None:
    from experiments.mutants.__main__ import HERE, PARTS, is_sound, named

    files = {path.relative_to(ROOT).as_posix() for part in PARTS.values() for f in part.files for path in ROOT.glob(f)}
    mutants = named(HERE / "named.yaml", ROOT, sorted(files))
    assert len({m.name for m in mutants}) == (HERE / "named.yaml").read_text().count("- name:")
    assert all(is_sound(m, (ROOT / m.file).read_text()) for m in mutants)


SESSION = """
import json, sys
from pathlib import Path
from experiments.mutants.server import Copy

root, folder = Path(sys.argv[1]), Path(sys.argv[2])
copy = Copy(root, folder, libraries=())
tests = copy.measured("tests/test_toy.py")
text = (root / "hopdiff/toy.py").read_text()
outcomes = []
for before, after in (("a + b", "a - b"), ("a + b", "b + a"), ("n < 3", "n < n + 1")):
    with copy.changed("hopdiff/toy.py", text.replace(before, after)):
        outcomes.append(copy.tried(tests)[:2])
outcomes.append(copy.tried(tests)[:2])
print(json.dumps({"calls": {name: sorted(t.functions - {""}) for name, t in tests.items()}, "outcomes": outcomes}))
"""
TOY_CODE = """from functools import cache


def add(a, b):
    return a + b


@cache
def once():
    return add(1, 2)


def count():
    n = 0
    while n < 3:
        n += 1
    return n
"""
TOY_TESTS = """from hopdiff.toy import add, count, once


def test_first():
    assert once() == 3


def test_second():
    assert once() == 3


def test_count():
    assert count() == 3


def test_add():
    assert add(2, 2) == 4
"""


def test_a_wrong_change_dies_an_equal_one_lives_and_an_endless_one_is_ended(tmp_path: Path) -> None:
    for place, text in (("hopdiff/toy.py", TOY_CODE), ("hopdiff/__init__.py", ""), ("tests/test_toy.py", TOY_TESTS)):
        (tmp_path / "toy" / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "toy" / place).write_text(text)
    (tmp_path / "copy").mkdir()
    session = SESSION.replace("Copy\n", "Copy\nimport experiments.mutants.server as server\nserver.PATIENCE = 1.0\n", 1)
    command = (sys.executable, "-c", session, str(tmp_path / "toy"), str(tmp_path / "copy"))
    told = json.loads(subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout)
    module, add, once, count = (f"hopdiff/toy.py:{line}" for line in (1, 4, 8, 13))
    # What is read or made once and kept concerns every test after it.
    assert told["calls"] == {
        "tests/test_toy.py::test_first": [module, add, once],
        "tests/test_toy.py::test_second": [module, add, once],
        "tests/test_toy.py::test_count": sorted([module, count, add, once]),
        "tests/test_toy.py::test_add": [module, add, once],
    }
    assert told["outcomes"] == [
        ["killed", "tests/test_toy.py::test_first"],
        ["survived", ""],
        ["timeout", "tests/test_toy.py::test_count"],
        ["survived", ""],
    ]
    assert (tmp_path / "toy" / "hopdiff" / "toy.py").read_text() == TOY_CODE
    assert (tmp_path / "copy" / "hopdiff" / "toy.py").read_text() == TOY_CODE


def test_the_table_counts_equivalents_apart() -> None:
    from experiments.mutants.tables import report

    rows = [
        {"part": part, "kind": "seed 0", "name": f"a.py:f: {k} -> {k + 1}", "line": str(k), "code": "x", "changed": "y"}
        | {"result": result, "commit": "abc"}
        for k, (part, result) in enumerate(
            [("one", "killed"), ("one", "timeout"), ("one", "survived"), ("two", "survived"), ("two", "killed")]
        )
    ]
    text = report(rows, {"a.py:f: 3 -> 4": "Nothing is left of it."})
    assert "| one | 3 | 2 | 1 | 1 | 66.7 | 0 |" in text
    assert "| two | 1 | 1 | 0 | 0 | 100.0 | 1 |" in text
    assert "| all | 4 | 3 | 1 | 1 | 75.0 | 1 |" in text
    assert "## Survivors\n\n- `a.py:2` `x` → `y`\n" in text
    assert "## Equivalent\n\n- `a.py:3` `x` → `y` Nothing is left of it.\n" in text
