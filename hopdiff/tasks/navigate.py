# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""task=navigate: a walk through a scene, put together from clips and edited to start and end exactly."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdiff.doors import config_folder
from hopdiff.editing.measure import path_measures
from hopdiff.export.tables import write_npz
from hopdiff.export.take import Take
from hopdiff.feet.contacts import slide_numbers
from hopdiff.feet.quality import quality_of, standing_numbers
from hopdiff.graph.body import deepest
from hopdiff.graph.graph import build_graph
from hopdiff.graph.scene import Place, Scene
from hopdiff.graph.scene_file import read_scene
from hopdiff.graph.settings import WaySettings
from hopdiff.graph.space import FreeSpace
from hopdiff.graph.way import Way, find_way
from hopdiff.grounds import build_ground
from hopdiff.io.bvh import read_bvh
from hopdiff.io.events import write_events
from hopdiff.io.record import write_json
from hopdiff.io.run_folder import Note, RunFolder
from hopdiff.joins.files import together
from hopdiff.messages import say, typed_names, unknown
from hopdiff.plots.rooms import rooms_figure
from hopdiff.plots.sticks import sticks_figure
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.edit_join import read_neighbours, seam_rows
from hopdiff.tasks.navigate_join import asked, inside_said, joined_way, own_frames
from hopdiff.tasks.results import shown, write_pictures
from hopdiff.terrain.ground import Ground
from hopdiff.types import HopdiffError


@dataclass
class GraphSettings:
    """threshold: largest distance of a transition, root mean square over joints [m]. window: compared frames [s]."""

    threshold: float
    window: float


@dataclass
class NavigateTask:
    """clips: BVH files of one skeleton. before, after: files of it that the walk goes on from and leads to, in place of
    start and goal. scene: a name or a YAML file. start, goal: a place of the scene by name, or [x, z, heading in
    degrees]. way, graph: how the way is looked for, and among which motions. ground: what feet stand
    on, see `hopdiff.grounds`."""

    clips: list[str]
    before: str | None
    after: str | None
    scene: str
    start: Any
    goal: Any
    way: WaySettings
    graph: GraphSettings
    ground: dict[str, Any]


def scene_file(name: str, scenes: Path) -> Path:
    """The file of a scene: one of the project's by its name, or the user's own. Raises HopdiffError for neither."""
    if Path(name).suffix in (".yaml", ".yml"):
        return Path(name)
    known = sorted(file.stem for file in scenes.glob("*.yaml"))
    if name not in known:
        raise HopdiffError(f"{unknown('scene', name, known)} One of your own is a file: scene=FILE.yaml.")
    return scenes / f"{name}.yaml"


def build(call: Call) -> Work:
    """Find a walk.

    Raises HopdiffError, naming file, setting or place, for whatever cannot be read, and if there is no way, saying why
    and how near the search came.
    """
    own: NavigateTask = call.own
    if not own.clips:
        raise HopdiffError("task=navigate needs clips=[FILE,...], BVH files of one skeleton to walk with.")
    own.way.check()
    scene = read_scene(scene_file(own.scene, config_folder() / "scenes"))
    ground = ground_of(call, scene)
    start, goal = (
        Place((0.0, 0.0), 0.0) if given is not None else place_of(what, one, scene)
        for what, one, given in (("start", own.start, own.before), ("goal", own.goal, own.after))
    )
    files = [read_bvh(name) for name in own.clips]
    begun = time.perf_counter()
    graph = build_graph([file.clip() for file in files], own.graph.threshold, own.graph.window)
    built = time.perf_counter() - begun
    neighbours = read_neighbours(own.before, own.after, files[0], Path(own.clips[0]).name)
    settings, ends_in = own.way, None
    if neighbours is not None:
        told = asked(graph, neighbours, start, goal, settings, ground)
        start, goal, settings, ends_in = told.start, told.goal, told.settings, told.ends_in
    found = find_way(graph, scene, start, goal, settings, ground=ground, ends_in=ends_in)
    seams: dict[str, float | list[int]] = {}
    said: list[str] = []
    way = found
    if neighbours is not None:
        way, seams, said = joined_way(found, neighbours, graph.clips[0])
    # What lies before and after may be in a bed or a chair.
    inside = deepest(way.clip, FreeSpace(scene, settings.half_width), own_frames(way, neighbours))
    said += inside_said(inside)

    def work(folder: RunFolder) -> None:
        quality = None
        if way.contacts is not None and way.planted is not None:
            quality = quality_of(way.graph_clip, way.planted, way.contacts, None if ground.flat else ground)
        numbers = {
            "scene": scene.name,
            "clips": list(own.clips),
            "unit": files[0].unit,
            "up": files[0].up,
            "graph_seconds": built,
            **graph.numbers(),
            **way.numbers,
            **path_measures(found.graph_path, found.path, way.clip.frame_time),
            **seams,
            "body_depth": inside.depth,
            **_slides(way),
            **({} if quality is None else quality.numbers),
        }
        write_json(folder.path / "metrics.json", numbers)
        if way.planted is not None:
            # Exports then need not find out again when feet stand.
            take = Take.of_clip(f"walk_{scene.name}", way.clip, numbers, way.planted.touching)
            write_npz(folder.path / "motion.npz", take)
        file = files[0].with_motion(way.clip) if neighbours is None else together(files[0], way.clip, neighbours)
        file.write(folder.path / "walk.bvh")
        pictures, marks = {}, [] if neighbours is None else neighbours.seams(way.clip.frames)
        if call.settings.pictures:
            half = own.way.half_width
            figures = {
                "rooms": lambda: rooms_figure(scene, way.graph_path, way.path, start, goal, half),
                "strip": lambda: sticks_figure(way.clip, ground=ground, seams=marks),
            }
            pictures = write_pictures(folder.path, figures)
        final = {name: value for name, value in numbers.items() if isinstance(value, float)}
        write_events(folder.path, results=final, pictures=pictures)
        notes = [
            f"{Path(name).name}: {note}" for name, file in zip(own.clips, files, strict=True) for note in file.notes
        ]
        folder.notes = [Note("clip", note) for note in notes]
        folder.notes += [Note("walk", sentence) for sentence in said]
        notes += said
        if quality is not None:
            folder.notes += [Note("walk", sentence) for sentence in quality.sentences]
            notes += quality.sentences
        say(summary(folder.path, numbers, notes))

    return work


def ground_of(call: Call, scene: Scene) -> Ground:
    """The ground that is chosen, or else that of the scene. Raises HopdiffError, naming the setting or the scene."""
    chosen: Mapping[str, Any] = call.own.ground
    if not scene.ground or chosen["kind"] != "flat" or "ground" in typed_names(call.command):
        return build_ground(chosen)
    try:
        return build_ground(scene.ground)
    except HopdiffError as error:
        raise HopdiffError(f"scene {scene.name}: {error}") from error


def place_of(what: str, given: Any, scene: Scene) -> Place:
    """A place by its name in the scene, or [x, z, heading in degrees]. Raises HopdiffError, naming the setting."""
    if isinstance(given, str):
        return scene.place(given)
    numbers = list(given) if isinstance(given, Sequence) else []
    if len(numbers) != 3 or not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
        raise HopdiffError(
            f"{what} must be the name of a place in the scene or [x, z, heading in degrees], not {given!r}."
        )
    return Place((float(numbers[0]), float(numbers[1])), math.radians(float(numbers[2])))


def _slides(way: Way) -> dict[str, float]:
    """How still the feet stand: as the graph blends them, after the edit, and as they were put right."""
    if way.contacts is None or way.planted is None:
        return {}
    stages = {"graph": way.graph_clip, "edited": way.edited_clip}
    slides = {stage: slide_numbers(clip, way.contacts) for stage, clip in stages.items()}
    slides["cleaned"] = standing_numbers(way.planted, way.contacts)
    return {f"{name}_{stage}": value for stage, numbers in slides.items() for name, value in numbers.items()}


def summary(folder: Path, m: Mapping[str, Any], notes: Sequence[str] = ()) -> str:
    """The table at the end. notes: sentences for the user."""
    rows = [
        ("graph", f"{m['graph_frames']} frames, {m['graph_seconds']:.1f} s"),
        (
            "found",
            f"{m['frames']} frames, {m['duration']:.1f} s, {m['length']:.1f} m; {m['expansions']} expansions,"
            f" {m['seconds']:.1f} s",
        ),
        ("", f"missed the goal by {m['gap']:.2f} m and {m['gap_deg']:.0f} deg before the edit"),
        (
            "edited",
            f"{1000 * m['end_error']:.2f} mm and {m['end_error_deg']:.3f} deg off; middle {m['clearance']:.2f} m or"
            f" more from everything, deepest joint {100 * m['body_depth']:.1f} cm inside",
        ),
    ]
    if m["bend_deg"]:
        rows.append(("bent", f"{m['bend_deg']:.0f} deg in all: the clips hold no such walk as they are"))
    if "slide_speed_cleaned" in m:
        slides = ", ".join(f"{100 * m[f'slide_speed_{stage}']:.1f}" for stage in ("graph", "edited", "cleaned"))
        rows.append(("feet", f"slide {slides} cm/s (graph, edited, cleaned)"))
    rows += seam_rows(m)
    rows += [("note", note) for note in notes]
    rows.append(("files", shown(folder)))
    return "\n".join(f"{name:<9} {text}" for name, text in rows)


TASK = Task(build, NavigateTask, motion=True)
