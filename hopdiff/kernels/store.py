"""Where compiled kernels lie: a folder for one structure of the equations, one version of them, of PyTorch and of the
processor.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import torch
from platformdirs import user_cache_path
from torch import Tensor

PIECES = ("round", "pull", "roots", "slopes")  # methods of `hopdiff.kernels.pieces.Told`
MOST = 64  # candidates at once
ENDING = ".pt2"
NAME, KEPT = 24, 8  # letters of a folder's name, and how many folders are kept
CACHE = "HOPDIFF_CACHE"  # names another folder for them
SOURCES = ("whole_body", "effort", "kernels/numbers.py", "kernels/pieces.py", "numerics.py", "objective.py")
# More operations in one loop make little less work for the machine and minutes more for the compiler.
SETTINGS = {"aot_inductor.compile_wrapper_opt_level": "O0", "max_fusion_size": 16, "cpp.threads": 1}

Kernel = Callable[[list[Tensor]], list[Tensor]]


def cache_folder() -> Path:
    """Where all kernels lie: what HOPDIFF_CACHE names, or the system's place for what can be worked out again."""
    chosen = os.environ.get(CACHE)
    return Path(chosen) if chosen else user_cache_path("hopdiff", appauthor=False)


@cache
def equations() -> str:
    """A word for the source that kernels are traced from: another one for other equations."""
    found = hashlib.sha256()
    home = Path(__file__).parent.parent
    for name in SOURCES:
        path = home / name
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            found.update(file.read_bytes())
    return found.hexdigest()


def folder_of(structure: str) -> Path:
    """The folder of the kernels of one structure, there or not."""
    machine = (torch.__version__, torch.backends.cpu.get_cpu_capability(), str(SETTINGS), equations())
    return cache_folder() / hashlib.sha256("\n".join((structure, *machine)).encode()).hexdigest()[:NAME]


def tidy() -> None:
    """Only the KEPT folders that were written last stay: others are of equations or versions that have gone."""
    folders = [path for path in cache_folder().glob("[0-9a-f]" * NAME) if path.is_dir()]
    for folder in sorted(folders, key=lambda path: path.stat().st_mtime, reverse=True)[KEPT:]:
        shutil.rmtree(folder, ignore_errors=True)


def is_built(folder: Path) -> bool:
    return all((folder / f"{piece}{ENDING}").is_file() for piece in PIECES)


def compiler() -> str | None:
    """The C++ compiler that a build would call, None where there is none."""
    names = (os.environ.get("CXX"), "g++", "clang++")
    return next((found for name in names if name and (found := shutil.which(name))), None)


def load(folder: Path, piece: str) -> Kernel:
    """A compiled piece. Raises RuntimeError where it cannot be loaded."""
    # What `torch._inductor.aoti_load_package` ends in, without the seconds in which it looks for a compiler.
    loader = torch._C._aoti.AOTIModelPackageLoader(str(folder / f"{piece}{ENDING}"), "model", True, 1, -1)
    run: Kernel = loader.run
    return run
