"""Universal Scene Description: a skinned body and its motion, metres, +y up, facing +z.

Pixar, OpenUSD: the schemas of UsdGeom, UsdSkel and UsdShade. The package usd-core, an extra, writes the files.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

try:
    from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdSkel, UsdUtils, Vt
except ImportError:
    Usd = None

from hopdiff import __version__
from hopdiff.export.body.loft import Surface, joined
from hopdiff.export.body_mesh import body_mesh
from hopdiff.export.colours import linear
from hopdiff.export.pose import root_height
from hopdiff.export.skinning import joint_matrices, skinned
from hopdiff.export.take import Take
from hopdiff.extras import install
from hopdiff.geometry.quaternion import quaternions
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.files import write_whole
from hopdiff.types import HopdiffError

Floats = NDArray[np.float64]

ENDINGS = (".usdc", ".usd", ".usda", ".usdz")  # binary, binary, text, an archive as Apple's programs want it
BODY = "/body"
STILL = 1e-9  # m by which joints may move against their parents and still be written once


def check_usd() -> None:
    """Raises HopdiffError, saying how to get it, if usd-core is not there."""
    if Usd is None:
        raise HopdiffError(f"USD files are written by usd-core, which the extra usd brings: {install('usd')}.")


def write_usd(path: Path, take: Take) -> None:
    """Write a take as a USD file, whole or not at all, in the form that its ending says; see ENDINGS.

    Time codes are the take's own frames from 0 on. The root joint carries the way of the body; joints without a name
    that USD allows get one that is like it, and keep their own in `jointNames`. Raises HopdiffError if usd-core is
    missing, the take has no frame or holds a number that is not finite, or the file cannot be written.
    """
    check_usd()
    tensors = (take.clip.root_position, take.clip.rotations, take.clip.skeleton.offsets)
    if take.frames == 0:
        raise HopdiffError(f"cannot write {take.name}: it has no frames.")
    if not all(bool(torch.isfinite(values).all()) for values in tensors):
        raise HopdiffError(f"cannot write {take.name}: the motion holds a number that is not finite.")
    stage = _stage(take)
    with tempfile.TemporaryDirectory(prefix="hopdiff_usd_") as folder:
        packed = path.suffix.lower() == ".usdz"
        target = Path(folder, "body.usdc" if packed else f"body{path.suffix.lower()}")
        done = stage.GetRootLayer().Export(str(target))
        if done and packed:
            inside, target = target, target.with_suffix(".usdz")
            done = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(inside)), str(target))
        if not done:
            raise HopdiffError(f"cannot write {path}: usd-core made no file.")
        write_whole(path, target.read_bytes())


def _stage(take: Take) -> Any:
    """The scene in memory."""
    stage, clip = Usd.Stage.CreateInMemory(), take.clip
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetTimeCodesPerSecond(1.0 / clip.frame_time)
    stage.SetFramesPerSecond(1.0 / clip.frame_time)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(take.frames - 1.0)
    travel = Gf.Vec3d(*(clip.root_position[-1] - clip.root_position[0]).tolist())
    told = {"motion": take.name, "loop": take.loop, "travel_m": travel, "duration_s": clip.duration}
    stage.GetRootLayer().customLayerData = {"creator": f"hopdiff {__version__}", **told}
    root = UsdSkel.Root.Define(stage, BODY)
    for name in ("motions", "materials"):
        UsdGeom.Scope.Define(stage, f"{BODY}/{name}")
    stage.SetDefaultPrim(root.GetPrim())
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    standing = clip.skeleton.offsets.clone()
    standing[0] = torch.tensor([0.0, root_height(clip.skeleton), 0.0])
    skeleton = _add_skeleton(stage, clip.skeleton, standing)
    _add_animation(stage, take, skeleton)
    surfaces = body_mesh(clip.skeleton, take.masses, take.parts)
    for side, surface in surfaces.items():
        _add_mesh(stage, side, surface, standing[0].numpy(), skeleton)
    if surfaces:
        _add_extent(root, take, joined(list(surfaces.values())))
    return stage


def _add_skeleton(stage: Any, own: Skeleton, standing: torch.Tensor) -> Any:
    skeleton = UsdSkel.Skeleton.Define(stage, f"{BODY}/skeleton")
    skeleton.CreateJointsAttr(_paths(own))
    skeleton.CreateJointNamesAttr(list(own.names))
    straight = torch.eye(3, dtype=torch.float64).expand(1, len(own.names), 3, 3)
    places = own.forward(standing[:1], straight)[0][0]
    # Joints are not turned in the rest pose.
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*place)) for place in places.tolist()])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1.0).SetTranslate(Gf.Vec3d(*one)) for one in standing.tolist()])
    return skeleton


def _paths(skeleton: Skeleton) -> list[str]:
    """Of the joints, each below its parent, with names that USD allows."""
    found: list[str] = []
    for name, parent in zip(skeleton.names, skeleton.parents, strict=True):
        plain = (f"{found[parent]}/" if parent >= 0 else "") + Tf.MakeValidIdentifier(name)
        count = sum(other == plain or other.startswith(f"{plain}__") for other in found)
        found.append(f"{plain}__{count + 1}" if count else plain)
    return found


def _add_animation(stage: Any, take: Take, skeleton: Any) -> None:
    clip = take.clip
    # Programs call the motion by the name of this.
    animation = UsdSkel.Animation.Define(stage, f"{BODY}/motions/{Tf.MakeValidIdentifier(take.name)}")
    animation.CreateJointsAttr(skeleton.GetJointsAttr().Get())
    offsets = clip.skeleton.offsets.expand(take.frames, -1, -1) if clip.offsets is None else clip.offsets
    places = torch.cat((clip.root_position.unsqueeze(1), offsets[:, 1:]), dim=1).numpy().astype(np.float32)
    turns = quaternions(clip.rotations).tolist()
    translations, rotations = animation.CreateTranslationsAttr(), animation.CreateRotationsAttr()
    still = bool((np.ptp(places, axis=0) < STILL).all())
    for frame in range(take.frames):
        if frame == 0 or not still:
            translations.Set(Vt.Vec3fArray.FromNumpy(places[frame]), float(frame))
        rotations.Set(Vt.QuatfArray([Gf.Quatf(w, x, y, z) for x, y, z, w in turns[frame]]), float(frame))
    animation.CreateScalesAttr(Vt.Vec3hArray(len(places[0]), Gf.Vec3h(1.0)))
    binding = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])


def _add_mesh(stage: Any, side: str, surface: Surface, root: Floats, skeleton: Any) -> None:
    mesh = UsdGeom.Mesh.Define(stage, f"{BODY}/{side}")
    points = (surface.vertices + root).astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr([3] * len(surface.faces))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(surface.faces.reshape(-1).astype(np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(surface.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    # Triangles as they are, not the cage of a smoother surface.
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get()))
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    width = surface.joints.shape[1]
    joints, weights = (values.reshape(-1) for values in (surface.joints, surface.weights))
    binding.CreateJointIndicesPrimvar(False, width).Set(Vt.IntArray.FromNumpy(joints.astype(np.int32)))
    binding.CreateJointWeightsPrimvar(False, width).Set(Vt.FloatArray.FromNumpy(weights.astype(np.float32)))
    colour = Gf.Vec3f(*linear(side).tolist())
    mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([colour])
    material = UsdShade.Material.Define(stage, f"{BODY}/materials/{side}")
    shader = UsdShade.Shader.Define(stage, f"{BODY}/materials/{side}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(colour)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.7)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def _add_extent(root: Any, take: Take, body: Surface) -> None:
    """The box around the moving body in every frame, by which programs know what they need not draw."""
    extent = root.CreateExtentAttr()
    for frame, matrices in enumerate(joint_matrices(take.clip)):
        points = skinned(body.vertices, body.joints, body.weights, matrices[None])[0]
        box = np.stack((points.min(axis=0), points.max(axis=0))).astype(np.float32)
        extent.Set(Vt.Vec3fArray.FromNumpy(box), float(frame))
