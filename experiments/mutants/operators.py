"""Small wrong changes of a Python file, found in its syntax tree and made in its text."""

from __future__ import annotations

import ast
import copy
import random
from collections import Counter
from dataclasses import dataclass, replace

# Either stands for the other, as a function or a name.
CALLS = dict(
    pair
    for one, other in (
        ("cos", "sin"),
        ("min", "max"),
        ("amin", "amax"),
        ("minimum", "maximum"),
        ("argmin", "argmax"),
        ("floor", "ceil"),
        ("any", "all"),
    )
    for pair in ((one, other), (other, one))
)
NAMES = dict(
    pair
    for one, other in (
        ("left", "right"),
        ("before", "after"),
        ("start", "end"),
        ("first", "last"),
        ("contact", "flight"),
        ("thigh", "shank"),
        ("low", "high"),
    )
    for pair in ((one, other), (other, one))
)
# Calls of one argument, or methods, without which the value goes on as it is.
DROPPED = {"abs", "sqrt", "safe_sqrt", "exp", "log", "relu", "clamp", "clamp_min", "clamp_max", "cumsum", "flip"}
ARITHMETIC: dict[type, type] = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
LOGIC: dict[type, type] = {ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.And: ast.Or, ast.Or: ast.And}
COMPARED: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
# Numbers of dimensions, whose change only raises, and flags that no result hangs on.
SHAPE_METHODS = {"unsqueeze", "squeeze", "flatten", "unbind", "chunk", "expand", "reshape", "permute", "transpose"}
REDUCTIONS = {"sum", "mean", "amax", "amin", "max", "min", "any", "all", "norm", "diff", "argmin", "argmax"}
SHAPE_KEYWORDS = {"dim", "dims", "axis", "keepdim", "keepdims", "strict", "dtype", "device", "encoding", "indexing"}

GUARD = 1e-6  # up to which a constant only keeps a division or a comparison from rounding


@dataclass(frozen=True)
class Mutant:
    """One change: bytes `start` to `stop` of a file become `after`.

    function: qualified name of the function or class around it, "" for the module. defined: line at which that
    function begins, as its code object says, 0 outside of functions. number: tells equal changes of one function apart.
    """

    file: str
    line: int
    function: str
    defined: int
    operator: str
    before: str
    after: str
    start: int
    stop: int
    number: int = 1

    @property
    def name(self) -> str:
        """Stays the same as long as the function does; lines may move."""
        again = f" ({self.number})" if self.number > 1 else ""
        return f"{self.file}:{self.function or 'module'}: {self.before} -> {self.after}{again}"

    def applied(self, text: str) -> str:
        """The text of the file with the change."""
        source = text.encode()
        return (source[: self.start] + self.after.encode() + source[self.stop :]).decode()


def mutants_of(file: str, text: str) -> list[Mutant]:
    """All changes of a file, in order of place."""
    finder = _Finder(file, text)
    finder.visit(finder.tree)
    found, seen = [], Counter[str]()
    for mutant in sorted(finder.found, key=lambda m: (m.start, m.stop, m.operator, m.after)):
        seen[mutant.name] += 1
        found.append(replace(mutant, number=seen[mutant.name]))
    return found


def is_sound(mutant: Mutant, text: str) -> bool:
    """Whether the changed file is Python, and says something else."""
    try:
        return ast.dump(ast.parse(mutant.applied(text))) != ast.dump(ast.parse(text))
    except SyntaxError:
        return False


class _Finder(ast.NodeVisitor):
    def __init__(self, file: str, text: str) -> None:
        self.file, self.text = file, text
        self.tree = ast.parse(text)
        lines = text.encode().splitlines(keepends=True)
        self.offsets = [0]
        for line in lines:
            self.offsets.append(self.offsets[-1] + len(line))
        self.words = {n.id for n in ast.walk(self.tree) if isinstance(n, ast.Name)}
        self.words |= {n.attr for n in ast.walk(self.tree) if isinstance(n, ast.Attribute)}
        self.words |= {n.arg for n in ast.walk(self.tree) if isinstance(n, ast.arg)}
        self.around: list[tuple[str, int]] = []
        self.found: list[Mutant] = []

    # What is looked at: values that a run computes with. Not annotations, messages and docstrings.

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
        self.around.append((node.name, first))
        for part in (*node.args.defaults, *(d for d in node.args.kw_defaults if d), *node.body):
            self.visit(part)
        self.around.pop()

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self.around.append((node.name, 0))
        for part in node.body:
            self.visit(part)
        self.around.pop()

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value:
            self.visit(node.value)

    def visit_Expr(self, node: ast.Expr) -> None:
        if not isinstance(node.value, ast.Constant):
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in SHAPE_KEYWORDS:
            self.visit(node.value)

    def _nothing(self, node: ast.AST) -> None:
        pass

    visit_Raise = visit_Assert = visit_JoinedStr = visit_Import = visit_ImportFrom = _nothing  # noqa: N815

    # The operators.

    def visit_BinOp(self, node: ast.BinOp) -> None:
        text = any(
            isinstance(side, ast.Constant | ast.JoinedStr) and _is_text(side) for side in (node.left, node.right)
        )
        kind = type(node.op)
        if kind in ARITHMETIC and not text:
            self._changed("sign" if kind in (ast.Add, ast.Sub) else "factor", node, op=ARITHMETIC[kind]())
            self._add("drop", node, ast.unparse(node.left))
            if kind in (ast.Add, ast.Mult):
                self._add("drop", node, ast.unparse(node.right))
        if kind in LOGIC:
            self._changed("logic", node, op=LOGIC[kind]())
        if kind is ast.Pow and isinstance(node.right, ast.Constant):
            for more in (1, -1):
                self._add("exponent", node.right, repr(node.right.value + more))
            self.visit(node.left)
        else:
            self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not | ast.Invert):
            self._add("sign" if isinstance(node.op, ast.USub) else "logic", node, ast.unparse(node.operand))
        if not (isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant) and node.operand.value == 1):
            self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        self._changed("logic", node, op=LOGIC[type(node.op)]())
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for k, op in enumerate(node.ops):
            for other in COMPARED.get(type(op), ()):
                self._changed("comparison", node, ops=[*node.ops[:k], other(), *node.ops[k + 1 :]])
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._changed("logic", node, body=node.orelse, orelse=node.body)
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        # A number with a name of its own was chosen; to test it would be to write it down twice.
        inside = bool(self.around and self.around[-1][1])
        if isinstance(value, bool):
            self._add("boolean", node, repr(not value))
        elif isinstance(value, int) and inside:
            self._add("constant", node, repr(value + 1))
        elif isinstance(value, float) and inside and not 0.0 < abs(value) <= GUARD:
            self._add("constant", node, repr(float(f"{1.1 * value:.12g}")) if value else "1.0")
        elif isinstance(value, str) and value.isidentifier() and {"left", "right"} & set(value.split("_")):
            self._add("name", node, f'"{_swapped(value)}"')

    def visit_Name(self, node: ast.Name) -> None:
        self._renamed(node, node.id, ast.unparse(node))

    def visit_Attribute(self, node: ast.Attribute) -> None:
        self._renamed(node, node.attr, ast.unparse(node))
        self.visit(node.value)

    def visit_Call(self, node: ast.Call) -> None:
        called = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if called in CALLS:
            twin = copy.deepcopy(node.func)
            setattr(twin, "attr" if isinstance(twin, ast.Attribute) else "id", CALLS[called])
            self._add("function", node.func, ast.unparse(twin))
        if called in DROPPED:
            method = isinstance(node.func, ast.Attribute) and getattr(node.func.value, "id", "") not in (
                "torch",
                "np",
                "math",
            )
            inner = node.func.value if method else node.args[0]
            self._add("drop", node, ast.unparse(inner))
        if len(node.args) >= 2 and all(isinstance(a, ast.Name | ast.Attribute | ast.Subscript) for a in node.args[:2]):
            self._changed("arguments", node, args=[node.args[1], node.args[0], *node.args[2:]])
        if isinstance(node.func, ast.Attribute):
            self.visit(node.func.value)
        shape = called in SHAPE_METHODS | REDUCTIONS
        for part in (*node.args, *node.keywords):
            if not (shape and isinstance(part, ast.Constant | ast.UnaryOp | ast.Tuple)):
                self.visit(part)

    # Bookkeeping.

    def _renamed(self, node: ast.Name | ast.Attribute, word: str, whole: str) -> None:
        twin = _swapped(word)
        if isinstance(node.ctx, ast.Load) and twin != word and twin in self.words:
            self._add("name", node, whole[: len(whole) - len(word)] + twin)

    def _changed(self, operator: str, node: ast.expr, **fields: object) -> None:
        other = copy.deepcopy(node)
        for name, value in fields.items():
            setattr(other, name, value)
        text = ast.unparse(other)
        loose = isinstance(node, ast.BoolOp) or (isinstance(node, ast.BinOp) and type(node.op) in LOGIC)
        self._add(operator, node, f"({text})" if loose else text)

    def _add(self, operator: str, node: ast.expr, after: str) -> None:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start = self.offsets[node.lineno - 1] + node.col_offset
        stop = self.offsets[node.end_lineno - 1] + node.end_col_offset
        functions = [name for name, _ in self.around]
        defined = self.around[-1][1] if self.around else 0
        before = " ".join(self.text.encode()[start:stop].decode().split())
        self.found.append(
            Mutant(self.file, node.lineno, ".".join(functions), defined, operator, before, after, start, stop)
        )


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or isinstance(getattr(node, "value", None), str)


def _swapped(word: str) -> str:
    """The word with the first part that has a twin exchanged for it, such as right_knee for left_knee."""
    parts = word.split("_")
    for k, part in enumerate(parts):
        if part in NAMES:
            return "_".join([*parts[:k], NAMES[part], *parts[k + 1 :]])
    return word


def in_turn(found: list[Mutant], chance: random.Random) -> list[Mutant]:
    """The mutants of a file in the order in which they are taken: operators in turn, within each by chance."""
    found = chance.sample(found, len(found))
    turns, ranked = Counter[str](), []
    for mutant in found:
        ranked.append((turns[mutant.operator], mutant))
        turns[mutant.operator] += 1
    return [mutant for _, mutant in sorted(ranked, key=lambda pair: pair[0])]
