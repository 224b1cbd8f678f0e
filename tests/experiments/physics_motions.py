"""Motions whose physics is known, as the arrays of a run's NumPy archive."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

GRAVITY = 9.81
STEP = 1.0 / 960.0
Arrays = dict[str, Any]


def about_x(angles: np.ndarray) -> np.ndarray:
    """Quaternions x y z w."""
    return Rotation.from_rotvec(np.asarray(angles)[:, None] * np.array([1.0, 0.0, 0.0])).as_quat()


def thrown(times: np.ndarray) -> np.ndarray:
    """Centre of mass of a thrown body (T, 3) [m]."""
    return np.stack((0.2 * times, 1.0 + 2.0 * times - 0.5 * GRAVITY * times**2, 3.0 * times), axis=-1)


def tumbling(gravity: float = GRAVITY) -> Arrays:
    """Three segments locked at odd angles, tumbling freely: Euler's equations of the same body made of points."""
    times = STEP * np.arange(300)
    names = np.array(["pelvis", "waist", "left_hip"])
    offsets = np.array([[0.0, 0.0, 0.0], [0.05, 0.3, 0.02], [0.1, -0.1, 0.05]])
    locked = Rotation.from_euler("xyz", [[0, 0, 0], [40, 20, -30], [-60, 10, 25]], degrees=True)
    masses = np.array([20.0, 30.0, 9.0])
    centres = np.array([[0.01, 0.1, -0.02], [0.0, 0.2, 0.03], [0.02, -0.2, 0.01]])
    inertias = np.array([[0.3, 0.2, 0.25], [0.9, 0.5, 0.8], [0.2, 0.03, 0.19]])
    # Each segment as six points on its axes with the same moments.
    squares = 1.5 * (inertias.sum(axis=1, keepdims=True) / 2 - inertias) * 2 / masses[:, None]
    arms = np.concatenate([np.eye(3), -np.eye(3)])[None] * np.sqrt(np.tile(squares, (1, 2)))[..., None]
    points = np.concatenate(
        [offsets[s] + locked[s].apply(centres[s] + arms[s]) if s else centres[s] + arms[s] for s in range(3)]
    )
    weights = np.repeat(masses / 6.0, 6)
    com = weights @ points / weights.sum()
    about = points - com
    whole = np.einsum(
        "p,pij->ij", weights, (about**2).sum(-1)[:, None, None] * np.eye(3) - about[:, :, None] * about[:, None]
    )

    def euler(_: float, state: np.ndarray) -> np.ndarray:
        turn, spin = state[:4], state[4:]
        x, y, z, w = turn
        change = 0.5 * np.array(
            [
                [w, -z, y],
                [z, w, -x],
                [-y, x, w],
                [-x, -y, -z],
            ]
        )
        return np.concatenate((change @ spin, np.linalg.solve(whole, np.cross(whole @ spin, spin))))

    start = np.array([0.0, 0.0, 0.0, 1.0, 4.0, 3.0, -5.0])
    solved = solve_ivp(euler, (0, times[-1]), start, "DOP853", times, rtol=1e-11, atol=1e-12)
    turns = solved.y[:4].T
    path = thrown(times) - 0.5 * (gravity - GRAVITY) * times[:, None] ** 2 * np.array([0.0, 1.0, 0.0])
    rotations = np.stack([turns, *(np.tile(locked[s].as_quat(), (len(times), 1)) for s in (1, 2))], axis=1)
    return {
        "names": names,
        "parents": np.array([-1, 0, 0]),
        "offsets": offsets,
        "frame_time": np.array(STEP),
        "loop": np.array(False),
        "root_position": path - Rotation.from_quat(turns).apply(com),
        "rotations": rotations,
        "contact": np.zeros((len(times), 2), dtype=bool),
        "segments": names,
        "masses": masses,
        "centres": centres,
        "inertias": inertias,
        "end_names": np.array([], dtype=str),
        "ends": np.zeros((0, 3)),
    }


def scissors() -> Arrays:
    """Two thighs on one axle that open and close in the air while the whole turns with constant angular momentum."""
    times = STEP * np.arange(400)
    mass, length, inertia, momentum = 10.0, 0.25, 0.15, 8.0

    def opening(t: Any) -> Any:
        return 0.2 + 0.9 * np.sin(9.0 * t) ** 2

    def turned(t: float, _: Any) -> list[float]:
        # The centre of mass lies on the line that halves the opening.
        apart = length * np.sin(opening(t))
        return [momentum / (2.0 * (inertia + mass * apart**2))]

    middle = solve_ivp(turned, (0, times[-1]), [0.3], "DOP853", times, rtol=1e-12, atol=1e-12).y[0]
    inward = length * np.cos(opening(times))
    com = inward[:, None] * np.stack((np.zeros_like(times), -np.cos(middle), -np.sin(middle)), axis=-1)
    names = np.array(["pelvis", "left_hip", "right_hip"])
    angles = np.stack((np.zeros_like(times), middle + opening(times), middle - opening(times)), axis=1)
    return {
        "names": names,
        "parents": np.array([-1, 0, 0]),
        "offsets": np.zeros((3, 3)),
        "frame_time": np.array(STEP),
        "loop": np.array(False),
        "root_position": thrown(times) - com,
        "contact": np.zeros((400, 2), dtype=bool),
        "rotations": about_x(angles.ravel()).reshape(400, 3, 4),
        "segments": names[1:],
        "masses": np.full(2, mass),
        "centres": np.array([[0.0, -length, 0.0]] * 2),
        "inertias": np.array([[inertia, 0.02, inertia]] * 2),
        "end_names": np.array([], dtype=str),
        "ends": np.zeros((0, 3)),
    }


MASS, SPEED, STEP_TIME, CONTACT, WHEEL = 70.0, 3.5, 0.35, 0.22, 0.3  # kg, m/s, s, s, m
OFF, FLYWHEEL = 0.01, 1.2  # m, kg m^2
WEIGHT = MASS * GRAVITY
PEAK, BRAKE = 0.5 * np.pi * STEP_TIME / CONTACT * WEIGHT, 0.4375 * WEIGHT  # N


def run(frames: int = 673, brake: float = BRAKE, skate: float = 0.0, burst: float = 0.0, yaw: float = 0.0) -> Arrays:
    """A stride whose force is written down and whose path follows; its feet are wheels that roll under the force.

    skate [m/s]: by how much the wheels roll too slowly in stance. burst [m/s]: by how much faster the body moves in
    flight than its forces say. yaw [rad/s]: of the pelvis in flight, to the left and back again.
    """
    times = np.linspace(0.0, 2.0 * STEP_TIME, frames)
    count = np.minimum(np.floor(times / STEP_TIME + 1e-12), 2).astype(int)
    since = times - count * STEP_TIME
    stands = since < CONTACT
    s, air = np.where(stands, since / CONTACT, 1.0), np.maximum(since - CONTACT, 0.0)
    rise = -0.5 * GRAVITY * (STEP_TIME - CONTACT)
    w = CONTACT / np.pi
    height = 0.95 + rise * since - 0.5 * GRAVITY * since**2
    height = height + PEAK / MASS * np.where(stands, w * since - w**2 * np.sin(np.pi * s), w * CONTACT + 2 * w * air)
    ahead = brake / MASS * (CONTACT / (2 * np.pi)) * (CONTACT / (2 * np.pi) * np.sin(2 * np.pi * s) - s * CONTACT)
    advance = SPEED * STEP_TIME - brake / MASS * CONTACT**2 / (2 * np.pi) + burst * (STEP_TIME - CONTACT)
    com = np.stack((0 * times, height, count * advance + SPEED * since + ahead + burst * air), axis=-1)
    lever = np.where(stands, com[:, 1] * 2 * brake / PEAK * np.cos(np.pi * s), 0.0)
    # A flywheel within answers the moment of a force that passes behind the centre of mass on the left foot, ahead of
    # it on the right one.
    push = np.where(count % 2 == 0, -OFF, OFF)
    lever, rate = lever + np.where(stands, push, 0.0), push * PEAK / FLYWHEEL * w
    begun = np.where(count % 2 == 0, 0.0, -OFF * PEAK / FLYWHEEL * w * (CONTACT - STEP_TIME))
    wheel = begun + rate * np.where(stands, w * np.sin(np.pi * s), -air)
    cop = com * np.array([0.0, 0.0, 1.0]) + lever[:, None] * np.array([0.0, 0.0, 1.0])
    mid = count * advance + 0.5 * SPEED * CONTACT - 0.5 * brake / MASS * CONTACT**2 / (2 * np.pi)
    contact = np.stack((stands & (count % 2 == 0), stands & (count == 1)), axis=-1)
    force = np.stack((0 * s, PEAK * np.sin(np.pi * s), -brake * np.sin(2 * np.pi * s)), axis=-1)
    # Two arms that swing against each other move the centre of mass up and down and carry no angular momentum.
    swing = 0.6 * np.sin(2 * np.pi * times / times[-1])
    shares = np.array([40.0, 20.0, 5.0, 5.0]) / MASS
    within = (shares[0] + shares[1]) * 0.1 + 2 * shares[2] * (0.3 - 0.25 * np.cos(swing))
    root = com - within[:, None] * np.array([0.0, 1.0, 0.0])
    turned = yaw * np.where(count % 2 == 0, air, np.where(count == 1, STEP_TIME - CONTACT - air, 0.0))
    pelvis = Rotation.from_rotvec(turned[:, None] * np.array([0.0, 1.0, 0.0]))
    names = ["pelvis", "waist", "left_shoulder", "right_shoulder", "left_ankle", "left_toe", "right_ankle", "right_toe"]
    offsets, rotations = np.zeros((frames, 8, 3)), np.zeros((frames, 8, 4))
    rotations[..., 3] = 1.0
    rotations[:, 0], rotations[:, 1] = pelvis.as_quat(), about_x(wheel)
    rotations[:, 2], rotations[:, 3] = about_x(swing), about_x(-swing)
    offsets[:, 1], offsets[:, 2:4], offsets[:, [5, 7]] = (0.0, 0.1, 0.0), (0.0, 0.3, 0.0), (0.0, -0.05, 0.12)
    for side, joint in ((0, 4), (1, 6)):
        down = contact[:, side]
        place = np.stack((0 * times, np.where(down, WHEEL, WHEEL + 0.1), np.where(down, cop[:, 2], com[:, 2])), axis=-1)
        roll = np.where(down, (cop[:, 2] - mid - skate * since) / WHEEL, 0.0)
        offsets[:, joint] = pelvis.inv().apply(place - root)
        rotations[:, joint] = (pelvis.inv() * Rotation.from_quat(about_x(roll))).as_quat()
    return {
        "names": np.array(names),
        "parents": np.array([-1, 0, 0, 0, 0, 4, 0, 6]),
        "offsets": offsets[0],
        "moving_offsets": offsets,
        "frame_time": times[1],
        "loop": np.array(True),
        "root_position": root,
        "rotations": rotations,
        "contact": contact,
        "segments": np.array(names[:4]),
        "masses": MASS * shares,
        "centres": np.array([[0, 0.1, 0], [0, 0, 0], [0, -0.25, 0], [0, -0.25, 0]]),
        "inertias": np.array([[0.8, 0.4, 1.0], [FLYWHEEL, 0.5, 1.2], [0.05, 0.01, 0.05], [0.05, 0.01, 0.05]]),
        "end_names": np.array(["left_toe", "right_toe"]),
        "ends": np.array([[0.0, 0.0, 0.06]] * 2),
        "heel": np.array([0.0, -0.05, -0.15]),
        "force": contact[..., None] * force[:, None],
        "cop": np.where(contact[..., None], cop[:, None], np.nan),
    }


def shifted(points: np.ndarray, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """Points (..., 3) moved by some metres."""
    return np.asarray(points) + np.array([x, y, z])


def begun_later(arrays: Arrays, frame: int) -> Arrays:
    """The same endless run, cut out from another frame of the stride on."""
    period = len(arrays["contact"]) - 1
    strides, within = np.divmod(np.arange(frame, frame + period + 1), period)
    moved = {name: values[within] for name, values in arrays.items() if np.shape(values)[:1] == (period + 1,)}
    travel = (arrays["root_position"][-1] - arrays["root_position"][0]) * np.array([0.0, 0.0, 1.0])
    moved["root_position"] = moved["root_position"] + strides[:, None] * travel
    moved["cop"] = moved["cop"] + strides[:, None, None] * travel
    return arrays | moved
