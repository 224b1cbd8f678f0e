"""Objects as structure and numbers, so that one kernel serves every body, speed and cost of one structure.

A kernel that is traced from an object burns its numbers in. Here they are taken out, in a fixed order, and others put
in: tensors as they are, plain numbers as tensors without dimensions. What cannot change without other equations
(names, counts, what is missing, what is exactly 0 or infinite) stays, and is told as the object's structure.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from hopdiff.character import Character
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.plan import Plan

APART = (Character, Skeleton)  # read by no equation: their numbers stand in a Layout

Leaf = Callable[[Any], Any]


def numbers_of(source: Any) -> tuple[list[float], list[Tensor], str]:
    """The plain numbers and the tensors of an object, and its structure. Raises TypeError for what is neither."""
    plain: list[float] = []
    tensors: list[Tensor] = []
    marks: list[str] = []

    def take(leaf: Any) -> Any:
        marks.append("number" if isinstance(leaf, float) else str(tuple(leaf.shape)))
        (plain if isinstance(leaf, float) else tensors).append(leaf)
        return leaf

    _mapped(source, take, marks)
    return plain, tensors, " ".join(marks)


def with_numbers(source: Any, plain: Tensor, tensors: list[Tensor]) -> Any:
    """A copy with other numbers. plain: (N,) in the place of the plain ones; tensors: of its tensors."""
    numbers, others = iter(plain.unbind()), iter(tensors)
    return _mapped(source, lambda leaf: next(numbers if isinstance(leaf, float) else others), [])


def _mapped(source: Any, leaf: Leaf, marks: list[str]) -> Any:
    """A copy with `leaf` of every number in its place; marks: where the structure is told."""
    if isinstance(source, APART):
        return None
    if source is None or isinstance(source, bool | int | str | Enum | Plan):
        marks.append(repr(source))
        return source
    if isinstance(source, float):
        if source == 0.0 or not math.isfinite(source):
            marks.append(repr(source))
            return source
        return leaf(source)
    if isinstance(source, Tensor):
        return leaf(source)
    marks.append(type(source).__name__)
    if isinstance(source, dict):
        marks.append(repr([*source]))
        return {name: _mapped(value, leaf, marks) for name, value in source.items()}
    if isinstance(source, tuple) and hasattr(source, "_fields"):
        return type(source)(*(_mapped(value, leaf, marks) for value in source))
    if isinstance(source, list | tuple):
        return type(source)(_mapped(value, leaf, marks) for value in source)
    if is_dataclass(source):
        found = copy.copy(source)
        for name in _parts(source):
            # Frozen ones too: nobody else has seen the copy yet. What they would work out later is put in as well.
            vars(found)[name] = _mapped(getattr(source, name), leaf, marks)
        return found
    raise TypeError(f"a {type(source).__name__} has no numbers that a kernel could be told.")


def _parts(source: Any) -> Iterator[str]:
    yield from (entry.name for entry in fields(source))
    yield from (name for name, value in vars(type(source)).items() if isinstance(value, cached_property))


def packed(plain: list[float], like: Tensor) -> Tensor:
    """Plain numbers as one tensor (N,)."""
    return torch.tensor(plain, dtype=like.dtype, device=like.device)
