"""The page of the API: which names it lists, and the house's docstrings as Sphinx reads them."""

from __future__ import annotations

import inspect
import re
from textwrap import indent
from typing import Any

from site_docstrings import CODE, ITEM, fields_of, parts

import hopdiff

# What the names of `hopdiff.__all__` return and take.
OTHERS = (
    "hopdiff.job.Run",
    "hopdiff.motion.Motion",
    "hopdiff.motion.Phase",
    "hopdiff.geometry.clip.Clip",
    "hopdiff.geometry.skeleton.Skeleton",
    "hopdiff.export.take.Take",
    "hopdiff.export.take.Segments",
    "hopdiff.export.take.ContactEvent",
    "hopdiff.search.loop.HistoryRow",
)


def api_page() -> str:
    """The generated part of the page as Markdown: a heading a name, and Sphinx's directive below it."""
    public = [f"hopdiff.{name}" for name in hopdiff.__all__ if not name.startswith("__")]
    known = {getattr(hopdiff, name) for name in hopdiff.__all__ if not name.startswith("__")}
    others = [name for name in OTHERS if _object(name) not in known]
    return "\n\n".join(
        ("## Names of the package", *map(_entry, public), "## What they take and return", *map(_entry, others))
    )


def _object(name: str) -> Any:
    module, _, attribute = name.rpartition(".")
    return getattr(__import__(module, fromlist=[attribute]), attribute)


def _entry(name: str) -> str:
    found = _object(name)
    kind = "function"
    if inspect.isclass(found):
        kind = "exception" if issubclass(found, Exception) else "class"
    members = "   :members:\n" if kind == "class" else ""
    return f"### {name.rpartition('.')[2]}\n\n```{{eval-rst}}\n.. auto{kind}:: {name}\n{members}```"


def as_rst(app: Any, what: str, name: str, found: Any, options: Any, lines: list[str]) -> None:
    """A docstring of the house as reStructuredText: fields as a list, errors apart, single back quotes as code."""
    made: list[str] = []
    for label, text in parts("\n".join(lines), fields_of(found)):
        if label == CODE:
            made += ["::", "", indent(text, "    "), ""]
        else:
            mark = {"": "", ITEM: "* "}.get(label, f"* **{label}**: ")
            made += [f"{mark}{_escaped(text)}", ""]
    lines[:] = "\n".join(made).split("\n")


def shown_signature(
    app: Any, what: str, name: str, found: Any, options: Any, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """A signature that Sphinx can read: a default that is made anew each time has no literal."""
    return (signature and signature.replace("<factory>", "..."), returned)


def _escaped(text: str) -> str:
    """Single back quotes doubled; signs of reStructuredText outside of them escaped."""
    pieces = re.split(r"(`+[^`]*`+)", text)
    return "".join(
        f"``{part.strip('`')}``" if k % 2 else re.sub(r"([*|]|\b_|_\b)", r"\\\1", part) for k, part in enumerate(pieces)
    )
