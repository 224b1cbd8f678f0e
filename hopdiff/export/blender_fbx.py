"""Turns a GLB file into an FBX file. Run by Blender's own Python, never imported: blender_fbx.py SOURCE TARGET

The FBX file is in centimetres and has y up in its own numbers: no object in it is scaled or turned, as game engines
and MotionBuilder like it best. It has one take for every animation, with keys at every frame.
"""

from __future__ import annotations

import json
import math
import struct
import sys
from importlib import import_module
from typing import Any

CENTIMETRES = 100.0  # in a metre
LONGEST_NAME = 63  # letters of a property in Blender


def main(source: str, target: str) -> None:
    """Read the GLB file SOURCE and write the FBX file TARGET."""
    bpy = import_module("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.import_scene.gltf(filepath=source)
    armatures = [thing for thing in scene.objects if thing.type == "ARMATURE"]
    meshes = [thing for thing in scene.objects if thing.type == "MESH" and thing.parent in armatures]
    if not armatures:
        raise SystemExit("the GLB file holds no skinned body")
    rates = retime(list(bpy.data.actions), duration(source))
    first = next(iter(rates.values()), 60.0)
    # Importers are at their best with whole frames a second; takes keep the times of their own frames.
    set_rate(scene, float(max(1, round(first))) if write_at_own_rates(rates) else first)
    scene.unit_settings.scale_length = 1.0 / CENTIMETRES
    upright(armatures, meshes)
    for armature in armatures:
        # Unreal takes the armature itself for a joint unless it has this name.
        armature.name = armature.data.name = "Armature"
        lay_out(armature)
    for name, events in told(source).items():
        # Exporters of FBX have no place for what is known of a take; what is known of an object they keep.
        armatures[0][name[:LONGEST_NAME]] = events
    for mesh in meshes:
        mesh.name = mesh.data.name
    bpy.ops.object.select_all(action="DESELECT")
    for thing in (*armatures, *meshes):
        thing.select_set(True)
    bpy.ops.export_scene.fbx(
        filepath=target,
        use_selection=True,
        object_types={"ARMATURE", "MESH"},
        apply_unit_scale=True,
        apply_scale_options="FBX_SCALE_NONE",
        axis_forward="-Z",
        axis_up="Y",
        mesh_smooth_type="FACE",
        use_custom_props=True,
        add_leaf_bones=False,
        bake_anim=True,
        bake_anim_use_all_bones=True,
        bake_anim_use_nla_strips=True,
        bake_anim_use_all_actions=False,
        bake_anim_force_startend_keying=True,
        bake_anim_step=1.0,
        bake_anim_simplify_factor=0.0,
    )


def duration(source: str) -> float:
    """Seconds of the longest animation of a GLB file."""
    content = content_of(source)
    samplers = [sampler for animation in content.get("animations", ()) for sampler in animation["samplers"]]
    return max((content["accessors"][sampler["input"]]["max"][0] for sampler in samplers), default=0.0)


def content_of(source: str) -> dict[str, Any]:
    """What a GLB file says of itself."""
    with open(source, "rb") as file:
        size = struct.unpack("<12xI4x", file.read(20))[0]
        found: dict[str, Any] = json.loads(file.read(size))
    return found


def told(source: str) -> dict[str, str]:
    """Contacts of every animation of a GLB file as JSON, by its name; Blender leaves them out."""
    extras = {animation["name"]: animation.get("extras", {}) for animation in content_of(source).get("animations", ())}
    return {name: json.dumps(known["events"]) for name, known in extras.items() if known.get("events")}


def curves(action: Any) -> list[Any]:
    """All curves of an action, in Blender before and after its actions got layers."""
    if not hasattr(action, "layers"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags for curve in bag.fcurves]


def retime(actions: list[Any], seconds: float) -> dict[str, float]:
    """Put the keys of every action on whole frames of its own, from 0; returns frames a second by action.

    seconds: that the longest takes, which tells what the importer took a second for. Locations become centimetres on
    the way.
    """
    found = {action.name: [(curve, keys_of(curve)) for curve in curves(action)] for action in actions}
    last = {name: max((keys[-2] for _, keys in own), default=0.0) for name, own in found.items()}
    rates = {}
    for name, own in found.items():
        frames = max((len(keys) // 2 - 1 for _, keys in own), default=0)
        for curve, keys in own:
            scale = CENTIMETRES if curve.data_path.endswith("location") else 1.0
            for k in range(0, len(keys), 2):
                keys[k] = float(round(keys[k] / last[name] * frames)) if last[name] > 0.0 else 0.0
                keys[k + 1] *= scale
            curve.keyframe_points.foreach_set("co", keys)
            for key in curve.keyframe_points:
                key.interpolation = "LINEAR"
            curve.update()
        if frames > 0 and last[name] > 0.0:
            rate = frames / (seconds * last[name] / max(last.values()))
            # Times in the file are single precision.
            rates[name] = float(round(rate)) if abs(rate - round(rate)) < 1e-5 * rate else rate
    return rates


def set_rate(scene: Any, rate: float) -> None:
    """Frames a second, which Blender has as a whole number and what it is divided by."""
    scene.render.fps = max(1, round(rate))
    scene.render.fps_base = scene.render.fps / rate


def write_at_own_rates(rates: dict[str, float]) -> bool:
    """Have Blender's exporter write every take with the times of its own frames, and not with those of the scene's.

    There is no such option; returns whether the exporter is as we know it. Where it is not, takes that differ in their
    rate from the first play at its rate.
    """
    try:
        exporter: Any = import_module("io_scene_fbx.export_fbx_bin")
        plain = exporter.fbx_animations_do
    except (ImportError, AttributeError):
        return False

    def timed(scene_data: Any, strip: Any, *rest: Any, **options: Any) -> Any:
        scene = scene_data.scene
        common = scene.render.fps / scene.render.fps_base
        own = rates.get(getattr(strip, "name", ""), common)
        set_rate(scene, own)
        found = plain(scene_data, strip, *rest, **options)
        set_rate(scene, common)
        # Its start and end are turned into times later, at the common rate.
        return found and (*found[:4], *(frame * common / own for frame in found[4:6]))

    exporter.fbx_animations_do = timed
    return True


def keys_of(curve: Any) -> list[float]:
    """Frame and value of every key, one after the other."""
    keys = [0.0] * (2 * len(curve.keyframe_points))
    curve.keyframe_points.foreach_get("co", keys)
    return keys


def upright(armatures: list[Any], meshes: list[Any]) -> None:
    """Bodies in centimetres with y up in their own numbers; their objects stand them up in Blender's world."""
    matrix = import_module("mathutils").Matrix
    lie = matrix.Rotation(-math.pi / 2.0, 4, "X") @ matrix.Scale(CENTIMETRES, 4)
    for armature in armatures:
        armature.data.transform(lie @ armature.matrix_world)
    for mesh in meshes:
        mesh.data.transform(lie @ mesh.matrix_world)
    for armature in armatures:
        armature.matrix_world = matrix.Rotation(math.pi / 2.0, 4, "X")
    for mesh in meshes:
        mesh.matrix_parent_inverse = matrix.Identity(4)
        mesh.matrix_basis = matrix.Identity(4)


def lay_out(armature: Any) -> None:
    """A track of its own for every action of an armature, none of them mute: each becomes a take of its name."""
    data = armature.animation_data
    if data is None:
        return
    strips = [strip for track in data.nla_tracks for strip in track.strips]
    wanted = [(strip.action, getattr(strip, "action_slot", None)) for strip in strips]
    data.action = None
    for track in list(data.nla_tracks):
        data.nla_tracks.remove(track)
    for action, slot in wanted:
        track = data.nla_tracks.new()
        track.name = action.name
        strip = track.strips.new(action.name, 0, action)
        if slot is not None:
            strip.action_slot = slot
        strip.action_frame_start, strip.action_frame_end = action.frame_range


if __name__ == "__main__":
    # Blender passes its own arguments, too; ours follow two dashes.
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(*given)
