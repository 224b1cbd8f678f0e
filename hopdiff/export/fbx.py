"""FBX files, made from GLB files by Blender where there is one: it is no part of hopdiff."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

VARIABLE = "HOPDIFF_BLENDER"
SCRIPT = Path(__file__).with_name("blender_fbx.py")
HOW = f"`pip install bpy` in an environment of its own and set {VARIABLE} to that environment's python"
SECONDS = 300.0  # that Blender may take
ASK = 60.0  # s that it may take to say what it is
# What would lead Blender's Python to another's packages.
STRANGE = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP", "VIRTUAL_ENV")


def write_fbx(
    path: str | os.PathLike[str],
    glb: bytes | str | os.PathLike[str],
    blender: str | None = None,
    seconds: float = SECONDS,
) -> None:
    """Write the bodies and animations of a GLB file as FBX, in centimetres with y up; whole or not at all.

    glb: a file's content or its path. blender: see `find_blender`. seconds: after which Blender is stopped. Every
    animation becomes a take with keys at its own frames; the file's frame rate is that of the first one.
    Raises HopdiffError if there is no Blender, it fails or takes too long, or the file cannot be read or written.
    """
    program = find_blender(blender)
    try:
        data = glb if isinstance(glb, bytes) else Path(glb).read_bytes()
    except OSError as error:
        raise HopdiffError(f"cannot read {glb!s}: {(error.strerror or str(error)).lower()}.") from error
    with tempfile.TemporaryDirectory(prefix="hopdiff_fbx_") as folder:
        source, target = Path(folder, "body.glb"), Path(folder, "body.fbx")
        source.write_bytes(data)
        run_in_blender(program, SCRIPT, [str(source), str(target)], f"cannot write {path}", seconds)
        if not target.is_file():
            raise HopdiffError(f"cannot write {path}: Blender ({program}) made no FBX file.")
        write_whole(path, target.read_bytes())


def find_blender(blender: str | None = None) -> str:
    """The program to run: the setting, else what HOPDIFF_BLENDER names, else `blender` on PATH.

    It may be Blender, or a Python that has the module bpy. Raises HopdiffError, saying how to get one, where there is
    none.
    """
    wanted = blender or os.environ.get(VARIABLE)
    if wanted:
        found = shutil.which(os.path.expanduser(wanted))
        if found is None:
            source = "blender" if blender else VARIABLE
            raise HopdiffError(f"{source}={wanted}: there is no such program; {HOW}.")
        return found
    found = shutil.which("blender")
    if found is None:
        raise HopdiffError(f"FBX files are made by Blender, and none was found: {HOW}.")
    return found


def run_in_blender(program: str, script: Path, arguments: Sequence[str], purpose: str, seconds: float = SECONDS) -> str:
    """Run a script in Blender, or in a Python that has bpy, and return what it printed.

    purpose: how the sentence of an error begins. Raises HopdiffError if the program cannot be started, fails, or is
    not done after some seconds.
    """
    # Only Blender itself calls itself so; a Python that has bpy says Python.
    if _run([program, "--version"], purpose, min(seconds, ASK)).stdout.lstrip().startswith("Blender"):
        command = [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(script)]
        done = _run([*command, "--", *arguments], purpose, seconds)
    else:
        done = _run([program, str(script), *arguments], purpose, seconds)
    if done.returncode != 0:
        said = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        # Where bpy is missing, what to do about it says more than Python does.
        if any("No module named 'bpy'" in line for line in said):
            raise HopdiffError(f"{purpose}: {program} is neither Blender nor a Python with bpy; {HOW}.")
        reason = said[-1].rstrip(".") if said else f"it ended with {done.returncode}"
        raise HopdiffError(f"{purpose}: Blender ({program}) failed: {reason}.")
    return done.stdout


def _run(command: list[str], purpose: str, seconds: float) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in STRANGE}
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        raise HopdiffError(
            f"{purpose}: {command[0]} cannot be run: {(error.strerror or str(error)).lower()}."
        ) from error
    with process:
        try:
            said, complained = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired as error:
            raise HopdiffError(f"{purpose}: {command[0]} was not done after {seconds:g} s and was stopped.") from error
        finally:
            _stop(process)
    return subprocess.CompletedProcess(command, process.returncode, said, complained)


def _stop(process: subprocess.Popen[str]) -> None:
    """End a program that still runs, and what it started: Blender may be behind a script."""
    if process.poll() is not None:
        return
    if sys.platform == "win32":
        process.kill()
    else:
        os.killpg(process.pid, signal.SIGKILL)
