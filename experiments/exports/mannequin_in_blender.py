"""Pictures of bodies in GLB files. Run by Blender's own Python: mannequin_in_blender.py JOB

JOB is a JSON file with the size of the pictures in pixels and a list of them: the PNG file, the GLB file, the motion
and its time [s] or null for the rest pose, from where the body is seen (degrees to its left from straight ahead), and
how much of the height is in the picture [m].
"""

from __future__ import annotations

import json
import math
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

SAMPLES = 24
LENS, DISTANCE = 85.0, 7.0  # mm, m


def main(job_file: str) -> None:
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    file = None
    for shot in job["shots"]:
        if shot["file"] != file:
            file = shot["file"]
            scene, armature = opened(file, job["size"])
        pose(scene, armature, shot)
        render(scene, armature, shot)


def opened(file: str, size: list[int]) -> tuple[Any, Any]:
    """A file alone in a studio: a floor, a sun ahead and to the side, a bright sky."""
    bpy = import_module("bpy")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 60, 1.0
    bpy.ops.import_scene.gltf(filepath=file)
    armature = next(thing for thing in scene.objects if thing.type == "ARMATURE")
    bpy.ops.mesh.primitive_plane_add(size=60.0)
    # Of the floor only the shadows, so that no horizon is behind the figures.
    bpy.context.object.is_shadow_catcher = True
    scene.render.film_transparent = True
    scene.world = bpy.data.worlds.new("sky")
    scene.world.use_nodes = True
    sky = scene.world.node_tree.nodes["Background"].inputs
    sky["Color"].default_value, sky["Strength"].default_value = (0.9, 0.94, 1.0, 1.0), 0.6
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.use_denoising = "CPU", SAMPLES, True
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    return scene, armature


def pose(scene: Any, armature: Any, shot: dict[str, Any]) -> None:
    armature.data.pose_position = "REST" if shot["motion"] is None else "POSE"
    if shot["motion"] is None:
        scene.frame_set(0)
        return
    tracks = armature.animation_data.nla_tracks
    strips = {
        strip.action.name.split("_" + armature.name)[0]: strip.action for track in tracks for strip in track.strips
    }
    for track in tracks:
        track.mute = True
    action = strips.get(shot["motion"]) or next(iter(strips.values()), armature.animation_data.action)
    armature.animation_data.action = action
    armature.animation_data.action_slot = action.slots[0]
    frame = shot["time"] * scene.render.fps
    scene.frame_set(math.floor(frame + 1e-4), subframe=max(0.0, frame - math.floor(frame + 1e-4)))


def render(scene: Any, armature: Any, shot: dict[str, Any]) -> None:
    bpy, vector = import_module("bpy"), import_module("mathutils").Vector
    root = armature.matrix_world @ armature.pose.bones[0].head
    if shot["motion"] is None:
        root = vector((0.0, 0.0, 0.0))
    for thing in [thing for thing in scene.objects if thing.type in ("CAMERA", "LIGHT")]:
        bpy.data.objects.remove(thing)
    around = math.radians(shot["from"])
    # The body faces -y and has its left at +x.
    side = vector((math.sin(around), -math.cos(around), 0.0))
    target = vector((root.x, root.y, 0.44 * shot["high"]))
    place = target + DISTANCE * side + vector((0.0, 0.0, 0.9))
    turn = (target - place).to_track_quat("-Z", "Y").to_euler()
    bpy.ops.object.camera_add(location=place, rotation=turn)
    scene.camera = bpy.context.object
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.camera.data.sensor_height = LENS * shot["high"] / DISTANCE
    scene.camera.data.lens = LENS
    # From over the camera's left shoulder, so that the side that is seen is lit.
    bpy.ops.object.light_add(type="SUN", rotation=(math.radians(48.0), 0.0, around - math.radians(38.0)))
    bpy.context.object.data.energy, bpy.context.object.data.angle = 2.4, 0.15
    scene.render.filepath = shot["picture"]
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main(sys.argv[-1])
