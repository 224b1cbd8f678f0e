"""Opens an exported file in Blender and tells what is there. Run by Blender's own Python: in_blender.py JOB ANSWER

JOB and ANSWER are JSON files. A job names the file, its kind (glb, bvh, fbx or usd), options of the importer, the
scene's frame rate before, and by animation the times [s] at which bones are looked up; with "picture" also a PNG file
to be rendered, and its time and motion. The answer has, for every animation, heads of bones in Blender's world, how
many keys there are, and how long it plays.
"""

from __future__ import annotations

import json
import math
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def main(job_file: str, answer_file: str) -> None:
    """Do the job and write the answer."""
    bpy = import_module("bpy")
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = job["fps"], job.get("fps_base", 1.0)
    importers = {
        "glb": bpy.ops.import_scene.gltf,
        "bvh": bpy.ops.import_anim.bvh,
        "fbx": bpy.ops.import_scene.fbx,
        "usd": bpy.ops.wm.usd_import,
    }
    importers[job["kind"]](filepath=job["file"], **job["options"])
    rate = scene.render.fps / scene.render.fps_base
    armatures = [thing for thing in scene.objects if thing.type == "ARMATURE"]
    # Blender's importers count frames, those of glTF and FBX at this many a second.
    counted = rate if job["kind"] in ("bvh", "usd") else float(scene.render.fps)
    found = []
    for armature in armatures:
        for action, slot in animations(armature):
            play(armature, action, slot)
            frames = [float(frame) for frame in key_frames(action, slot)]
            name = action.name.split("|")[-1]
            # A BVH file has no name of its motion.
            times = job["times"].get(name) or next(iter(job["times"].values()))
            looked_up = [frames[0] + time * counted for time in times]
            found.append(
                {
                    "name": name,
                    "armature": armature.name,
                    "bones": [bone.name for bone in armature.pose.bones],
                    "keys": len(frames),
                    "duration": (frames[-1] - frames[0]) / rate,
                    "heads": [heads(scene, armature, frame) for frame in looked_up],
                    "height": tallest(scene, armature, frames[0]),
                }
            )
    if "picture" in job:
        armature, chosen = armatures[0], job["picture_name"]
        play(armature, *next(one for one in animations(armature) if one[0].name.split("|")[-1] == chosen))
        render(scene, armature, job)
    answer = {"blender": bpy.app.version_string, "fps": rate, "animations": found}
    answer["scales"] = [list(armature.matrix_world.to_scale()) for armature in armatures]
    Path(answer_file).write_text(json.dumps(answer), encoding="utf-8")


def animations(armature: Any) -> list[tuple[Any, Any]]:
    """Actions of an armature and their slots, whether they are active or laid down in tracks."""
    data = armature.animation_data
    strips = [strip for track in data.nla_tracks for strip in track.strips]
    found = {strip.action.name: (strip.action, strip.action_slot) for strip in strips}
    if data.action is not None:
        found.setdefault(data.action.name, (data.action, data.action_slot))
    # The FBX importer leaves all takes but the first without a user.
    for action in import_module("bpy").data.actions:
        if action.name.startswith(f"{armature.name}|"):
            found.setdefault(action.name, (action, action.slots[0]))
    return list(found.values())


def play(armature: Any, action: Any, slot: Any) -> None:
    """Make one action the only one that moves an armature."""
    for track in armature.animation_data.nla_tracks:
        track.mute = True
    armature.animation_data.action = action
    armature.animation_data.action_slot = slot


def key_frames(action: Any, slot: Any) -> list[float]:
    """When the curve with the most keys has them."""
    bags = [strip.channelbag(slot) for layer in action.layers for strip in layer.strips]
    curves = [curve for bag in bags if bag is not None for curve in bag.fcurves]
    longest = max(curves, key=lambda curve: len(curve.keyframe_points))
    return [point.co[0] for point in longest.keyframe_points]


def heads(scene: Any, armature: Any, frame: float) -> list[list[float]]:
    """Where bones begin, in the world."""
    whole = math.floor(frame + 1e-4)
    scene.frame_set(whole, subframe=max(0.0, frame - whole))
    return [list(armature.matrix_world @ bone.head) for bone in armature.pose.bones]


def tallest(scene: Any, armature: Any, frame: float) -> list[float]:
    """Lowest and highest point of the meshes of an armature, in the world."""
    bpy, vector = import_module("bpy"), import_module("mathutils").Vector
    scene.frame_set(round(frame))
    graph = bpy.context.evaluated_depsgraph_get()
    bodies = [
        thing.evaluated_get(graph) for thing in scene.objects if thing.type == "MESH" and thing.parent == armature
    ]
    corners = [(body.matrix_world @ vector(corner)).z for body in bodies for corner in body.bound_box]
    return [min(corners), max(corners)] if corners else []


def render(scene: Any, armature: Any, job: dict[str, Any]) -> None:
    """A picture of the body at a time, from three quarters ahead, on a floor in the sun."""
    bpy, vector = import_module("bpy"), import_module("mathutils").Vector
    heads(scene, armature, job["picture_time"] * scene.render.fps)
    middle = sum((armature.matrix_world @ bone.head for bone in armature.pose.bones), vector()) / len(
        armature.pose.bones
    )
    bpy.ops.mesh.primitive_plane_add(size=60.0, location=(middle.x, middle.y, 0.0))
    grey = bpy.data.materials.new("floor")
    grey.use_nodes = True
    grey.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.55, 0.56, 0.58, 1.0)
    bpy.context.object.data.materials.append(grey)
    bpy.ops.object.light_add(type="SUN", rotation=(math.radians(40.0), math.radians(15.0), math.radians(35.0)))
    bpy.context.object.data.energy = 3.0
    bpy.context.object.data.angle = 0.1
    target = vector((middle.x, middle.y, 0.9))
    # The body faces -y: from its left and ahead, as tall as its shoulders.
    place = target + vector((2.2, -3.0, 0.5))
    bpy.ops.object.camera_add(location=place, rotation=(target - place).to_track_quat("-Z", "Y").to_euler())
    scene.camera = bpy.context.object
    scene.camera.data.lens = 60.0
    world = scene.world or bpy.data.worlds.new("sky")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.8, 0.87, 1.0, 1.0)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.6
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", 32
    scene.cycles.use_denoising = True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 480, 480
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.filepath = job["picture"]
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    main(*given)
