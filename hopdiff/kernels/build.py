"""Compiling the kernels: traced with all numbers as inputs, then compiled ahead of time by PyTorch's AOTInductor.

It writes C++ and needs a compiler. Imported only where something is to be built: PyTorch's compiler takes seconds to
load.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import torch
from filelock import FileLock
from torch import Tensor
from torch._functorch.compile_utils import fx_graph_cse
from torch._inductor import aoti_compile_and_package
from torch.fx.experimental.proxy_tensor import make_fx

from hopdiff.kernels.numbers import numbers_of, packed, with_numbers
from hopdiff.kernels.pieces import Piece, Told
from hopdiff.kernels.store import ENDING, MOST, PIECES, SETTINGS, compiler, tidy
from hopdiff.messages import one_line
from hopdiff.types import HopdiffError

TRACED = 6  # candidates of the tracing; any number that is neither 0 nor 1 will do


def build(told: Told, values: Tensor, folder: Path, say: Callable[[str], None]) -> None:
    """Compile every piece that the folder lacks, with a candidate's values (1, G) to trace with.

    say: is told what is being done. Several programs may build at once: the others wait for the first. A build that
    is broken off leaves whole pieces only. Raises HopdiffError where the folder cannot be written, or the compiler
    fails.
    """
    values = values.expand(TRACED, -1).contiguous()
    movement = told.movement(values)
    state = movement.start()
    shared, still = movement.inverse_inertia(state)[:1], values.new_zeros(TRACED)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HopdiffError(f"compile=true: {folder} cannot be written: {error.strerror}.") from error
    more = {"round": (shared,), "pull": (torch.ones_like(state), shared), "roots": (still,), "slopes": (still,)}
    with FileLock(folder / "lock"):
        for k, piece in enumerate(PIECES):
            path = folder / f"{piece}{ENDING}"
            if path.is_file():
                continue
            say(f"compiling kernels, {k + 1} of {len(PIECES)} ...")
            with tempfile.TemporaryDirectory(dir=folder) as made:
                partial = Path(made) / path.name
                _compile(told, piece, (values, state, *more[piece]), partial)
                partial.replace(path)
    tidy()


def _compile(told: Told, name: str, example: tuple[Tensor, ...], path: Path) -> None:
    plain, tensors, _ = numbers_of(told)
    count = len(example)

    def traced(*given: Tensor) -> tuple[Tensor, ...]:
        own = with_numbers(told, given[count], list(given[count + 1 :]))
        piece: Piece = getattr(own, name)
        return piece(*given[:count])

    given = tuple(x.contiguous() for x in (*example, packed(plain, example[0]), *tensors))
    traced(*given)  # constants of the nodes are made once and kept: not in the middle of a trace
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        graph = make_fx(traced, tracing_mode="symbolic", _allow_non_fake_inputs=True)(*given)
        graph.graph = fx_graph_cse(graph.graph)
        graph.graph.eliminate_dead_code()
        graph.recompile()
        many = torch.export.Dim("P", min=2, max=MOST)
        shapes = tuple({0: many} if k < count and x.shape[0] == TRACED else None for k, x in enumerate(given))
        exported = torch.export.export(graph, given, dynamic_shapes=shapes, strict=False)
        settings = {**SETTINGS, "cpp.cxx": (None, compiler())}
        try:
            aoti_compile_and_package(exported, package_path=str(path), inductor_configs=settings)
        except (RuntimeError, OSError) as error:
            raise HopdiffError(
                f"compile=true: {compiler()} could not compile the kernels: {one_line(error)}"
            ) from error
