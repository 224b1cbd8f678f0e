"""The figures and the table of Kim & Lee (2021): how each is made here, what they show, and where ours differs."""

from __future__ import annotations

from pathlib import Path

from experiments.gallery import Entry, Gallery, Numbers, Shot
from experiments.kim2021.table_1 import ALPHA, ROWS, words_of

STRAIGHT, SIDEWAYS = "clip={clips}/walk_straight_cmu_16_15.bvh", "clip={clips}/walk_sideways_snu_cross90.bvh"
BREAKDOWN = "clip={clips}/walk_straight_cmu_07_01.bvh"
WANDER = "clips=[{clips}/wander_snu_93s_30hz.bvh]"
PAPER = "edit.variant=paper"
BOTH, ROOMS = "path.png strip.png", "rooms.png strip.png"

TABLE = (
    ("variant", "variant", "s"),
    ("frames", "frames", "d"),
    ("rounds", "rounds", "d"),
    ("ms_set_up", "set-up ms", ".1f"),
    ("ms_solve", "solve ms", ".1f"),
    ("stretch", "stretch", ".2f"),
    ("side_slip_p95_deg", "side-slip deg", ".1f"),
    ("turn_max_deg", "turn deg in 1/30 s", ".1f"),
    ("slide_speed_source", "slide m/s: source", ".3f"),
    ("slide_speed_edited", "edited", ".3f"),
    ("slide_speed_cleaned", "cleaned", ".3f"),
)


def experiment(name: str, *more: str) -> tuple[str, ...]:
    return (f"+experiment=kim2021/{name}", *more)


def pair(name: str, clip: str, caption: str) -> tuple[Shot, ...]:
    """Ours, and beside it the paper's variant, of which the numbers are shown."""
    return (
        Shot(name, experiment(name, clip), caption, BOTH, 700),
        Shot(f"{name}_paper", experiment(name, clip, PAPER), f"{caption}, `edit.variant=paper`", None),
    )


def arrived(numbers: Numbers) -> str:
    """Rounds and errors of every run."""
    parts = []
    for name, m in numbers.items():
        if "rounds" in m:
            parts.append(
                f"`{name}`: {m['rounds']} round{'s' * (m['rounds'] != 1)}, {1000 * m['error_place']:.2f} mm and"
                f" {m['error_yaw_deg']:.3f} deg off" + ("" if m["converged"] else ", **not arrived**")
            )
    return "; ".join(parts) + "."


def breakdown(numbers: Numbers) -> str:
    m = numbers["timing"]
    return (
        f"{m['frames']} frames, {m['rounds']} rounds: set-up {m['ms_set_up']:.1f} ms, rounds {m['ms_solve']:.1f} ms,"
        f" clean-up of the feet {m['ms_feet']:.0f} ms (one run of a cold process; medians side by side with a dense"
        " pseudo-inverse stand in [experiments/edits](../edits/README.md))."
    )


def walked(numbers: Numbers) -> str:
    m = numbers["fig_6"]
    return (
        f"Graph of {m['graph_frames']} frames with {m['graph_transitions']} transitions in {m['graph_seconds']:.1f} s,"
        f" {100 * m['graph_kept']:.0f} % of the frames strongly connected; the way found in {m['seconds']:.1f} s and"
        f" {m['expansions']} expansions: {m['frames']} frames, {m['length']:.1f} m. It missed the goal by"
        f" {m['gap']:.2f} m and {m['gap_deg']:.0f} deg, the edit by {1000 * m['end_error']:.2f} mm and"
        f" {m['end_error_deg']:.3f} deg; its middle keeps {m['clearance']:.2f} m from everything. Standing feet slide"
        f" {100 * m['slide_speed_graph']:.1f} cm/s as the graph gives them, {100 * m['slide_speed_cleaned']:.1f} cm/s"
        " in the end."
    )


ENTRIES: tuple[Entry, ...] = (
    Entry(
        "2",
        "A straight walk",
        "(a) arrives where it did but turned by 90 degrees: the way bulges to the other side of the turn, so that the"
        " change is spread over all of it. (b) arrives aside, facing as it did, after one round.",
        (
            *pair("fig_2a", STRAIGHT, "(a) same place, 90 degrees"),
            *pair("fig_2b", STRAIGHT, "(b) aside, facing as it did"),
        ),
        arrived,
        "The clip is another one. A place alone with the headings kept is linear: one round in both variants, and the"
        " side-slip that it takes is the price of not turning (`target.heading=free` turns into the way instead).",
        TABLE,
    ),
    Entry(
        "3",
        "A sideways walk",
        "The body faces across the way all along. (a) arrives aside; (b) aside and turned, after three rounds.",
        (
            *pair("fig_3a", SIDEWAYS, "(a) aside, facing as it did"),
            *pair("fig_3b", SIDEWAYS, "(b) aside, 45 degrees"),
        ),
        arrived,
        "The clip is another one, of 328 frames in place of 450.",
        TABLE,
    ),
    Entry(
        "4",
        "Back to the left of the start",
        "(a) the way kinks where |delta| jumps (red bars); (b) with delta eased by a B-spline it does not.",
        (
            Shot("fig_4a", experiment("fig_4a", STRAIGHT), "(a) the last state bound", "path.png", 700),
            Shot("fig_4b", experiment("fig_4b", STRAIGHT), "(b) eased by a B-spline", BOTH, 700),
            Shot("fig_4_ours", experiment("fig_4_ours", STRAIGHT), "hopdiff's own variant", BOTH, 700),
        ),
        arrived,
        "Both have the paper's theta, the angle between way and facing. (a) Bound in its last state alone, a path is"
        " its source and one ramp over all of it, three numbers. On the way to the target they come to a fold: the end"
        " answers to them millions of times less to one side than to another, and no round leads on. By then |delta|"
        " jumps and the way kinks. (b) Here the change of the differential coordinates is a cubic B-spline over the"
        " whole clip, and of those that arrive one of the least is taken. Steps far shorter than usual take less of it,"
        " as their direction is noise. hopdiff's own variant takes the turn of the body as third state and needs no"
        " spline.",
        TABLE,
    ),
    Entry(
        "Table 1",
        "Rounds of four edits",
        "straight (pos) 1 round, straight (pos, dir) 6, of 100 frames; side (pos) 1, side (pos, dir) 3, of 450 frames."
        " It tells neither the targets nor alpha.",
        tuple(Shot(f"table_1_{row.key}", tuple(words_of(row)), row.name, None) for row in ROWS),
        arrived,
        f"The clips are others, cut to as many frames. With alpha {ALPHA:g} for all of them the rounds are the paper's,"
        " if the straight walk turns by 90 degrees as in figure 2(a) and the sideways one by 45; shifts are within"
        " alpha. The third state is the turn. [table_1.md](table_1.md) has each row against alpha, and the paper's"
        " theta too.",
        TABLE,
    ),
    Entry(
        "316 frames",
        "What takes the time",
        "4.5 ms for the set-up; in each of three rounds 3.1 ms for putting the path together, .1 ms for the"
        " constraints and .8 ms for the solution.",
        (Shot("timing", experiment("fig_3b", BREAKDOWN, "pictures=false"), "A walk of 316 frames", None),),
        breakdown,
        "Putting the path together is two running sums here, not a loop. Another machine.",
    ),
    Entry(
        "5, 6",
        "From room to room",
        "A walk from a chair in room 1 to a bed in room 2, through a passage 1.2 m wide, from 90 s of walking about:"
        " the motion graph's path jumps at its end, the edited one does not.",
        (Shot("fig_6", experiment("fig_6", WANDER), "The path before and after the edit, and the walk", ROOMS, 700),),
        walked,
        "The clip has 20 joints, not 65. What is checked against the walls is the edited path with its blends. Feet"
        " that slide where two motions are blended are held.",
    ),
)

HEAD = """# Kim & Lee (2021), figure by figure

The figures and the table of Meejin Kim and Sukwon Lee, *Editing Walking Motion by Deforming the Root Joint's Path*
(Journal of the Korea Computer Graphics Society 27(1), 2021), made again with hopdiff. Written by
`python -m experiments.kim2021 --clips FOLDER` from the run folders that it makes; edit `entries.py`, not this page.
FOLDER holds captured walks, which are not part of the project: the CMU Graphics Lab database's 07_01, 16_15 and 127_31,
and three clips of the Movement Research Lab of Seoul National University (repository snumrl/DataDrivenBipedController).
The data used in this project was obtained from mocap.cs.cmu.edu; the database was created with funding from NSF
EIA-0196217. Without FOLDER the figures show a run of hopdiff's own, and the rooms are left out.

[contacts.md](contacts.md), by `python -m experiments.kim2021.contacts FILES`, compares contacts kept by an optimisation
over the whole clip, as in the paper's algorithm 1, with hopdiff's own planting of one after the other.

hopdiff's own variant, which stands beside the paper's, binds the place and yaw of the last frame itself.
"""

GALLERY = Gallery("kim2021", HEAD, "The paper", ENTRIES, Path(__file__).parent, needs_clips=True)
