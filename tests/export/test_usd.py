from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import hopdiff.export.usd
from hopdiff.export.body.loft import Surface
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.full_body import full_body
from hopdiff.export.prepare import prepared, with_ground_root
from hopdiff.export.settings import ExportSettings
from hopdiff.export.take import Take
from hopdiff.export.usd import ENDINGS, write_usd
from hopdiff.export.write import write_exports
from hopdiff.types import HopdiffError
from tests.export.takes import own, walked
from tests.export.test_write import preset

pytest.importorskip("pxr", reason="usd-core is not installed")

from pxr import Usd, UsdGeom, UsdShade, UsdSkel

SIDES = ("left", "right", "middle")


class Scene:
    """A file as OpenUSD's own queries see it."""

    def __init__(self, path: Path) -> None:
        self.stage = Usd.Stage.Open(str(path))
        self.root = UsdSkel.Root(self.stage.GetDefaultPrim())
        self.cache = UsdSkel.Cache()
        assert self.cache.Populate(self.root, Usd.PrimDefaultPredicate)
        [binding] = self.cache.ComputeSkelBindings(self.root, Usd.PrimDefaultPredicate)
        self.skeleton = self.cache.GetSkelQuery(binding.GetSkeleton())
        self.skins = {one.GetPrim().GetName(): one for one in binding.GetSkinningTargets()}

    def joints(self, frame: float) -> tuple[NDArray[Any], NDArray[Any]]:
        """Places (J, 3) [m] and turns (J, 3, 3) in the world."""
        found = np.array(self.skeleton.ComputeJointWorldTransforms(UsdGeom.XformCache(frame)))
        # Its vectors are rows.
        return found[:, 3, :3], found[:, :3, :3].transpose(0, 2, 1)

    def points(self, mesh: str, frame: float) -> NDArray[Any]:
        """Vertices (V, 3) [m]."""
        skin = self.skins[mesh]
        points = UsdGeom.Mesh(skin.GetPrim()).GetPointsAttr().Get()
        assert skin.ComputeSkinnedPoints(self.skeleton.ComputeSkinningTransforms(frame), points, frame)
        return np.array(points)


def stretched(take: Take) -> Take:
    swing = 0.05 * torch.sin(torch.arange(take.frames).double())[:, None, None]
    return replace(take, clip=replace(take.clip, offsets=take.clip.skeleton.offsets * (1.0 + swing)))


TAKES = {
    "eleven": own,
    "full": lambda: full_body(own()),
    "t": lambda: prepared(own(), ExportSettings("usd", rest="t")),
    "ground": lambda: with_ground_root(full_body(own()), "root"),
    "moving": lambda: stretched(own()),
    "mixamo": lambda: prepared(own(), ExportSettings("usd", names="mixamo")),
    "walk": walked,
}


@pytest.mark.parametrize("which", TAKES)
def test_joints_are_where_they_are(which: str, tmp_path: Path) -> None:
    take = TAKES[which]()
    write_usd(tmp_path / "a.usdc", take)
    scene = Scene(tmp_path / "a.usdc")
    names = take.clip.skeleton.names
    assert list(UsdSkel.Skeleton(scene.skeleton.GetPrim()).GetJointNamesAttr().Get()) == list(names)
    topology = scene.skeleton.GetTopology()
    assert tuple(topology.GetParent(joint) for joint in range(len(names))) == take.clip.skeleton.parents
    places, turns = (values.numpy() for values in take.clip.forward())
    for frame in {0, take.frames // 3, take.frames - 1}:
        theirs, turned = scene.joints(frame)
        np.testing.assert_allclose(theirs, places[frame], atol=2e-5)
        apart = Rotation.from_matrix(turned.reshape(-1, 3, 3)).inv() * Rotation.from_matrix(turns[frame])
        assert float(apart.magnitude().max()) < 1e-4


def moved(surface: Surface, take: Take, frame: int) -> NDArray[np.float64]:
    """Vertices as joints take them along, one joint after the other: by kinematics alone."""
    skeleton = take.clip.skeleton
    rest = np.zeros((len(skeleton.names), 3))
    for joint, parent in enumerate(skeleton.parents[1:], start=1):
        rest[joint] = rest[parent] + skeleton.offsets[joint].numpy()
    places, turns = (values[frame].numpy() for values in take.clip.forward())
    found = np.zeros_like(surface.vertices)
    for joint in range(len(rest)):
        share = np.where(surface.joints == joint, surface.weights, 0.0).sum(axis=-1)
        found += share[:, None] * (places[joint] + (surface.vertices - rest[joint]) @ turns[joint].T)
    return found


@pytest.mark.parametrize("which", ["t", "ground", "moving", "walk"])
def test_the_skin_follows_them(which: str, tmp_path: Path) -> None:
    take = TAKES[which]()
    write_usd(tmp_path / "a.usdc", take)
    scene, surfaces = Scene(tmp_path / "a.usdc"), body_mesh(take.clip.skeleton, take.masses)
    assert set(scene.skins) == set(surfaces)
    for frame in {0, take.frames // 2, take.frames - 1}:
        whole = []
        for side, surface in surfaces.items():
            found = scene.points(side, frame)
            np.testing.assert_allclose(found, moved(surface, take, frame), atol=5e-5)
            whole.append(found)
        box = np.array(scene.root.GetExtentAttr().Get(frame))
        corners = np.concatenate(whole)
        np.testing.assert_allclose(box, [corners.min(axis=0), corners.max(axis=0)], atol=5e-5)


def test_programs_are_told_units_axes_times_and_loop(tmp_path: Path) -> None:
    take = full_body(own())
    write_usd(tmp_path / "a.usdc", take)
    stage = Scene(tmp_path / "a.usdc").stage
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetTimeCodesPerSecond() == pytest.approx(1.0 / take.clip.frame_time)
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, take.frames - 1.0)
    told = stage.GetRootLayer().customLayerData
    assert told["loop"] is True
    assert told["travel_m"][2] == pytest.approx(3.0 * take.clip.duration, rel=1e-3)
    [animation] = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Animation)]
    assert animation.GetName() == "run"
    samples = UsdSkel.Animation(animation).GetRotationsAttr().GetTimeSamples()
    assert samples == [float(frame) for frame in range(take.frames)]


def test_bodies_stand_in_the_rest_pose_and_have_their_colours(tmp_path: Path) -> None:
    write_usd(tmp_path / "a.usdc", full_body(own()))
    scene = Scene(tmp_path / "a.usdc")
    points = np.concatenate(
        [np.array(UsdGeom.Mesh(one.GetPrim()).GetPointsAttr().Get()) for one in scene.skins.values()]
    )
    assert points[:, 1].min() == pytest.approx(0.0, abs=0.01)
    assert points[:, 1].max() == pytest.approx(1.75, abs=0.03)
    colours = {}
    for side in SIDES:
        mesh = scene.skins[side].GetPrim()
        assert UsdGeom.Mesh(mesh).GetSubdivisionSchemeAttr().Get() == "none"
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        shader, _, _ = material.ComputeSurfaceSource()
        colours[side] = shader.GetInput("diffuseColor").Get()
        assert list(colours[side]) == list(UsdGeom.Mesh(mesh).GetDisplayColorAttr().Get()[0])
    assert colours["left"][2] > colours["left"][0] + 0.2
    assert colours["right"][0] > colours["right"][2] + 0.2


@pytest.mark.parametrize("which", ["t", "mixamo", "moving"])
def test_openusd_has_nothing_to_say(which: str, tmp_path: Path) -> None:
    validation = pytest.importorskip("pxr.UsdValidation", reason="this usd-core has no validators")
    write_usd(tmp_path / "a.usdc", TAKES[which]())
    registry = validation.ValidationRegistry()
    context = validation.ValidationContext(registry.GetOrLoadAllValidators())
    said = [one.GetMessage() for one in context.Validate(Usd.Stage.Open(str(tmp_path / "a.usdc")))]
    assert not said
    # It would say so.
    broken = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    broken.ClearDefaultPrim()
    assert context.Validate(broken)


@pytest.mark.parametrize("ending", ENDINGS)
def test_endings(ending: str, tmp_path: Path) -> None:
    settings = preset("usd", f"file=hero{ending}")
    [(path, _)] = write_exports([own()], {"usd": settings}, tmp_path)
    assert path == tmp_path / f"hero{ending}"
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    begins = {".usda": b"#usda 1.0", ".usdz": b"PK\x03\x04"}.get(ending, b"PXR-USDC")
    assert path.read_bytes().startswith(begins)
    assert len(Scene(path).joints(0.0)[0]) == 22


def test_a_name_without_an_ending_gets_one(tmp_path: Path) -> None:
    settings = preset("usd", "file=hero")
    paths = [path.name for path, _ in write_exports([own(), walked()], {"usd": settings}, tmp_path)]
    assert paths == ["hero_run.usdc", "hero_walk.usdc"]


def test_names_that_usd_does_not_allow(tmp_path: Path) -> None:
    clip = own().clip
    names = [f"{name} 1" for name in clip.skeleton.names]
    # Both are children of the pelvis, and would be called the same.
    left, right = clip.skeleton.index("left_hip"), clip.skeleton.index("right_hip")
    names[left], names[right] = "hip.a", "hip:a"
    ends = {names[clip.skeleton.index(name)]: end for name, end in clip.skeleton.end_sites.items()}
    skeleton = replace(clip.skeleton, names=tuple(names), end_sites=ends)
    take = replace(own(), name="7 m/s (a)", clip=replace(clip, skeleton=skeleton))
    write_usd(tmp_path / "a.usdc", take)
    scene = Scene(tmp_path / "a.usdc")
    paths = list(scene.skeleton.GetJointOrder())
    assert len(set(paths)) == len(names)
    np.testing.assert_allclose(scene.joints(3.0)[0], clip.joint_positions()[3].numpy(), atol=2e-5)


def test_what_makes_no_file_leaves_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    take = own()
    empty = replace(take, clip=replace(take.clip, root_position=take.clip.root_position[:0]))
    broken = take.clip.root_position.clone()
    broken[3, 1] = torch.nan
    lost = replace(take, clip=replace(take.clip, root_position=broken))
    for message, one in {"it has no frames": empty, "not finite": lost}.items():
        with pytest.raises(HopdiffError, match=message):
            write_usd(tmp_path / "a.usdc", one)
    with pytest.raises(HopdiffError, match="cannot write"):
        write_usd(tmp_path / "nowhere" / "a.usdc", take)
    monkeypatch.setattr(hopdiff.export.usd, "Usd", None)
    with pytest.raises(HopdiffError, match=r"USD files are written by usd-core.*pip install .*\[usd\]"):
        preset("usd")
    assert not list(tmp_path.iterdir())


def test_one_frame_is_a_pose(tmp_path: Path) -> None:
    take = full_body(own())
    clip = replace(take.clip, root_position=take.clip.root_position[:1], rotations=take.clip.rotations[:1])
    write_usd(tmp_path / "a.usdc", replace(take, clip=clip))
    np.testing.assert_allclose(Scene(tmp_path / "a.usdc").joints(0.0)[0], clip.joint_positions()[0], atol=2e-5)
