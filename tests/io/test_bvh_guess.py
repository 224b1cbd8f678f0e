"""Unit and up axis of bodies as they come: any axis up, any unit, any rest pose, whatever they do."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.io.bvh import read_bvh, write_bvh
from hopdiff.io.bvh_guess import UNITS
from tests.people import clip_of


def grown(clip: Clip, factor: float) -> Clip:
    skeleton = clip.skeleton
    ends = {name: factor * end for name, end in skeleton.end_sites.items()}
    return replace(
        clip,
        skeleton=replace(skeleton, offsets=factor * skeleton.offsets, end_sites=ends),
        root_position=factor * clip.root_position,
    )


def turned(clip: Clip, axis: str, degrees: float) -> Clip:
    """The whole motion turned, and put on the ground again."""
    turn = axis_rotation(axis, torch.tensor(math.radians(degrees), dtype=torch.float64))
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    return grounded(replace(clip, rotations=rotations, root_position=clip.root_position @ turn.T))


def grounded(clip: Clip) -> Clip:
    root = clip.root_position.clone()
    root[:, 1] -= clip.joint_positions()[..., 1].amin() - 0.05
    return replace(clip, root_position=root)


def bent(clip: Clip, hip: float, knee: float) -> Clip:
    """The same with hips and knees bent [degrees]."""
    rotations = clip.rotations.clone()
    for side in ("Left", "Right"):
        for name, angle in ((f"{side}UpLeg", -hip), (f"{side}Leg", knee)):
            turn = axis_rotation("X", torch.tensor(math.radians(angle), dtype=torch.float64))
            rotations[:, clip.skeleton.index(name)] = turn
    return grounded(replace(clip, rotations=rotations))


def heap(clip: Clip, seed: int = 3) -> Clip:
    """The same motion of joints with frames of their own, so that the rest pose is a heap of bones."""
    count = len(clip.skeleton.names)
    frames = torch.from_numpy(Rotation.random(count, random_state=seed).as_matrix())
    parents = torch.tensor([max(parent, 0) for parent in clip.skeleton.parents])
    above = torch.cat((torch.eye(3, dtype=torch.float64)[None], frames[parents[1:]]))
    skeleton = clip.skeleton
    offsets = (above.transpose(-1, -2) @ skeleton.offsets[..., None])[..., 0]
    ends = {name: frames[skeleton.index(name)].T @ end for name, end in skeleton.end_sites.items()}
    rotations = above.transpose(-1, -2) @ clip.rotations @ frames
    return replace(clip, skeleton=replace(skeleton, offsets=offsets, end_sites=ends), rotations=rotations)


def sunk(clip: Clip) -> Clip:
    return replace(clip, root_position=clip.root_position - torch.tensor([0.0, 0.9, 0.0]))


def starts_in_rest(clip: Clip) -> Clip:
    """The first frame has all angles zero."""
    rotations = clip.rotations.clone()
    rotations[0] = torch.eye(3, dtype=torch.float64)
    return replace(clip, rotations=rotations)


def on_the_spot(clip: Clip) -> Clip:
    return replace(clip, root_position=clip.root_position * torch.tensor([0.0, 1.0, 0.0]))


def stretched(clip: Clip) -> Clip:
    """On the spot, breathing."""
    rotations = torch.eye(3, dtype=torch.float64).repeat(*clip.rotations.shape[:2], 1, 1)
    breath = 0.05 * torch.sin(torch.arange(clip.frames, dtype=torch.float64))
    rotations[:, clip.skeleton.index("Spine1")] = axis_rotation("X", breath)
    return on_the_spot(replace(clip, rotations=rotations))


def nameless(clip: Clip) -> Clip:
    names = tuple(f"b{k:02d}" for k in range(len(clip.skeleton.names)))
    new = dict(zip(clip.skeleton.names, names, strict=True))
    ends = {new[name]: end for name, end in clip.skeleton.end_sites.items()}
    return replace(clip, skeleton=replace(clip.skeleton, names=names, end_sites=ends))


BODIES: dict[str, Callable[[Clip], Clip]] = {
    "a walk": lambda clip: clip,
    "a tall walker": lambda clip: grown(clip, 1.15),
    "a short walker": lambda clip: grown(clip, 0.85),
    "a child": lambda clip: grown(clip, 0.66),
    "who lies on the back": lambda clip: turned(stretched(clip), "X", -90.0),
    "who lies on the side": lambda clip: turned(stretched(clip), "Z", 90.0),
    "who sits": lambda clip: bent(clip, 90.0, 90.0),
    "who crouches": lambda clip: bent(clip, 110.0, 140.0),
    "a heap at rest": heap,
    "a heap at rest, off the ground": lambda clip: heap(sunk(clip), 1),
    "another heap, off the ground": lambda clip: heap(sunk(clip), 2),
    "a third heap, off the ground": lambda clip: heap(sunk(clip), 3),
    "a child with a heap at rest": lambda clip: heap(grown(clip, 0.66)),
    "who sits with a heap at rest": lambda clip: heap(bent(clip, 90.0, 90.0)),
    "a first frame at rest": starts_in_rest,
    "who lies with a heap at rest": lambda clip: heap(turned(stretched(clip), "X", 90.0)),
    "without names": nameless,
    "on the spot": on_the_spot,
}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("body", BODIES)
def test_bodies_are_as_tall_as_they_are_and_stand_as_they_do(tmp_path: Path, body: str, up: str, unit: str) -> None:
    clip = BODIES[body](clip_of("walk"))
    write_bvh(tmp_path / "a.bvh", clip, order="ZYX", unit=1.0 / UNITS[unit], up=up)
    file = read_bvh(tmp_path / "a.bvh")
    assert (file.up, file.unit) == (up, UNITS[unit])


def tipped(clip: Clip, turn: Tensor) -> Clip:
    """The same file numbers in a world of other axes, as programs make them that turn the root alone."""
    rotations = clip.rotations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    return replace(clip, rotations=rotations, root_position=clip.root_position @ turn.T)


@pytest.mark.parametrize("stays", [False, True])
@pytest.mark.parametrize("unit", ["m", "cm", "inch"])
@pytest.mark.parametrize("rest", ["y", "z"])
def test_roots_that_raise_a_body_decide(tmp_path: Path, rest: str, unit: str, stays: bool) -> None:
    """Rest poses along y whose root stands them along z, and the other way round."""
    clip = clip_of("walk")
    if stays:
        clip = on_the_spot(clip)
    sign = 1.0 if rest == "y" else -1.0
    raised = tipped(clip, axis_rotation("X", torch.tensor(sign * math.pi / 2, dtype=torch.float64)))
    write_bvh(tmp_path / "a.bvh", raised, order="ZYX", unit=1.0 / UNITS[unit], up=rest)
    file = read_bvh(tmp_path / "a.bvh")
    assert (file.up, file.unit) == ("z" if rest == "y" else "y", UNITS[unit])
    places = file.clip().joint_positions()
    names = file.clip().skeleton.names
    assert bool((places[:, names.index("Head"), 1] > 1.3).all())
    assert np.abs(places[..., 1].amin(dim=1).numpy()).max() < 0.2
