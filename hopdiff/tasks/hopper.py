# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""task=hopper: the one-leg or two-leg hopper alone, as Kang (1999) draws it in figures 3.4, 3.5 and 3.7."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

from hopdiff.io.record import write_json, write_table
from hopdiff.io.run_folder import RunFolder
from hopdiff.messages import say
from hopdiff.motion import SIDES
from hopdiff.numerics import GRAVITY
from hopdiff.physics.hopping import Hopper, Hopping, Legs, first_hop, hop_along, periodic_rate
from hopdiff.plots.hopper import hopper_figure
from hopdiff.plots.save import save_figure
from hopdiff.tasks.base import Call, Task, Work
from hopdiff.tasks.results import shown
from hopdiff.types import HopdiffError

MAX_FRAMES = 100_000
SHOWN_HOPS = 6  # in the summary
LEAST_STANCE = 8  # frames that a stance lasts at least
LOST = 0.15  # share by which a flight differs that no longer is the periodic one
SAME_RATE = 1e-6  # m/s within which a touchdown rate is the periodic one

# Lowest and highest value, and unit.
RANGES = {
    "hops": (1, 100, ""),
    "leg_length": (0.01, 100.0, " m"),
    "touchdown_angle_deg": (1.0, 85.0, ""),
    "stiffness": (1e-3, 1e9, " N/m"),
    "mass": (1e-3, 1e6, " kg"),
    "step": (1e-6, 1.0, " s"),
    "touchdown_rate": (0.0, 100.0, " m/s"),
    "alpha": (0.55, 2.0, ""),
    "flight_knee_deg": (0.0, 170.0, ""),
    "active_angle_start_deg": (-90.0, 90.0, ""),
    "active_angle_end_deg": (-90.0, 90.0, ""),
    "active_knee_start_deg": (0.0, 170.0, ""),
    "active_knee_middle_deg": (0.0, 170.0, ""),
    "active_knee_end_deg": (0.0, 170.0, ""),
}


@dataclass
class HopperSettings:
    """legs: 1 or 2. leg_length: l [m]. touchdown_angle_deg: theta_0. stiffness: kappa [N/m]. mass: m [kg].

    step: frame interval h [s]. hops: how many. touchdown_rate: how fast HIP falls at the first touchdown [m/s];
    None for that of the periodic hop, or 0 if there is none. flight_knee_deg: knee flexion of a single leg half-way
    through its flight. alpha: when the leg angles peak in flight (6), of two legs. active_*: the leg that does not
    carry, of two: angle from the vertical (foot ahead positive) when the other foot touches down and takes off, and
    knee flexion then and half-way through.
    """

    legs: int
    leg_length: float
    touchdown_angle_deg: float
    stiffness: float
    mass: float
    step: float
    hops: int
    touchdown_rate: float | None
    flight_knee_deg: float
    alpha: float
    active_angle_start_deg: float
    active_angle_end_deg: float
    active_knee_start_deg: float
    active_knee_middle_deg: float
    active_knee_end_deg: float


@dataclass
class HopperTask:
    """See `HopperSettings`."""

    hopper: HopperSettings


def build(call: Call) -> Work:
    """Step the hopper; one that falls is a result like any other.

    Raises HopdiffError if a setting is out of its range.
    """
    settings, speed = call.own.hopper, call.settings.speed
    check_hopper(settings, speed)
    machine = Hopper(
        settings.leg_length, math.radians(settings.touchdown_angle_deg), speed, settings.stiffness, settings.mass
    )
    cycle_rate = periodic_rate(machine)
    rate = (cycle_rate or 0.0) if settings.touchdown_rate is None else -settings.touchdown_rate
    done = hop_along(machine, legs_of(settings), rate, settings.step, settings.hops, MAX_FRAMES)
    if done is None:
        raise HopdiffError(
            f"hopper.hops={settings.hops} at hopper.step={settings.step:g} s takes more than {MAX_FRAMES} frames: "
            "ask for fewer hops or a longer step."
        )
    numbers = hopper_metrics(settings, machine, done, rate, cycle_rate)

    def work(folder: RunFolder) -> None:
        write_json(folder.path / "metrics.json", numbers)
        write_table(folder.path / "frames.csv", *frame_table(done))
        note = _course(numbers, done)
        if call.settings.pictures:
            figure = hopper_figure(done, settings.leg_length, _title(settings, speed), note)
            save_figure(figure, folder.path / "hopper.png")
        say(hopper_summary(folder.path, settings, speed, numbers, note))

    return work


def legs_of(settings: HopperSettings) -> Legs:
    """The legs' settings in radians."""
    return Legs(
        number=settings.legs,
        alpha=settings.alpha,
        flight_knee=math.radians(settings.flight_knee_deg),
        angle_start=math.radians(settings.active_angle_start_deg),
        angle_end=math.radians(settings.active_angle_end_deg),
        knee_start=math.radians(settings.active_knee_start_deg),
        knee_middle=math.radians(settings.active_knee_middle_deg),
        knee_end=math.radians(settings.active_knee_end_deg),
    )


def check_hopper(settings: HopperSettings, speed: float) -> None:
    """Raises HopdiffError, naming the setting, if a number is out of its range or the frames are too long."""
    if settings.legs not in (1, 2):
        raise HopdiffError(f"hopper.legs must be 1 or 2, not {settings.legs}.")
    for name, (low, high, unit) in RANGES.items():
        value = getattr(settings, name)
        if value is not None and not low <= value <= high:
            raise HopdiffError(f"hopper.{name} must be from {low:g} to {high:g}{unit}, not {value:g}.")
    reach = settings.leg_length * math.sin(math.radians(settings.touchdown_angle_deg))
    # A spring that swings within two frames explodes (the step of (2) is an explicit one).
    longest = min(2.0 * reach / (LEAST_STANCE * speed), math.sqrt(settings.mass / settings.stiffness))
    if settings.step > longest:
        raise HopdiffError(
            f"hopper.step must be at most {longest:.2g} s for this leg, speed and spring, not {settings.step:g}."
        )


def hopper_metrics(
    settings: HopperSettings, machine: Hopper, done: Hopping, rate: float, cycle_rate: float | None
) -> dict[str, Any]:
    """What metrics.json holds, in SI units.

    rate, cycle_rate: vertical speed at the first touchdown and at that of the periodic hop, negative [m/s].
    """
    first = first_hop(machine, rate)
    compression = machine.leg_length - done.shortest
    free = (done.carrier.unsqueeze(-1) != done.carrier.new_tensor(range(settings.legs))) | done.in_flight.unsqueeze(-1)
    return {
        "speed": machine.speed,
        "legs": settings.legs,
        "leg_length": machine.leg_length,
        "touchdown_angle_deg": settings.touchdown_angle_deg,
        "stiffness": machine.stiffness,
        "mass": machine.mass,
        "step": settings.step,
        "touchdown_rate": -rate + 0.0,
        "periodic_touchdown_rate": None if cycle_rate is None else -cycle_rate,
        "periodic": cycle_rate is not None and abs(rate - cycle_rate) < SAME_RATE,
        "hops_done": done.hops_done,
        "fell": done.fell,
        "contact_time": first.contact,
        "flight_time": first.flight,
        "contact_times": done.contact_times,
        "flight_times": done.flight_times,
        "apex_heights": done.apex_heights,
        "max_leg_compression": compression,
        "peak_leg_force_bw": machine.stiffness * compression / (machine.mass * GRAVITY),
        "lowest_foot": float(done.feet[..., 1][free].min()) if bool(free.any()) else 0.0,
    }


def frame_table(done: Hopping) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows of frames.csv: y up, z forward [m], time [s]."""
    count = done.feet.shape[1]
    names = [f"{side}_" for side in SIDES] if count == 2 else [""]
    columns = ["time", "hop", "phase", "carrier", "hip_z", "hip_y"]
    columns += [f"{name}{part}_{axis}" for name in names for part in ("foot", "knee") for axis in "zy"]
    rows = []
    for i, (foot, knee) in enumerate(zip(done.feet.tolist(), done.knees.tolist(), strict=True)):
        phase = "flight" if done.in_flight[i] else "stance"
        carrier = SIDES[int(done.carrier[i])] if count == 2 else "only"
        legs = chain.from_iterable((*foot[leg], *knee[leg]) for leg in range(count))
        time = round(float(done.times[i]), 9)
        rows.append([time, int(done.hop[i]), phase, carrier, *done.hip[i].tolist(), *legs])
    return columns, rows


def _title(settings: HopperSettings, speed: float) -> str:
    alpha = f", α {settings.alpha:g}" if settings.legs == 2 else ""
    return (
        f"{'One-leg' if settings.legs == 1 else 'Two-leg'} hopper: {speed:g} m/s, l {settings.leg_length:g} m, "
        f"θ₀ {settings.touchdown_angle_deg:.3g}°, κ {settings.stiffness:g} N/m, m {settings.mass:g} kg, "
        f"h {settings.step:g} s{alpha}"
    )


def _course(numbers: Mapping[str, Any], done: Hopping) -> str:
    """What the hopper does, in a sentence or two."""
    start, periodic = numbers["touchdown_rate"], numbers["periodic_touchdown_rate"]
    if numbers["periodic"]:
        text = f"Repeats itself: contact {numbers['contact_time']:.3f} s, flight {numbers['flight_time']:.3f} s."
        off = max((abs(time / numbers["flight_time"] - 1.0) for time in numbers["flight_times"]), default=0.0)
        if done.fell or off > LOST:
            text += " This hop is unstable, and frame by frame it is lost."
    elif periodic is None:
        text = f"Does not repeat itself: no hop was found that ends as it began; starts falling at {start:g} m/s."
    else:
        text = f"Starts falling at {start:g} m/s; the hop that repeats itself does at {periodic:.3f} m/s."
    if done.fell:
        text += f" Falls in hop {done.hops_done + 1}: the leg does not lift HIP back to the touchdown height."
    return text


def hopper_summary(
    folder: Path, settings: HopperSettings, speed: float, numbers: Mapping[str, Any], course: str
) -> str:
    """The table at the end: what was asked, what the hopper does, where the files are."""
    hops = zip(numbers["contact_times"], numbers["flight_times"], numbers["apex_heights"], strict=True)
    rows = [
        ("asked", _title(settings, speed)),
        ("course", course),
        *(
            ("" if k else "hops", f"{k + 1}: contact {contact:.3f} s, flight {flight:.3f} s, apex {apex:.2f} m")
            for k, (contact, flight, apex) in enumerate(islice(hops, SHOWN_HOPS))
        ),
        *([("", "... and so on in metrics.json")] if len(numbers["flight_times"]) > SHOWN_HOPS else []),
        (
            "leg",
            f"shortened by up to {numbers['max_leg_compression']:.2f} m, "
            f"pushes with up to {numbers['peak_leg_force_bw']:.1f} body weights",
        ),
    ]
    if not numbers["fell"] and (depth := -numbers["lowest_foot"]) > 0.005:
        knee = "flight_knee_deg" if settings.legs == 1 else "active_knee_middle_deg"
        advice = f": raise hopper.{knee}" if getattr(settings, knee) < RANGES[knee][1] else ""
        rows.append(("note", f"a free foot passes {depth:.2f} m below the ground{advice}"))
    rows.append(("files", shown(folder)))
    return "\n".join(f"{name:<9} {text}" for name, text in rows)


TASK = Task(build, HopperTask)
