"""What can be read off one stride: times, heights, forces, angles. `measured` does it for a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from experiments.realism.angles import angles, centre_of_mass, forward, mid_hip, other, place
from experiments.realism.recording import Array, Recording, read
from experiments.realism.strides import Stride, captured_strides, whole_stride

GRAVITY = 9.81  # m/s²
SAMPLES = 200  # of a curve over a stride, from touchdown on, the next touchdown left out
STRAIGHT = 15.0  # deg by which the way of a captured stride may turn
LEVEL = (0.3, 0.5)  # share of its contact in which a captured foot is taken to be level
CURVES = ("thigh", "knee", "ankle", "foot")
Row = dict[str, float]


@dataclass(frozen=True)
class Measured:
    """name: of the file, for captured clips with the number of the stride. row: numbers by name (NaN: not known).
    curves: thigh, knee, ankle, foot (SAMPLES,) [deg] of the leading leg over the stride. about: what a run's file
    says about itself."""

    name: str
    row: Row
    curves: dict[str, Array]
    about: dict[str, object]


def measured(path: Path) -> Measured:
    """The stride of a run's file. Raises ValueError if it does not hold one from left touchdown to the next."""
    recording = read(path)
    return measured_stride(recording, whole_stride(recording))


def measured_clip(path: Path) -> tuple[list[Measured], list[str]]:
    """The whole strides of a captured clip, and why others are left out: who turns has no way to measure against."""
    recording = read(path)
    found, left_out = [], []
    for number, stride in enumerate(captured_strides(recording), 1):
        name, turn = f"{recording.name} {number} ({stride.lead})", turned(recording, stride)
        if turn > STRAIGHT:
            left_out.append(f"{name} is left out: its way turns by {turn:.0f} degrees within the stride.")
        elif stride.contact >= stride.time / 2:
            left_out.append(f"{name} is left out: it is no run, a foot is always on the ground.")
        else:
            found.append(measured_stride(recording, stride, name))
    return found, left_out


def turned(recording: Recording, stride: Stride) -> float:
    """deg between the ways of the first and the second half of a stride"""
    middle = (stride.start + stride.end) / 2
    first, second = forward(recording, stride.start, middle), forward(recording, middle, stride.end)
    return float(np.degrees(np.arccos(np.clip(first @ second, -1.0, 1.0))))


def measured_stride(recording: Recording, stride: Stride, name: str = "") -> Measured:
    ahead = forward(recording, stride.start, stride.end)
    found = angles(recording, ahead)
    row = {
        **timing(recording, stride),
        **dynamics(recording, stride),
        **legs(recording, stride, found),
        **trunk(recording, stride, found),
        **arms(recording, stride, found),
        "step_width": step_width(recording, stride, ahead),
    }
    return Measured(name or recording.name, row, curves(recording, stride, found), dict(recording.numbers))


def at(recording: Recording, values: Array, moment: float) -> float:
    """A value (T,) at a moment [s] of the recording"""
    return float(np.interp(moment, recording.times, values))


def during(recording: Recording, values: Array, start: float, end: float) -> Array:
    """Values (T,) from one moment [s] to another, both included: those of the frames and the two ends."""
    times = recording.times
    moments = np.concatenate(([start], times[(times > start) & (times < end)], [end]))
    return np.interp(moments, times, values)


def sampled(recording: Recording, values: Array, stride: Stride) -> Array:
    """(SAMPLES,) values over the stride, evenly in time"""
    moments = stride.start + stride.time * np.arange(SAMPLES) / SAMPLES
    return np.interp(moments, recording.times, values)


def timing(recording: Recording, stride: Stride) -> Row:
    """speed [m/s], contact_time, flight_time [s], steps_per_second."""
    hips = mid_hip(recording)
    way = (place(recording, hips, stride.end) - place(recording, hips, stride.start)) * (1, 0, 1)
    step = stride.time / 2
    return {
        "speed": float(np.linalg.norm(way)) / stride.time,
        "contact_time": stride.contact,
        "flight_time": step - stride.contact,
        "flight_share": 1.0 - stride.contact / step,
        "steps_per_second": 1.0 / step,
    }


def dynamics(recording: Recording, stride: Stride) -> Row:
    """bounce [m]; peak_force [body weights]; external_work: positive work on the centre of mass by m g distance;
    force_gap: root mean square over the frames of the difference between the force and what the centre of mass of
    the segments does [body weights]; place_gap: farthest that a joint is from where the file puts it [m]."""
    com = centre_of_mass(recording)
    row = dict.fromkeys(("peak_force", "external_work", "force_gap", "place_gap"), np.nan)
    row["bounce"] = float(np.ptp(during(recording, com[:, 1], stride.start, stride.end)))
    if recording.stored is not None:
        row["place_gap"] = float(np.linalg.norm(recording.positions - recording.stored, axis=-1).max())
    if recording.force is None or recording.masses is None:
        return row
    total = recording.force.sum(axis=1) / (recording.masses.sum() * GRAVITY)
    row["peak_force"] = float(total[:, 1].max())
    step = recording.frame_time
    # The motion goes on as it began: one more frame at either end.
    way = com[-1] - com[0]
    longer = np.concatenate((com[-2:-1] - way, com, com[1:2] + way))
    rate = (longer[2:] - longer[:-2]) / (2 * step)
    energy = GRAVITY * com[:, 1] + (rate**2).sum(axis=-1) / 2
    row["external_work"] = float(np.diff(energy).clip(min=0.0).sum() / (GRAVITY * np.linalg.norm(way[[0, 2]])))
    if recording.centres is not None:
        pull = (longer[2:] - 2 * com + longer[:-2]) / step**2 / GRAVITY + (0.0, 1.0, 0.0)
        row["force_gap"] = float(np.sqrt(((pull - total)[:-1] ** 2).sum(axis=-1).mean()))
    return row


def legs(recording: Recording, stride: Stride, found: dict[str, Array]) -> Row:
    """Flexion of the leading knee at touchdown and take-off, its greatest in stance and swing [deg]; foot_touchdown:
    pitch of the foot, toes up positive [deg]."""
    knee = found[f"{stride.lead}_knee"]
    return {
        "knee_touchdown": at(recording, knee, stride.start),
        "knee_stance": float(during(recording, knee, stride.start, stride.take_off).max()),
        "knee_take_off": at(recording, knee, stride.take_off),
        "knee_swing": float(during(recording, knee, stride.take_off, stride.end).max()),
        "foot_touchdown": at(recording, level_foot(recording, stride, found), stride.start),
    }


def level_foot(recording: Recording, stride: Stride, found: dict[str, Array]) -> Array:
    """(T,) pitch of the leading foot against a level one [deg]"""
    pitch = found[f"{stride.lead}_foot"]
    if recording.level_feet:
        return pitch
    first, last = (stride.start + share * (stride.take_off - stride.start) for share in LEVEL)
    return pitch - float(np.median(during(recording, pitch, first, last)))


def curves(recording: Recording, stride: Stride, found: dict[str, Array]) -> dict[str, Array]:
    """thigh, knee, ankle, foot (SAMPLES,) [deg]; ankle = foot - thigh + knee."""
    thigh, knee = (sampled(recording, found[f"{stride.lead}_{part}"], stride) for part in ("thigh", "knee"))
    foot = sampled(recording, level_foot(recording, stride, found), stride)
    return {"thigh": thigh, "knee": knee, "ankle": foot - thigh + knee, "foot": foot}


def trunk(recording: Recording, stride: Stride, found: dict[str, Array]) -> Row:
    """Ranges of pelvis and thorax [deg]; pelvis_yaw_touchdown: against its mean, positive where the side that lands
    is ahead; pelvis_drop: how much higher the standing side is in its stances than the other, against the mean, the
    swinging side lower if positive; yaw_together: correlation of thorax with pelvis; lean [deg]."""
    sign = 1.0 if stride.lead == "left" else -1.0
    pelvis, thorax = (steady(sign * sampled(recording, found[f"{part}_yaw"], stride)) for part in ("pelvis", "thorax"))
    roll = sign * found["pelvis_roll"]
    own = during(recording, roll, stride.start, stride.take_off).mean()
    others = during(recording, roll, stride.other_touchdown, min(stride.other_take_off, recording.times[-1])).mean()
    return {
        "pelvis_yaw_range": float(np.ptp(pelvis)),
        "pelvis_yaw_touchdown": float(pelvis[0]),
        "pelvis_drop_range": float(np.ptp(sampled(recording, roll, stride))),
        "pelvis_drop": float(own - others) / 2,
        "thorax_yaw_range": float(np.ptp(thorax)),
        "yaw_together": correlation(thorax, pelvis),
        "lean": float(sampled(recording, found["lean"], stride).mean()),
    }


def steady(values: Array) -> Array:
    """Samples of a stride without their mean and without drift: the next one begins as this one did."""
    drift = values[-1] + (values[-1] - values[-2]) - values[0]
    straight = values - drift * np.arange(len(values)) / len(values)
    return straight - straight.mean()


def arms(recording: Recording, stride: Stride, found: dict[str, Array]) -> Row:
    """Both arms in the mean: arm_swing, range of the upper arm's attitude [deg]; arm_same_leg, arm_other_leg:
    correlation with the thigh of its own side and of the other; elbow_mean, elbow_range [deg]."""
    each = []
    for side in ("left", "right"):
        arm, elbow = (sampled(recording, found[f"{side}_{part}"], stride) for part in ("arm", "elbow"))
        same, opposite = (sampled(recording, found[f"{one}_thigh"], stride) for one in (side, other(side)))
        each.append((np.ptp(arm), correlation(arm, same), correlation(arm, opposite), elbow.mean(), np.ptp(elbow)))
    names = ("arm_swing", "arm_same_leg", "arm_other_leg", "elbow_mean", "elbow_range")
    return {name: float(value) for name, value in zip(names, np.mean(each, axis=0), strict=True)}


def correlation(first: Array, second: Array) -> float:
    """Pearson's r; NaN where one of them does not change."""
    first, second = first - first.mean(), second - second.mean()
    size = np.sqrt((first**2).sum() * (second**2).sum())
    return float((first * second).sum() / size) if size > 1e-9 else float("nan")


def step_width(recording: Recording, stride: Stride, ahead: Array) -> float:
    """m between the feet across the way, each half-way from ankle to ball in the middle of its stance."""
    middles = {
        stride.lead: (stride.start + stride.take_off) / 2,
        other(stride.lead): (stride.other_touchdown + stride.other_take_off) / 2,
    }
    first, second = (
        place(recording, (recording.point(f"{leg}_ankle") + recording.point(f"{leg}_toe")) / 2, moment)
        for leg, moment in middles.items()
    )
    return abs(float((first - second) @ np.cross((0.0, 1.0, 0.0), ahead)))
