"""Whether a problem is priced by compiled kernels, and the word that says why not."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.kernels.bound import Bound
from hopdiff.kernels.numbers import numbers_of
from hopdiff.kernels.pieces import Told
from hopdiff.kernels.store import PIECES, compiler, folder_of, is_built, load
from hopdiff.messages import choose, one_line, say
from hopdiff.types import HopdiffError

AUTO, ON, OFF = "auto", "true", "false"
CHOICES = (AUTO, ON, OFF)
MINUTES = "some 5 minutes"  # that a build takes on one core


class Choice(NamedTuple):
    """kernels: None where PyTorch's own operations are used. word: what the user is told of it, nothing where that is
    what was asked for."""

    kernels: Bound | None
    word: str


def chosen(mode: str, told: Told, values: Tensor, foreign: bool) -> Choice:
    """The kernels of what is told, built first where `mode` is "true"; with "auto" those that are there.

    values: (1, G) genes of some run, to compile with. foreign: whether the cost has terms that are not ours, which
    kernels do not know. Raises HopdiffError where "true" cannot be done.
    """
    choose("compile", mode, CHOICES)
    if mode == OFF:
        return Choice(None, "")
    like = told.numbers.muscles.give
    why = _unable(like, foreign)
    if why and mode == ON:
        raise HopdiffError(f"compile=true: {why}.")
    if why:
        return Choice(None, f"compile=auto: not compiled, {why}.")
    folder = folder_of(numbers_of(told)[2])
    if is_built(folder):
        return _loaded(folder, told, mode)
    if mode == AUTO:
        advice = "compile=true does it once" if compiler() else "with a C++ compiler, compile=true does it once"
        return Choice(None, f"compile=auto: nothing is compiled yet for runs of this kind; {advice}, in {MINUTES}.")
    if not compiler():
        raise HopdiffError("compile=true needs a C++ compiler: g++ or clang++ on PATH, or the one that CXX names.")
    import_module("hopdiff.kernels.build").build(told, values, folder, say)
    return _loaded(folder, told, mode)


def _loaded(folder: Path, told: Told, mode: str) -> Choice:
    """Kernels that are there, if this PyTorch takes them."""
    try:
        return Choice(Bound({piece: load(folder, piece) for piece in PIECES}, told), "")
    except (RuntimeError, TypeError) as error:
        why = f"what is compiled in {folder} cannot be loaded: {one_line(error)}"
        if mode == ON:
            raise HopdiffError(f"compile=true: {why}.") from error
        return Choice(None, f"compile=auto: {why}.")


def _unable(like: Tensor, foreign: bool) -> str:
    """Why there can be no kernels here; nothing where there can."""
    if like.device.type != "cpu":
        return "kernels are for device=cpu"
    if like.dtype != torch.float64:
        return "kernels are for dtype=float64"
    if foreign:
        return "the cost has terms of other packages"
    if not hasattr(getattr(torch._C, "_aoti", None), "AOTIModelPackageLoader"):
        return f"PyTorch {torch.__version__} has no AOTInductor"
    return ""
