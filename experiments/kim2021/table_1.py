"""Table 1 of Kim & Lee (2021): rounds of each of its rows against alpha, and what they take."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from experiments.report import markdown, origin
from hopdiff.editing.leg_joints import facing, find_legs
from hopdiff.editing.paper import PaperSettings, edit_path_as_paper
from hopdiff.editing.root_path import RootPath, root_path
from hopdiff.editing.solve import SolveSettings
from hopdiff.editing.targets import Constraint, EditedPath, edit_path
from hopdiff.io.bvh import read_bvh

ALPHAS = (0.1, 0.2, 0.3, 0.5, 1.0, math.inf)
ALPHA = 0.3  # the one for all rows
TIMED = 15  # runs, of which the median counts
VARIANTS: dict[str, PaperSettings | None] = {
    "paper, theta the turn": PaperSettings(theta="turn"),
    "paper, theta to the tangent": PaperSettings(theta="tangent"),
    "the same with a B-spline": PaperSettings(theta="tangent", smooth=True),
    "hopdiff": None,
}


@dataclass(frozen=True)
class Row:
    """name: in the paper; rounds, milliseconds: there. key: of its experiment. clip: file. frames: first and last of
    those taken. aside: of the end to the left, as a share of the way. turn: of the end [deg], None to keep it."""

    name: str
    rounds: int
    milliseconds: float
    key: str
    clip: str
    frames: tuple[int, int]
    aside: float
    turn: float | None

    @property
    def count(self) -> int:
        return self.frames[1] - self.frames[0] + 1


STRAIGHT, SIDE = ("walk_straight_snu_30hz.bvh", (60, 159)), ("walk_sideways_duck_cmu_127_31.bvh", (0, 449))
ROWS = (
    Row("straight (pos)", 1, 3.49, "straight_pos", *STRAIGHT, 0.1, None),
    Row("straight (pos, dir)", 6, 7.87, "straight_pos_dir", *STRAIGHT, 0.1, 90.0),
    Row("side (pos)", 1, 12.10, "side_pos", *SIDE, 0.07, None),
    Row("side (pos, dir)", 3, 18.13, "side_pos_dir", *SIDE, 0.07, 45.0),
)


def path_of(row: Row, clips: Path) -> tuple[RootPath, float]:
    """The root path of a row's clip, of as many frames as in the paper, and its seconds a frame."""
    clip = read_bvh(clips / row.clip).clip().part(slice(row.frames[0], row.frames[1] + 1))
    return root_path(clip, facing(clip.skeleton, find_legs(clip.skeleton))), clip.frame_time


def edited(row: Row, path: RootPath, frame_time: float, variant: str, alpha: float) -> EditedPath:
    x, z = (path.place[-1] - path.place[0]).tolist()
    end_x, end_z = path.place[-1].tolist()
    place = end_x + row.aside * z, end_z - row.aside * x
    yaw = None if row.turn is None else float(path.yaw[-1]) + math.radians(row.turn)
    chosen = VARIANTS[variant]
    if chosen is None:
        last = Constraint(path.frames - 1, place, yaw, keep=yaw is None)
        return edit_path(path, [last], frame_time, SolveSettings(alpha=alpha))
    return edit_path_as_paper(path, frame_time, place, yaw, replace(chosen, alpha=alpha))


def table_1(clips: Path) -> str:
    """The page: what each row asks for, its rounds by variant and alpha, and its milliseconds at the one alpha."""
    paths = {row.name: path_of(row, clips) for row in ROWS}
    asked = []
    for row in ROWS:
        path = paths[row.name][0]
        way = float((path.place[-1] - path.place[0]).norm())
        turn = "kept" if row.turn is None else f"{row.turn:.0f}"
        cells = (f"{way:.2f}", f"{row.aside * way:.2f}", turn, row.rounds, f"{row.milliseconds:.2f}")
        asked.append((row.name, f"{row.clip}, {row.frames[0]} to {row.frames[1]}", row.count, *cells))
    rounds = []
    for row in ROWS:
        for variant in VARIANTS:
            found = [edited(row, *paths[row.name], variant, alpha) for alpha in ALPHAS]
            counts = [str(one.rounds) if one.converged else f"{one.rounds}, not arrived" for one in found]
            rounds.append((row.name, variant, *counts, row.rounds, f"{_timed(row, *paths[row.name], variant):.1f}"))
    bold = [f"**{alpha:g}**" if alpha == ALPHA else f"{alpha:g}" for alpha in ALPHAS]
    return "\n".join(
        (
            markdown(("row", "clip, frames", "frames", "way m", "aside m", "turn deg", "rounds", "ms"), asked),
            f"Rounds and ms: of the paper. Rounds by alpha [m and rad], and ms at alpha {ALPHA:g} (median of {TIMED}):",
            "",
            markdown(("row", "variant", *bold, "the paper", "ms"), rounds),
        )
    )


def _timed(row: Row, path: RootPath, frame_time: float, variant: str) -> float:
    found = [sum(edited(row, path, frame_time, variant, ALPHA).milliseconds.values()) for _ in range(TIMED)]
    return statistics.median(found)


def write_table(clips: Path, file: Path) -> None:
    text = table_1(clips)
    made = origin("kim2021", ("--clips", "FOLDER"))
    file.write_text(f"{made}\n\n# Table 1, row by row\n\n{text}", encoding="utf-8")


def words_of(row: Row) -> Sequence[str]:
    """Of the command that makes a row, {clips} standing for the folder of the clips."""
    return (
        f"+experiment=kim2021/table_1_{row.key}",
        f"clip={{clips}}/{row.clip}",
        f"edit.frames=[{row.frames[0]},{row.frames[1]}]",
        "pictures=false",
    )
