"""Docstrings of the house taken apart: plain sentences, and what is said of each field or parameter."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from textwrap import dedent
from typing import Any

_LABEL = r"(?:^|(?<=[.;)] ))((?:[a-z_]\w*, )*[a-z_]\w*(?: \[[^\]]+\])?): "


ITEM, CODE = "-", "|"  # labels of entries of a list, and of blocks of code


def parts(text: str, known: set[str]) -> Iterator[tuple[str, str]]:
    """Label and text: the label is empty for plain sentences, ITEM, CODE, or what names some of the `known` fields."""
    for paragraph in re.split(r"\n[ \t]*\n|\n\s*(?=Raises )", text.strip("\n")):
        if paragraph.startswith((" ", "\t")):
            yield CODE, dedent(paragraph)
        elif paragraph.startswith("- "):
            for item in re.split(r"\n(?=- )", paragraph):
                yield ITEM, " ".join(item[2:].split())
        else:
            yield from _labelled(" ".join(paragraph.split()), known)


def _labelled(flat: str, known: set[str]) -> Iterator[tuple[str, str]]:
    """A paragraph cut before each label such as "force, cop: "."""
    cuts = [match.start() for match in re.finditer(_LABEL, flat) if names_of(match[1]) <= known]
    for start, end in zip([0, *cuts], [*cuts, len(flat)], strict=True):
        if part := flat[start:end].strip():
            label = re.match(_LABEL, part) if start in cuts else None
            yield (label[1], part[label.end() :]) if label else ("", part)


def names_of(label: str) -> set[str]:
    """The names in a label such as "force, cop" or "speed [m/s]"."""
    return set(re.sub(r" \[[^\]]+\]", "", label).split(", "))


def fields_of(found: Any) -> set[str]:
    """Names of the parameters or fields of an object."""
    names: set[str] = set(getattr(found, "_fields", ()))
    if is_dataclass(found):
        names |= {entry.name for entry in fields(found)}
    with suppress(TypeError, ValueError):  # not every class tells its parameters
        names |= set(inspect.signature(found).parameters)
    return names


def said_of_fields(found: Any) -> dict[str, str]:
    """What the docstring of a class says of each of its fields."""
    known = fields_of(found)
    # Those of a base class are told in its own docstring.
    docs = (
        [one.__doc__ for one in reversed(inspect.getmro(found)) if is_dataclass(one)] if inspect.isclass(found) else []
    )
    said = [part for text in docs or [found.__doc__] for part in parts(inspect.cleandoc(text or ""), known)]
    return {name: text for label, text in said for name in sorted(names_of(label) & known)}
