"""Every figure of one recording: what must be zero in flight and in stance, and what the ground has to do for it.

from experiments.physics.check import check_file
figures = check_file(Path("motion.npz"))
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid, trapezoid

from experiments.physics.feet import foot_figures
from experiments.physics.frames import Mask, at, counted, stretches, switches
from experiments.physics.momentum import UP, Analysis, analyse
from experiments.physics.recording import GRAVITY, Array, Recording, read_recording

Figures = dict[str, float]

PRESSED = 0.1  # body weights: friction and the like are looked at above this vertical force


def check_file(path: Path) -> Figures:
    """The figures of the run in a NumPy archive. Raises UnfitError for one without what the check needs."""
    return check(read_recording(path))


def check(recording: Recording) -> Figures:
    """The figures of a recording by name; what cannot be known of it has none, what failed to be a number is NaN."""
    return figures(analyse(recording))


def figures(found: Analysis) -> Figures:
    own = found.recording
    standing = own.contact.any(axis=1)
    phases = counted(own.frames, own.loop)
    values = {
        "frame_rate": 1.0 / own.frame_time,
        "mass": own.mass,
        "duration": own.frame_time * (own.frames - 1),
        "flight_share": float(np.mean(~standing[phases])),
        "flight_frames": float(found.flight.sum()),
        "stance_frames": float(found.stance.sum()),
    }
    return (
        values | _file(found) | _flight(found) | _stance(found) | _kicks(found) | _ground(found) | foot_figures(found)
    )


def _file(found: Analysis) -> Figures:
    """Whether the file agrees with itself: kinematics, centre of mass, seam of the loop."""
    own, values = found.recording, {}
    if own.positions is not None:
        values["joints_off_mm"] = 1e3 * _largest(found.places - own.positions)
    if own.com is not None:
        values["com_off_mm"] = 1e3 * _largest(found.com - own.com)
    if own.loop:
        values["seam_mm"] = 1e3 * _largest(found.places[-1] - found.places[0] - own.travel)
    return values


def _flight(found: Analysis) -> Figures:
    """What no ground can explain: must all be zero."""
    if not found.flight.any():
        return {}
    values = _residual("flight_force", found.wanted[found.flight] / found.weight, "bw")
    values |= _residual("flight_moment", found.wanted_moment[found.flight], "nm")
    spans = [found.spin[frames] for frames in stretches(found.flight, found.recording.loop)]
    drifts = np.max([span.max(axis=0) - span.min(axis=0) for span in spans], axis=0)
    values |= {f"spin_drift_{axis}": float(drift) for axis, drift in zip("xyz", drifts, strict=True)}
    return values | {"spin_drift_max": float(np.max(drifts))}


def _stance(found: Analysis) -> Figures:
    """What the file's forces leave unexplained; or, without them, what a point of contact could not give."""
    if not found.stance.any():
        return {}
    if found.given is not None and found.given_moment is not None:
        force = (found.wanted - found.given)[found.stance] / found.weight
        moment = (found.wanted_moment - found.given_moment)[found.stance]
        return _residual("stance_force", force, "bw") | _residual("stance_moment", moment, "nm")
    feet, contact = found.recording.feet, found.recording.contact
    single = found.stance & (contact.sum(axis=1) == 1)
    if feet is None or not single.any():
        return {}
    arm = feet[np.arange(len(feet)), contact.argmax(axis=1)] - found.com
    return _residual("point_moment", (found.wanted_moment - np.cross(arm, found.wanted))[single], "nm")


def _kicks(found: Analysis) -> Figures:
    """Changes of momentum over the frames left out about touchdown and take-off that the file's forces do not explain.

    kick: of the velocity of the centre of mass [m/s]; jump_mm: of its place; spin_kick: of the angular momentum
    [kg m^2/s].
    """
    if found.given is None or found.given_moment is None:
        return {}
    own, kicks = found.recording, []
    wide = own.margin + 1
    for switch in switches(own.contact):
        frames = np.arange(switch - own.margin, switch + wide + 1)
        if not own.loop and (frames[0] < wide or frames[-1] >= own.frames - wide):
            continue
        ends, step = frames[[0, -1]], own.frame_time
        push, moment = (at(values, frames, own.loop) for values in (found.given, found.given_moment))
        gained = cumulative_trapezoid(push / own.mass - GRAVITY * UP, dx=step, axis=0, initial=0.0)
        before, after = at(found.velocity, ends, own.loop)
        start, end = at(found.com, ends, own.loop, own.travel)
        spun, spinning = at(found.spin, ends, own.loop)
        way = trapezoid(before + gained, dx=step, axis=0)
        off = (after - before - gained[-1], end - start - way, spinning - spun - trapezoid(moment, dx=step, axis=0))
        kicks.append([float(np.linalg.norm(one)) for one in off])
    if not kicks:
        return {}
    kick, jump, spin = np.max(kicks, axis=0)
    return {"kick": float(kick), "jump_mm": 1e3 * float(jump), "spin_kick": float(spin)}


def _ground(found: Analysis) -> Figures:
    """The force of the ground: of each foot as the file says, else in sum as Newton asks for it in steady stance."""
    own = found.recording
    if own.force is None:
        return _pressure(found.wanted[found.stance] / found.weight) if found.stance.any() else {}
    phases = counted(own.frames, own.loop)
    force = own.force / found.weight
    values = _pressure(force[own.contact & phases[:, None]])
    lifted = phases[:, None] & ~_near(own.contact, own.loop)
    values["air_force_bw"] = float(np.max(np.linalg.norm(force[lifted], axis=-1))) if lifted.any() else 0.0
    if own.loop:
        mean = np.where(own.contact[..., None], force, 0.0).sum(axis=1)[phases].mean(axis=0)
        values["mean_vertical_off_bw"] = float(abs(mean[1] - 1.0))
        values["mean_horizontal_bw"] = float(np.hypot(mean[0], mean[2]))
    return values


def _pressure(force: Array) -> Figures:
    """Of forces (N, 3) [BW]: smallest and largest vertical part, share of pulling, friction where it presses."""
    if len(force) == 0:
        return {}
    vertical, level = force[:, 1], np.hypot(force[:, 0], force[:, 2])
    pressed = vertical > PRESSED
    values = {
        "vertical_min_bw": float(vertical.min()),
        "vertical_peak_bw": float(vertical.max()),
        "pulling_share": float(np.mean(vertical < -1e-6)),
    }
    return values | ({"friction": float(np.max(level[pressed] / vertical[pressed]))} if pressed.any() else {})


def _near(contact: Mask, loop: bool) -> Mask:
    """(T, 2) feet on the ground in a frame or in one of its neighbours."""
    before, after = np.roll(contact, 1, axis=0), np.roll(contact, -1, axis=0)
    before[0] = contact[-2] if loop else contact[0]
    after[-1] = contact[1] if loop else contact[-1]
    return contact | before | after


def _residual(what: str, values: Array, unit: str) -> Figures:
    """Root mean square and maximum of vectors (N, 3), by axis and of their length."""
    size = np.linalg.norm(values, axis=-1)
    found = {f"{what}_rms_{unit}": float(np.sqrt(np.mean(size**2))), f"{what}_max_{unit}": float(np.max(size))}
    for axis, column in zip("xyz", values.T, strict=True):
        found[f"{what}_{axis}_rms_{unit}"] = float(np.sqrt(np.mean(column**2)))
        found[f"{what}_{axis}_max_{unit}"] = float(np.max(np.abs(column)))
    return found


def _largest(vectors: Array) -> float:
    return float(np.max(np.linalg.norm(vectors, axis=-1)))
