"""Markdown of a mutation study."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from experiments.report import markdown

Row = Mapping[str, str]
SURVIVED, TIMEOUT = "survived", "timeout"
WIDEST = 110  # characters of a line of code


def report(rows: Sequence[Row], equivalents: Mapping[str, str]) -> str:
    """How many were killed of each part, what survived, and what is equivalent."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    commits = ", ".join(dict.fromkeys(row["commit"] for row in rows))
    parts = [f"# Mutants\n\n{len(rows)} changes, tried at commit {commits}, by `python -m experiments.mutants`.\n"]
    for kind in kinds:
        own = [row for row in rows if row["kind"] == kind]
        parts.append(f"## {kind.capitalize()}\n\n{totals(own, equivalents)}")
    for title, wanted in (("Survivors", False), ("Equivalent", True)):
        found = [row for row in rows if row["result"] == SURVIVED and (row["name"] in equivalents) == wanted]
        if found:
            parts.append(f"## {title}\n\n" + "".join(_line(row, equivalents) for row in found))
    return "\n".join(parts)


def totals(rows: Sequence[Row], equivalents: Mapping[str, str]) -> str:
    """One line a part and one for all: mutants that are not equivalent, killed, too slow (killed too), survivors."""
    names = list(dict.fromkeys(row["part"] for row in rows))
    lines = [(name, *_counts([row for row in rows if row["part"] == name], equivalents)) for name in names]
    if len(names) > 1:
        lines.append(("all", *_counts(rows, equivalents)))
    return markdown(("part", "mutants", "killed", "of these by time", "survived", "killed %", "equivalent"), lines)


def _counts(rows: Sequence[Row], equivalents: Mapping[str, str]) -> tuple[object, ...]:
    same = [row for row in rows if row["result"] == SURVIVED and row["name"] in equivalents]
    results = Counter(row["result"] for row in rows)
    count = len(rows) - len(same)
    survived = results[SURVIVED] - len(same)
    share = f"{100 * (count - survived) / count:.1f}" if count else ""
    return count, count - survived, results[TIMEOUT], survived, share, len(same)


def _line(row: Row, equivalents: Mapping[str, str]) -> str:
    file = row["name"].partition(":")[0]
    reason = f" {equivalents[row['name']]}" if row["name"] in equivalents else ""
    return f"- `{file}:{row['line']}` `{_cut(row['code'])}` → `{_cut(row['changed'])}`{reason}\n"


def _cut(code: str) -> str:
    return code if len(code) <= WIDEST else f"{code[: WIDEST - 1]}…"
