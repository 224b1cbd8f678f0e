"""A scene from above with a walk through it, before and after its path was edited (Kim & Lee 2021, figures 5 and 6)."""

from __future__ import annotations

import math

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from shapely import LineString, MultiPolygon, Polygon, box

from hopdiff.editing.root_path import RootPath
from hopdiff.graph.scene import Place, Scene
from hopdiff.plots import style
from hopdiff.plots.ground import LONGEST, map_axes
from hopdiff.plots.view import Array, numbers

BEFORE = style.GROUND
AFTER = style.SERIES[2]
GOAL = style.SERIES[6]
_FLOOR = "#F7F8FA"
_WALL = style.pale(style.BODY, 0.35)
_FURNITURE = "#DCCFBE"
_MARGIN = 0.25  # metres around the walls
_TICK = 0.16  # metres of a stroke to where the body faces
_APART = 0.35  # metres of way between two strokes
_ARROW = 0.55  # metres of the arrows at start and goal
_LETTER, _LINE, _INSET = 0.12, 0.3, 0.08  # metres of a letter and a line of a room's name, and from it to the walls


def rooms_figure(
    scene: Scene,
    before: RootPath,
    after: RootPath,
    start: Place,
    goal: Place,
    half_width: float = 0.0,
    title: str = "",
) -> Figure:
    """Walls, furniture and both root paths from above, z up the page and x to its left, in equal scales.

    before: as the motion graph gives it, with an arrow where it ends. after: edited, with a band as wide as the body,
    2 * half_width [m], and strokes to where the body faces. start, goal: arrows along their headings. title: instead of
    the scene's name and the lengths of the paths.
    """
    floor = scene.floor()
    around = shapely.buffer(floor, max(scene.thickness, 1e-3), join_style="mitre")
    bounds = np.array(around.bounds)
    low, high = bounds[:2] - _MARGIN, bounds[2:] + _MARGIN
    wide, tall = high - low
    scale = LONGEST / max(wide, tall)  # inches in a metre
    figure = style.new_figure(max(6.5, scale * wide + 1.2), scale * tall + 1.8, title or _caption(scene, before, after))
    axes = figure.add_subplot()
    map_axes(axes, low, high)
    axes.grid(visible=False)
    _fill(axes, around.difference(floor), _WALL, 1.0)
    _fill(axes, floor, _FLOOR, 1.1)
    for (section, _), shape in scene.obstacles().items():
        # What reaches into a wall is drawn as far as it stands in the room.
        shown = shape.intersection(floor)
        _fill(axes, shown, _WALL if section == "walls" else _FURNITURE, 1.3, edge=section != "walls")
    old, new = numbers(before.place), numbers(after.place)
    _names(axes, scene, new)
    if half_width > 0:
        band = LineString(new).buffer(half_width)
        _fill(axes, band, style.pale(AFTER, 0.72), 1.2, label="room for the body")
    axes.plot(*old.T, color=BEFORE, linewidth=1.6, linestyle=(0, (4, 2)), zorder=2, label="path in the motion graph")
    axes.plot(*new.T, color=AFTER, linewidth=2.2, zorder=3, label="path after the edit")
    _strokes(axes, new, numbers(after.yaw))
    _arrow(axes, old[-1], float(before.yaw[-1]), BEFORE, 3.5, size=0.7 * _ARROW)
    _arrow(axes, np.array(start.position), start.heading, style.INK, 4.0, "start")
    _arrow(axes, np.array(goal.position), goal.heading, GOAL, 4.1, "goal")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def _caption(scene: Scene, before: RootPath, after: RootPath) -> str:
    ways = [float(np.hypot(*np.diff(numbers(path.place), axis=0).T).sum()) for path in (before, after)]
    return f"{_words(scene.name)}: {ways[0]:.2f} m in the graph, {ways[1]:.2f} m after the edit"


def _fill(
    axes: Axes, shape: Polygon | MultiPolygon, colour: str, order: float, label: str = "", edge: bool = False
) -> None:
    """A shape with its holes."""
    if shape.is_empty:
        return
    parts = [part for part in getattr(shape, "geoms", [shape]) if isinstance(part, Polygon)]
    rings = [np.asarray(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
    outline = Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))
    line = {"edgecolor": style.mix(colour, "#000000", 0.35), "linewidth": 0.8} if edge else {"linewidth": 0.0}
    axes.add_patch(PathPatch(outline, facecolor=colour, zorder=order, label=label or "_", **line))


def _names(axes: Axes, scene: Scene, path: Array) -> None:
    """Rooms in the corner where the least is in the way, furniture in its middle."""
    taken = shapely.union_all([*scene.obstacles().values(), LineString(path).buffer(_TICK)])
    for name, outline in scene.rooms.items():
        label = np.array([_LETTER * len(name) + 0.1, _LINE])
        low, high = outline.min(axis=0) + _INSET, outline.max(axis=0) - _INSET
        corners = [(x, z) for z in (high[1], low[1] + label[1]) for x in (high[0], low[0] + label[0])]
        boxes = [box(x - label[0], z - label[1], x, z) for x, z in corners]
        room = Polygon(outline)
        hidden = [one.intersection(taken).area + one.difference(room).area for one in boxes]
        x, z = corners[int(np.argmin(hidden))]
        axes.text(x, z, _words(name), ha="left", va="top", fontsize=9, color=style.GROUND, zorder=1.4)
    for name, outline in scene.furniture.items():
        middle = Polygon(outline).representative_point()
        wide, tall = np.ptp(outline, axis=0)
        colour = style.mix(_FURNITURE, "#000000", 0.55)
        axes.text(
            middle.x,
            middle.y,
            _words(name),
            ha="center",
            va="center",
            fontsize=8,
            color=colour,
            zorder=1.4,
            rotation=90.0 if tall > 1.5 * wide else 0.0,
        )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _strokes(axes: Axes, place: Array, yaw: Array) -> None:
    """Short strokes from the path to where the body faces, at even distances along it."""
    way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(place, axis=0).T))))
    count = max(2, math.floor(way[-1] / _APART) + 1)
    frames = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], count)).clip(max=len(way) - 1))
    ahead = _TICK * np.stack((np.sin(yaw[frames]), np.cos(yaw[frames])), axis=-1)
    lines = np.stack((place[frames], place[frames] + ahead), axis=1)
    colour = style.mix(AFTER, "#000000", 0.5)
    axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=1.3, zorder=3.2), autolim=False)


def _arrow(
    axes: Axes, place: Array, heading: float, colour: str, order: float, label: str = "", size: float = _ARROW
) -> None:
    """An arrow from a place along a heading, with a ring where it starts."""
    tip = place + size * np.array([math.sin(heading), math.cos(heading)])
    axes.annotate(
        "",
        tuple(tip),
        tuple(place),
        arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0},
        zorder=order,
    )
    axes.plot(
        *place, "o", markersize=7, color="white", markeredgecolor=colour, markeredgewidth=1.6, zorder=order + 0.05,
        label=label or "_",
    )  # fmt: skip
