"""The floors of the house: a module imports from its own floor's package or from below, and nothing goes round."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "hopdiff"

# The first entry that a module's name starts with says where it lives.
FLOORS = {
    "hopdiff.types": 0,
    "hopdiff.numerics": 0,
    "hopdiff.messages": 0,
    "hopdiff.doors": 0,
    "hopdiff.extras": 0,
    "hopdiff.objective": 0,
    "hopdiff.channels": 0,
    "hopdiff.geometry": 1,
    "hopdiff.motion": 1,
    "hopdiff.physics": 1,
    "hopdiff.search": 1,
    "hopdiff.terrain": 1,
    "hopdiff.proportions": 1,
    "hopdiff.character": 2,
    "hopdiff.genes": 2,
    "hopdiff.whole_body": 2,
    "hopdiff.models": 2,
    "hopdiff.feet": 2,
    "hopdiff.editing": 2,
    "hopdiff.costs": 3,
    "hopdiff.limits": 3,
    "hopdiff.effort": 3,
    "hopdiff.kernels": 3,
    "hopdiff.problem": 3,
    "hopdiff.io": 3,
    "hopdiff.graph": 3,
    "hopdiff.export": 3,
    "hopdiff.metrics": 3,
    "hopdiff.joins": 3,
    "hopdiff.runs": 3,
    "hopdiff.plots": 4,
    "hopdiff.composing": 4,
    "hopdiff.choices": 4,
    "hopdiff.grounds": 4,
    "hopdiff.job": 4,
    "hopdiff.config": 4,
    "hopdiff.tasks": 5,
    "hopdiff.errors": 6,
    "hopdiff.perform": 6,
    "hopdiff.callbacks": 6,
    "hopdiff.cli": 6,
    "hopdiff.api": 6,
    "hopdiff.__main__": 6,
    "hopdiff": 6,
}
# Which packages of one floor may look at each other.
NEIGHBOURS = {
    ("hopdiff.messages", "hopdiff.types"),
    ("hopdiff.numerics", "hopdiff.types"),
    ("hopdiff.motion", "hopdiff.geometry"),
    ("hopdiff.whole_body", "hopdiff.character"),
    ("hopdiff.models", "hopdiff.character"),
    ("hopdiff.models", "hopdiff.genes"),
    ("hopdiff.models", "hopdiff.whole_body"),
    ("hopdiff.feet", "hopdiff.editing"),
    ("hopdiff.feet", "hopdiff.terrain"),
    ("hopdiff.graph", "hopdiff.io"),
    ("hopdiff.joins", "hopdiff.graph"),
    ("hopdiff.joins", "hopdiff.io"),
    ("hopdiff.export", "hopdiff.io"),
    ("hopdiff.runs", "hopdiff.io"),
    ("hopdiff.effort", "hopdiff.kernels"),
    ("hopdiff.kernels", "hopdiff.effort"),
    ("hopdiff.limits", "hopdiff.costs"),
    ("hopdiff.problem", "hopdiff.costs"),
    ("hopdiff.problem", "hopdiff.limits"),
    ("hopdiff.metrics", "hopdiff.costs"),
    ("hopdiff.metrics", "hopdiff.limits"),
    ("hopdiff.metrics", "hopdiff.problem"),
    ("hopdiff.doors", "hopdiff.types"),
    ("hopdiff.doors", "hopdiff.messages"),
    ("hopdiff.objective", "hopdiff.types"),
    ("hopdiff.objective", "hopdiff.messages"),
    ("hopdiff.grounds", "hopdiff.choices"),
    ("hopdiff.grounds", "hopdiff.composing"),
    ("hopdiff.config", "hopdiff.choices"),
    ("hopdiff.config", "hopdiff.composing"),
    ("hopdiff.config", "hopdiff.job"),
}
# Who may know Hydra, and who PyTorch's optimisers.
HYDRA = {
    "hopdiff.composing",
    "hopdiff.config",
    "hopdiff.errors",
    "hopdiff.perform",
    "hopdiff.callbacks",
    "hopdiff.cli",
    "hopdiff.api",
}


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(module: str) -> str:
    """The entry of FLOORS that a module belongs to."""
    for name in sorted(FLOORS, key=len, reverse=True):
        if module == name or (name != "hopdiff" and module.startswith(f"{name}.")):
            return name
    raise AssertionError(f"{module} has no floor: give it one")


def imports(tree: ast.AST, known: set[str]) -> set[str]:
    """The modules that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in known else str(node.module))
    return found


FILES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in FILES.items()}
GRAPH = {name: imports(tree, set(FILES)) for name, tree in TREES.items()}
INSIDE = {name: {target for target in targets if target in FILES} - {name} for name, targets in GRAPH.items()}


@pytest.mark.parametrize("module", sorted(FILES))
def test_imports_go_down(module: str) -> None:
    here = room(module)
    for target in INSIDE[module]:
        there = room(target)
        if there in (here, "hopdiff") or FLOORS[there] < FLOORS[here] or FLOORS[here] == 6:
            continue
        assert (here, there) in NEIGHBOURS, f"{module} must not import {target}"


def test_imports_make_no_circle() -> None:
    # The package's own front door loads the generator on demand and is left out.
    graph = {name: targets - {"hopdiff"} for name, targets in INSIDE.items() if name != "hopdiff"}
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize("module", sorted(set(FILES) - {"hopdiff"}))
def test_no_import_hides_in_a_function(module: str) -> None:
    for function in ast.walk(TREES[module]):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            hidden = [node for node in ast.walk(function) if isinstance(node, ast.Import | ast.ImportFrom)]
            assert not hidden, f"{module}, line {hidden[0].lineno}"


@pytest.mark.parametrize("module", sorted(set(FILES) - HYDRA))
def test_only_the_top_floor_knows_hydra(module: str) -> None:
    assert not {target for target in GRAPH[module] if target.split(".")[0] == "hydra"}


def test_search_knows_no_physics() -> None:
    for module, targets in INSIDE.items():
        if module.startswith("hopdiff.search"):
            strangers = {target for target in targets if not target.startswith("hopdiff.search")}
            assert strangers <= {"hopdiff.types", "hopdiff.numerics"}, module


@pytest.mark.parametrize("module", sorted(FILES))
def test_files_stay_readable(module: str) -> None:
    assert len(FILES[module].read_text(encoding="utf-8").splitlines()) <= 320
