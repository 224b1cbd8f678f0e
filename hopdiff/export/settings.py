# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What an exported file shall be."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hopdiff.doors import FORMATS
from hopdiff.export.anatomy import GROUND_ROOT, SCHEMES
from hopdiff.export.axes import AXES
from hopdiff.export.format import Format
from hopdiff.export.pose import ARMS
from hopdiff.export.views import views_of
from hopdiff.io.bvh import EULER_ORDERS
from hopdiff.io.run_folder import WRITTEN
from hopdiff.messages import choose
from hopdiff.models.gait import LEAST_FRAMES
from hopdiff.types import HopdiffError

UNITS = {"m": 1.0, "cm": 100.0}  # file units in a metre
MAX_FPS = 1000.0
MAX_CYCLES, MAX_KEYS = 10_000, 10_000
SIZES = (8, 2048)  # pixels
IN_NAMES = ("name", "speed", "beta", "turn")  # what names of clips may be made of
JOINTS, FRAMES, ROOTS, TOGETHER = (
    ("full", "model"),
    ("whole", "exact"),
    ("travelling", "in_place"),
    ("overlaid", "side_by_side"),
)


@dataclass(kw_only=True)
class ClipSettings:
    """What an exported clip shall be, whatever body moves in it and whatever file it goes into.

    fps [frames/s]: null leaves the frames as they are. frames: whole fits a whole number of frames into the motion, so
    that a loop ends on its first frame and its time is kept (frames then lie not quite 1 / fps apart); exact puts
    frames exactly 1 / fps apart, and the last one then ends the motion up to a frame early. keys: of a run the stride
    from one touchdown of the left foot to the next in this many equal parts, as blends of clips want it; null leaves
    it.
    root: travelling or in_place. cycles: how often a loop is laid end to end. mirrored: left and right change places.
    clip: name of the clip, in which {name}, {speed}, {beta} and {turn} stand for those of the run (a turn of 0 where
    it has none); a list for several clips; null leaves the run's name. loop_suffix: whether names of loops end in
    -loop, by which Godot's importer knows them.
    """

    fps: float | None = None
    frames: str = "whole"
    keys: int | None = None
    root: str = "travelling"
    cycles: int = 1
    mirrored: bool = False
    clip: Any = None
    loop_suffix: bool = False

    def check_clip(self, where: str) -> None:
        """Raises HopdiffError, naming the setting below WHERE, for a value that cannot be."""
        choose(f"{where}.frames", self.frames, FRAMES)
        choose(f"{where}.root", self.root, ROOTS)
        if self.fps is not None and not (math.isfinite(self.fps) and 1.0 <= self.fps <= MAX_FPS):
            raise HopdiffError(f"{where}.fps must lie between 1 and {MAX_FPS:g} frames/s, not {self.fps:g}.")
        if self.keys is not None and not LEAST_FRAMES <= self.keys <= MAX_KEYS:
            raise HopdiffError(f"{where}.keys must lie between {LEAST_FRAMES} and {MAX_KEYS}, not {self.keys}.")
        if self.keys is not None and self.fps is not None:
            raise HopdiffError(
                f"{where}.fps has no effect with {where}.keys, which divides the stride: set one of them."
            )
        if not 1 <= self.cycles <= MAX_CYCLES:
            raise HopdiffError(f"{where}.cycles must lie between 1 and {MAX_CYCLES}, not {self.cycles}.")
        for name in self.clip_names:
            words = "|".join(IN_NAMES)
            if not isinstance(name, str) or not name or re.search("[{}]", re.sub(f"{{({words})}}", "", name)):
                raise HopdiffError(
                    f"{where}.clip must be a name, or a list of names, in which {{{'}, {'.join(IN_NAMES)}}} may stand,"
                    f" not {name!r}."
                )

    @property
    def clip_names(self) -> list[Any]:
        """What clips are to be called: none where they keep their names, one for all, or one for each."""
        several = isinstance(self.clip, Sequence) and not isinstance(self.clip, str)
        return [] if self.clip is None else list(self.clip) if several else [self.clip]


@dataclass
class ExportSettings(ClipSettings):
    """One file format with everything that can be chosen of it; presets are in conf/export/.

    kind: a module of `hopdiff.export.formats`, or what an installed package brings. file: name of the file, with the
    ending of its kind.
    joints: of a run of hopdiff's own: full (22: spine, collars, wrists, head, ankles, toes) or model (its own eleven).
    names: of the joints: hopdiff, mixamo or unreal_mannequin; null leaves them. rest: the pose without rotations: t, a
    or straight (arms hang); null leaves it. axes: of GLB and FBX files, which way the joints' frames point in that
    pose: world (along its axes), bone (y along the bone, as Blender has it), mixamo, or unreal (its mannequin's).
    unit, up: of BVH files: m or cm; y or z. order: their Euler order.
    ground: whether a root joint on the ground carries the way.
    together: of HTML pages with several motions: overlaid or side_by_side. blender: program that makes FBX files:
    Blender or a Python with bpy; null: what HOPDIFF_BLENDER names, or blender.
    view: of pictures: side, front, back, three_quarter, top, four or eight (ways to face, seen from 30 degrees above),
    [azimuth, elevation] in degrees (0: it faces us, 90: to the right), or a list of these. size: pixels that the
    standing figure is high in them. columns: of a sprite sheet; null for a row as long as the motion, if it fits.
    """

    kind: str = ""
    file: str | None = None
    joints: str = "full"
    names: str | None = None
    rest: str | None = None
    axes: str = "world"
    unit: str = "m"
    up: str = "y"
    order: str = "ZXY"
    ground: bool = False
    together: str = "side_by_side"
    blender: str | None = None
    view: Any = "side"
    size: int = 128
    columns: int | None = None

    def check(self, name: str) -> None:
        """Raises HopdiffError, naming the setting of exports.NAME, for a value that cannot be."""
        where = f"exports.{name}"
        if not self.kind:
            raise HopdiffError(f"{where} is there once it is chosen: add export=[{name}].")
        choose(f"{where}.kind", self.kind, FORMATS.names())
        for entry, choices in (
            ("joints", JOINTS),
            ("axes", AXES),
            ("unit", UNITS),
            ("up", ("y", "z")),
            ("order", EULER_ORDERS),
            ("together", TOGETHER),
        ):
            choose(f"{where}.{entry}", getattr(self, entry), choices)
        if self.names is not None:
            choose(f"{where}.names", self.names, SCHEMES)
        if self.rest is not None:
            choose(f"{where}.rest", self.rest, ARMS)
        self.check_clip(where)
        if self.axes != "world" and not self.format.axes:
            raise HopdiffError(
                f"{where}.axes={self.axes} cannot be had in {self.format.suffix} files: their joints are aligned with"
                " the world's axes in the rest pose."
            )
        views_of(self.view, f"{where}.view")
        if not SIZES[0] <= self.size <= SIZES[1]:
            raise HopdiffError(f"{where}.size must lie between {SIZES[0]} and {SIZES[1]} pixels, not {self.size}.")
        if self.columns is not None and self.columns < 1:
            raise HopdiffError(f"{where}.columns must be 1 or more, not {self.columns}.")
        if self.file is not None and not re.fullmatch(r"[^/\\:*?\"<>|\x00-\x1f]+", self.file):
            raise HopdiffError(f"{where}.file must be the name of a file without its folder, not {self.file!r}.")
        if (own := next((one for one in WRITTEN if one in map(str.lower, self.files(name))), None)) is not None:
            raise HopdiffError(f"{where}.file={self.file_name(name)} needs another name, {own} is the run's.")
        if (check := self.format.check) is not None:
            check(self)

    def file_name(self, name: str) -> str:
        """The name of the file of exports.NAME."""
        ending, others = self.format.suffix, self.format.others
        given = self.file or f"motion_{name}"
        return given if given.lower().endswith((ending, *others)) else given + ending

    def files(self, name: str) -> list[str]:
        """The names of the file of exports.NAME, and of what is written beside it."""
        file = self.file_name(name)
        return [file, *(Path(file).with_suffix(suffix).name for suffix in self.format.beside)]

    @property
    def format(self) -> Format:
        """How files of this kind are written."""
        found: Format = FORMATS.load(self.kind)
        return found

    @property
    def ground_name(self) -> str:
        """What the root joint on the ground is called."""
        return GROUND_ROOT.get(self.names or "", "root")


@dataclass
class RetargetSettings(ClipSettings):
    """Another body for exported motions.

    skeleton: a BVH or GLB file with it; null keeps the motion's own. names: how its joints are called: auto, hopdiff,
    mixamo, unreal_mannequin, or a YAML file with part: joint.
    """

    skeleton: str | None = None
    names: str = "auto"
