"""The figures of the thesis: how each is made here, what the thesis shows, and where ours differs."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from experiments.gallery import Entry, Gallery, Shot
from experiments.kang1999 import seen


def experiment(name: str, *more: str) -> tuple[str, ...]:
    return (f"+experiment=kang1999/{name}", *more)


# hopdiff's own way: the smooth model, the whole objective, the default search.
OURS = ("model=smooth", "costs=default", "search=gradient")  # the genes follow the model
# As it was drawn, with the same fixed genes and without a search: the model alone differs.
SMOOTH = ("model=smooth", "costs=default")

SLOW = ("model=smooth", "speed=3.5", "beta=0.2")

# Of figure 5.7; without these words the sweep has six searches and fifteen seeds.
SEEDS = ("search=ga_thesis,ga,random", "seed=0,1,2")
SCALED = "compare/scaled.png"

BODY_TABLE = (
    ("contact_time", "contact s", ".3f"),
    ("flight_time", "flight s", ".3f"),
    ("step_length", "step m", ".2f"),
    ("com_oscillation", "bounce m", ".3f"),
    ("trunk_lean_range_deg", "trunk swings deg", ".2f"),
    ("energy_rate", "energy", ".3f"),
)

RUN_TABLE = (
    ("model", "model", "s"),
    ("search", "search", "s"),
    ("eval", "eval", ".4f"),
    ("gamma_ratio", "gamma (ratio)", ".2f"),
    ("energy_rate", "energy", ".3f"),
    ("contact_time", "contact s", ".3f"),
    ("flight_time", "flight s", ".3f"),
    ("com_oscillation", "bounce m", ".3f"),
    ("knee_swing_max_deg", "knee to deg", ".0f"),
    ("arm_swing_deg", "arm swing deg", ".0f"),
    ("trunk_lean_deg", "trunk lean deg", ".1f"),
    ("peak_leg_force_bw", "leg force bw", ".1f"),
)


def both(name: str, caption: str, picture: str = "strip.png", own: tuple[str, ...] = SMOOTH) -> tuple[Shot, Shot]:
    """A figure by the thesis model, and beside it by the smooth one."""
    return (
        Shot(name, experiment(name), f"{caption}, `model=thesis`", picture),
        Shot(f"{name}_smooth", experiment(name, *own), f"{caption}, `model=smooth`", picture),
    )


ENTRIES: tuple[Entry, ...] = (
    Entry(
        "2.1",
        "The character",
        "A character of eleven joints: pelvis, waist, neck, shoulders, elbows, hips, knees. No lengths or masses are"
        " given.",
        (Shot("fig_2_1", experiment("fig_2_1"), "The character and its joints", "body.png"),),
        seen.body,
    ),
    Entry(
        "2.2",
        "Change the body, see the run change",
        "The window of a program in which one edits the body and the path and gets a run.",
        (
            Shot(
                "fig_2_2",
                experiment("fig_2_2"),
                "The same run asked of three bodies: legs shorter by a fifth, as they are, longer by a fifth",
                "*/strip.png",
            ),
            Shot("fig_2_2_human", SLOW, "A run of the adult, `model=smooth`"),
            Shot("fig_2_2_trunk", (*SLOW, "character.proportions.trunk=1.3"), "A longer trunk"),
            Shot("fig_2_2_arms", (*SLOW, "character.proportions.arms=1.4"), "Longer arms"),
            Shot("fig_2_2_mass", (*SLOW, "character.mass=100"), "A heavier body; it looks the same", None),
            Shot(
                "fig_2_2_child",
                ("task=replay", "genes_file={fig_2_2_human}/genes.json", "character=child"),
                "The genes of the adult on a child",
            ),
        ),
        seen.edits,
        "There is no window: every number of the body is a setting of the command line (`character.proportions.legs`,"
        " `.arms`, `.trunk`, `.head`, `character.mass`), and so is the path. Legs make the run another one; trunk and"
        " arms are carried along, and since the spring of the leg is solved from the times of the hop, mass alone"
        " changes forces but no motion.",
        BODY_TABLE,
    ),
    Entry(
        "3.4",
        "One-leg hopper, 10 m/s",
        "The hopper with h .005 s, l 2 m, kappa 3000, theta_0 45 deg, m 50 kg.",
        (Shot("fig_3_4", experiment("fig_3_4"), "One leg at 10 m/s", "hopper.png"),),
        partial(seen.hopper, name="fig_3_4"),
        "The thesis does not say how fast the mass comes down at first; here it starts with the speed that repeats. Its"
        " leg keeps the rest length in the air, with which the foot of this figure would sweep 10 cm below the ground,"
        " so the knee bends here (`hopper.flight_knee_deg`).",
    ),
    Entry(
        "3.5",
        "One-leg hopper, 5 m/s",
        "The same hopper at half the speed, h .01 s.",
        (Shot("fig_3_5", experiment("fig_3_5"), "One leg at 5 m/s", "hopper.png"),),
        partial(seen.hopper, name="fig_3_5"),
        "These numbers have no periodic run whatever the first speed is, so this is shown for the hops that it lasts:"
        " in the third stance the leg folds to the ground (`hopper.hops=3`).",
    ),
    Entry(
        "3.7",
        "Two-leg hopper",
        "Two legs taking turns: h .01 s, l 1.5 m, 5 m/s, kappa 9000, theta_0 30 deg, m 50 kg, alpha .9.",
        (Shot("fig_3_7", experiment("fig_3_7"), "Two legs at 5 m/s", "hopper.png"),),
        partial(seen.hopper, name="fig_3_7"),
        "Not a cycle either. The path of the leg in the air during stance is left open by the thesis; ours eases"
        " between angles that can be set (`hopper.active_*`). Equation (6) is used with its misprint put right.",
    ),
    Entry(
        "3.11, 3.12",
        "Balance at 1 and 5 m/s",
        "With the same eta of 5 the body moves much at 1 m/s and little at 5 m/s: the slower, the more.",
        (*both("fig_3_11", "1 m/s, eta 5"), *both("fig_3_12", "5 m/s, eta 5")),
        seen.balance,
        "Nothing is searched for here: the everyday run of the body is shown with eta 5 in every joint and axis.",
    ),
    Entry(
        "3.13",
        "Balance on a lame leg",
        "The body hurries over the lame leg, so that this carries for a shorter time, and leans over the sound one.",
        both("fig_3_13", "Lame left leg, 2 m/s, eta 5, seen from behind", "front.png"),
        seen.limp,
        "The thesis gives no numbers. Here the lame leg carries half as long (`limp.amount=0.5`): 30 % of that (of its"
        " logarithm) comes from the higher speed, the rest from a shorter way. The feet stand 11 cm apart, since the"
        " lean grows with that. `+experiment=limp` asks for it in a searched run.",
    ),
    Entry(
        "3.14",
        "Tracks of the centre of mass",
        "From above: the target jumps from foot to foot (dashed), the centre of mass follows in small waves (solid).",
        both("fig_3_14", "2 m/s, eta 5", "com_track.png"),
        seen.track,
        "Ours is almost a straight line: for a short frame interval equation (10) becomes a lag of v / (eta k) with k,"
        " the shift of the centre of mass per angle, near .3 m, so at 2 m/s the body needs more than a second to answer"
        " and a step lasts a third of one. The settled run is shown, not the first steps from rest. The larger wave of"
        " the `smooth` model goes against the target: its pelvis drops on the side of the swinging leg and takes the"
        " trunk along (without that, `genes.fixed.pelvis_roll=0`, 0.24 cm are left).",
    ),
    Entry(
        "5.1, 5.2, 5.3",
        "Speeds 2, 5 and 7 m/s",
        "The best runs for beta 0 and eta 5: least energy, best connection.",
        (
            *both("fig_5_1", "2 m/s, beta 0", own=OURS),
            *both("fig_5_2", "5 m/s, beta 0", own=OURS),
            *both("fig_5_3", "7 m/s, beta 0", own=OURS),
        ),
        seen.speeds,
        "With `eval` alone as the objective nothing asks for a posture: the run at 2 m/s leans far back all the time,"
        " and the arms hardly move, since moving costs. Beside it hopdiff's own objective (`costs=default`), which also"
        " asks for a lean, for contact times as in everyday running and for less force on the leg; with the target of"
        " no energy at all and all gains tied it still leans back at 2 m/s. Nobody reaches energy 0.",
        RUN_TABLE,
    ),
    Entry(
        "5.4, 5.5",
        "Ordinary and brisk at 10 m/s",
        "beta .2 gives an ordinary run and beta .7 a lively one at the same speed.",
        (*both("fig_5_4", "10 m/s, beta 0.2", own=OURS), *both("fig_5_5", "10 m/s, beta 0.7", own=OURS)),
        seen.brisk,
        "By `eval` alone the steps are shorter and quicker than any sprinter's, and at beta .2 the smoother connection"
        " is worth more than the energy that was asked for; hopdiff's own objective keeps the steps human and meets the"
        " energy. The thesis has no unit for its energy, ours is set so that beta .2 is everyday running.",
        RUN_TABLE,
    ),
    Entry(
        "5.6",
        "A run along a drawn path",
        "A path and a time are given; the character runs along it, with beta 0.",
        both("fig_5_6", "Along a drawn path, beta 0", "along.png", own=OURS),
        seen.path,
        "The thesis shows one picture and says nothing of turning. Ours leans by v^2 / (g r), at most 30 deg, pins each"
        " standing foot in the world, and fits whole strides into the time.",
    ),
    Entry(
        "5.7",
        "How the best value falls",
        "5 m/s, beta .5, 100 individuals, 100 generations: the best value of every generation, scaled to 0 and 1 by the"
        " least and greatest of them.",
        (
            *(
                Shot(f"fig_5_7{suffix}", experiment("fig_5_7", *words, *SEEDS), f"Three seeds, `{name}`", SCALED)
                for suffix, words, name in (
                    ("", (), "model=thesis"),
                    ("_joined", ("model.knee=joined",), "model=thesis model.knee=joined"),
                    ("_smooth", ("model=smooth",), "model=smooth"),
                )
            ),
        ),
        seen.convergence,
        "**No printed run connects.** Of random possible runs none has a gamma below 4, at any speed tried, and a "
        "search for gamma alone ends between 3.9 and 4.2 ([departures.md](departures.md)). At take-off the knee "
        "that carries straightens fast, and theta_l of equation (5), linear in time, bends it at once: a rate "
        "that turns from -x to x adds 4 x^2 / (x^2 + 1). So the value cannot get far below 1 - 1/2 - 1/(2 (1 + "
        "4)) = .4, and the figure shows how searches come near that, at an energy that is met. "
        "`model.knee=joined` is the smallest repair: the knee goes on with the rate of the stance, which fades "
        "through the flight.\n\n"
        "![Knees about take-off, printed and joined](take_off.png)\n\n"
        "The thesis shows one run of the genetic algorithm; here are three seeds of it (`ga_thesis`: as printed, "
        "the plainest choice where it is silent), of a tuned one and of random genes, each with 10,000 "
        "evaluations; without `search=` and `seed=` the sweep has six searches and fifteen seeds. `ga` does not "
        "price its best individuals again, so that its budget lasts for a few generations more than 100. Right: "
        "all searches by one scale.",
    ),
    Entry(
        "3.3.3",
        "One gain, or one for each joint and axis",
        "First all joints share one eta; then the genes hold a vector of them. No figure compares the two.",
        (
            Shot("eta", experiment("eta"), "5 m/s, beta 0.5, `model=thesis`, five seeds each", "compare/summary.png"),
            Shot(
                "eta_smooth",
                experiment("eta", *OURS),
                "5 m/s, beta 0.5, `model=smooth`, five seeds each",
                "compare/summary.png",
            ),
        ),
        seen.gains,
        "In `eval` the vector buys next to nothing: the energy target can be met and the legs connect either way. It is"
        " the rest of hopdiff's own objective (posture, arms) that has some use for it.",
    ),
)

HEAD = """# Kang (1999), figure by figure

Every figure and use of Young-Min Kang's thesis, made again with hopdiff: what it took, what the thesis shows, what
comes out here, and where the two differ. Written by `python -m experiments.kang1999` from the run folders that it
makes; edit `entries.py`, not this page. Each command stands under its picture and works by itself; the settings are in
`conf/experiment/kang1999/`.

`model=thesis` steps the equations as printed, with the misprints put right ([every departure, with its
effect](departures.md)); beside it, where both apply, stands `model=smooth`,
the same ideas made periodic and differentiable. The thesis leaves open the vertical speed at
touchdown, the path of the swinging leg, the masses of the body and the ranges of its genes and how they breed, and
prints no table: its pictures cannot be met line by line, only in what they show.
"""

GALLERY = Gallery("kang1999", HEAD, "The thesis", ENTRIES, Path(__file__).parent)
