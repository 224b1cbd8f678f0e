"""The Khronos glTF validator, run by Node."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from hopdiff.types import HopdiffError

VARIABLE = "HOPDIFF_GLTF_VALIDATOR"
ASK = """
const path = require('path'), fs = require('fs');
const validator = require(path.join(process.argv[1], 'gltf-validator'));
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])))
  .then(report => console.log(JSON.stringify(report)))
  .catch(error => { console.error(String(error)); process.exit(1); });
"""


@dataclass(frozen=True)
class Report:
    """Numbers of issues by severity, the first few messages, and the validator's version."""

    errors: int
    warnings: int
    infos: int
    hints: int
    messages: tuple[str, ...]
    version: str


def modules() -> Path | None:
    """The node_modules folder that HOPDIFF_GLTF_VALIDATOR names, if the validator is in it and there is a Node."""
    folder = os.environ.get(VARIABLE)
    if not folder or shutil.which("node") is None or not Path(folder, "gltf-validator").is_dir():
        return None
    return Path(folder)


def validate(file: Path, folder: Path) -> Report:
    """What the validator in a node_modules folder says of a GLB file. Raises HopdiffError if it does not run."""
    done = subprocess.run(
        ["node", "-e", ASK, str(folder.resolve()), str(file)], capture_output=True, text=True, timeout=120, check=False
    )
    if done.returncode != 0:
        raise HopdiffError(f"the glTF validator failed on {file.name}: {done.stderr.strip()[-300:]}")
    report = json.loads(done.stdout)
    issues = report["issues"]
    messages = [f"{one['code']} at {one.get('pointer', '')}: {one['message']}" for one in issues["messages"][:5]]
    errors, warnings, infos, hints = (issues[f"num{kind}"] for kind in ("Errors", "Warnings", "Infos", "Hints"))
    return Report(errors, warnings, infos, hints, tuple(messages), report["validatorVersion"])
