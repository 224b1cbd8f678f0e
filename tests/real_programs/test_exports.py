"""Exports in the programs that they are made for: pytest -m real_programs

Blender is found as `find_blender` says (HOPDIFF_BLENDER), the Khronos validator in the node_modules folder that
HOPDIFF_GLTF_VALIDATOR names.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image

from hopdiff.export.fbx import find_blender
from hopdiff.types import HopdiffError

if TYPE_CHECKING:
    from experiments.exports.measure import Exported

pytestmark = pytest.mark.real_programs


@pytest.fixture(scope="module")
def blender() -> str:
    try:
        return find_blender()
    except HopdiffError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def validator() -> Path:
    from experiments.exports.validator import VARIABLE, modules

    folder = modules()
    if folder is None:
        pytest.skip(f"{VARIABLE} names no node_modules folder with gltf-validator, or there is no Node")
    return folder


@pytest.fixture(scope="module")
def files(from_the_checkout: None, tmp_path_factory: pytest.TempPathFactory) -> list[Exported]:
    """Two quick runs in every preset that needs no other program."""
    from experiments.exports.measure import export_all
    from experiments.exports.runs import own_runs, presets

    kinds = ("glb", "bvh")
    wanted = {name: settings for name, settings in presets().items() if settings.kind in kinds}
    return export_all(list(own_runs(200, path=False).values()), wanted, tmp_path_factory.mktemp("exports"))


def check(program: str, files: Sequence[Exported]) -> None:
    """Blender shows every joint where it is, up, as large, facing its front view, in as many frames, as fast."""
    from experiments.exports.measure import in_blender

    found = in_blender(program, files)
    assert len(found) == sum(len(file.takes) for file in files)
    for file, seen in found:
        about = f"{file.preset}: {seen}"
        assert seen.bones == seen.joints, about
        assert seen.keys == seen.frames, about
        assert seen.worst < 1e-3, about
        assert seen.origin < 1e-3, about
        assert abs(seen.size - 1.0) < 1e-4, about
        assert seen.tilt < 1e-3, about
        assert seen.facing < 1e-3, about
        assert abs(seen.duration - 1.0) < 1e-4, about


def test_blender_shows_every_preset_as_it_was_written(blender: str, files: list[Exported]) -> None:
    check(blender, files)


def test_blender_shows_what_it_made_of_them_as_fbx(blender: str, files: list[Exported], tmp_path: Path) -> None:
    from experiments.exports.measure import export_all
    from experiments.exports.runs import presets

    settings = presets()["fbx"]
    made = export_all(files[0].runs + files[1].runs, {"fbx": settings}, tmp_path)
    check(blender, made)
    # Contacts of each take are a property of the armature, which importers hand on.
    assert made[0].path.read_bytes().count(b"LeftDown") >= len(made[0].takes)


def test_blender_shows_usd_as_it_was_written(blender: str, files: list[Exported], tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is not installed")
    from experiments.exports.measure import export_all
    from experiments.exports.runs import presets

    check(blender, export_all(files[0].runs + files[1].runs, {"usd": presets()["usd"]}, tmp_path))


def test_blenders_picture_shows_a_body_that_stands_upright(blender: str, files: list[Exported], tmp_path: Path) -> None:
    from experiments.exports.blender import look

    file = next(file for file in files if file.preset == "glb")
    picture = tmp_path / "blender.png"
    look(blender, file.path, "glb", file.takes, file.runs, picture=(picture, 0.0, file.takes[0].name))
    pixels = np.asarray(Image.open(picture).convert("RGB"), dtype=int)
    red, blue = pixels[..., 0], pixels[..., 2]
    right, left = red - blue > 80, blue - red > 80
    assert right.mean() > 0.005
    assert left.mean() > 0.005
    # It faces us, so that its left is to the right; all colour is on limbs, which end above the picture's lower edge.
    rows, columns = np.nonzero(left)
    assert columns.mean() > np.nonzero(right)[1].mean()
    assert 0.15 * len(red) < rows.max() - rows.min() < 0.9 * len(red)
    # The sky is above and the floor below: the floor is greyer.
    assert (blue - red)[:20].mean() > (blue - red)[-20:].mean()


def test_the_khronos_validator_has_nothing_to_say(validator: Path, files: list[Exported], tmp_path: Path) -> None:
    from experiments.exports.validator import validate
    from hopdiff.export.glb import write_glb

    several = [file for file in files if file.settings.kind == "glb"]
    assert all(len(file.takes) > 1 for file in several)
    paths = [file.path for file in several]
    for file in several:
        paths.append(tmp_path / f"{file.preset}.glb")
        write_glb(paths[-1], file.takes[:1])
    for path in paths:
        report = validate(path, validator)
        assert (report.errors, report.warnings) == (0, 0), report
