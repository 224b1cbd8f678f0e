"""What hopdiff does with packages of its extras, and which of them are missing here."""

from __future__ import annotations

import os
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

FOLDER = "HOPDIFF_FOLDER"  # see conf/hydra/launcher/ray_cluster.yaml


class Extra(NamedTuple):
    """package: that the extra stands or falls with. use: what for, as it is typed."""

    package: str
    use: str


EXTRAS = {
    "parallel": Extra("hydra-joblib-launcher", "hydra/launcher=joblib: sweeps on all cores"),
    "ray": Extra("hydra-ray-launcher", "hydra/launcher=ray (or ray_cluster): sweeps on Ray, here or on a cluster"),
    "slurm": Extra("hydra-submitit-launcher", "hydra/launcher=slurm: sweeps on a Slurm cluster"),
    "draco": Extra("DracoPy", "retarget.skeleton: the skin of characters compressed by Draco"),
    "meshopt": Extra("meshoptimizer", "retarget.skeleton: the skin of characters compressed by meshopt"),
    "usd": Extra("usd-core", "export=[usd]: motions as Universal Scene Description"),
}


def missing_extras() -> str:
    """A paragraph for --help with how to get what is missing; nothing where nothing is."""
    lines = [f"  {install(name):<38} {extra.use}" for name, extra in EXTRAS.items() if not _is_installed(extra.package)]
    return "\n".join(["\n\nNot installed here", *lines]) if lines else ""


def of_launcher(text: str) -> str | None:
    """The sentence for an error of Hydra about a launcher whose package is missing; None for any other error."""
    found = re.search(r"Unknown plugin class : 'hydra_plugins\.(\w+)\.", text)
    for name, extra in EXTRAS.items():
        if found and found.group(1) == extra.package.replace("-", "_"):
            return f"{extra.use.partition(':')[0]} needs the extra: {install(name)}."
    return None


def install(name: str) -> str:
    """The command that brings an extra: in a checkout with the versions that were tested."""
    if (Path(__file__).resolve().parents[1] / "constraints.txt").is_file():
        return f"pip install -c constraints.txt -e '.[{name}]'"
    return f"pip install 'hopdiff[{name}]'"


def enter_folder() -> None:
    """Work in the folder of the command, wherever a worker of Ray was started.

    Raises OSError, which fails the job, if this machine has no such folder.
    """
    os.chdir(os.environ[FOLDER])


def _is_installed(package: str) -> bool:
    try:
        version(package)
    except PackageNotFoundError:
        return False
    return True
