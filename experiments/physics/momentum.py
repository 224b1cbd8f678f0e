"""Momentum of a body of rigid segments, and what Newton and Euler ask for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.physics.frames import Mask, acceleration, rate, steady, turning
from experiments.physics.recording import GRAVITY, Array, Recording, carried, world

UP = np.array([0.0, 1.0, 0.0])
UNLOADED = 1e-3  # body weights below which a place of no force may be missing


@dataclass(frozen=True, eq=False)
class Analysis:
    """A recording and what follows from it, frame by frame.

    places (T, J, 3) [m] and turns (T, J, 3, 3) of the joints. com (T, 3) [m], velocity [m/s]. wanted: (T, 3) force
    that the ground must give, m (a + g) [N]. spin: (T, 3) angular momentum about the centre of mass [kg m^2/s];
    wanted_moment: its rate [Nm]. given, given_moment: (T, 3) the force and the moment about the centre of mass of the
    feet on the ground as the file says [N, Nm], None where it does not. steady: (T,) frames far from touchdown and
    take-off; flight: those with no foot on the ground; stance: the others.
    """

    recording: Recording
    places: Array
    turns: Array
    com: Array
    velocity: Array
    wanted: Array
    spin: Array
    wanted_moment: Array
    given: Array | None
    given_moment: Array | None
    steady: Mask
    flight: Mask
    stance: Mask

    @property
    def weight(self) -> float:
        return self.recording.mass * GRAVITY

    def joint(self, name: str) -> tuple[Array, Array]:
        """Place (T, 3) [m] and turn (T, 3, 3) of a joint in the world."""
        index = self.recording.names.index(name)
        return self.places[:, index], self.turns[:, index]


def analyse(recording: Recording) -> Analysis:
    """Centre of mass, momenta and their rates, by central differences."""
    step, loop, travel = recording.frame_time, recording.loop, recording.travel
    places, turns = world(recording)
    own = [recording.names.index(name) for name in recording.segments]
    turned = turns[:, own]
    centres = places[:, own] + carried(turned, recording.centres)
    shares = recording.masses / recording.mass
    com = np.einsum("s,tsi->ti", shares, centres)
    velocity = rate(com, step, loop, travel)
    spin = _spin(recording, turned, centres - com[:, None], rate(centres, step, loop, travel) - velocity[:, None])
    calm = steady(recording.contact, recording.margin, loop)
    standing = recording.contact.any(axis=1)
    given, moment = _given(recording, com)
    return Analysis(
        recording=recording,
        places=places,
        turns=turns,
        com=com,
        velocity=velocity,
        wanted=recording.mass * (acceleration(com, step, loop, travel) + GRAVITY * UP),
        spin=spin,
        wanted_moment=rate(spin, step, loop),
        given=given,
        given_moment=moment,
        steady=calm,
        flight=calm & ~standing,
        stance=calm & standing,
    )


def _spin(recording: Recording, turns: Array, arms: Array, velocities: Array) -> Array:
    """(T, 3) angular momentum about the centre of mass; arms and velocities (T, S, 3) relative to it."""
    rates = rate(turns, recording.frame_time, recording.loop)
    inertias = turns @ recording.inertias @ np.swapaxes(turns, -1, -2)
    orbital = recording.masses[:, None] * np.cross(arms, velocities)
    return (orbital + carried(inertias, turning(turns, rates))).sum(axis=1)


def _given(recording: Recording, com: Array) -> tuple[Array | None, Array | None]:
    """Sums over the feet on the ground of the file's force (T, 3) and of its moment about the centre of mass."""
    if recording.force is None or recording.cop is None:
        return None, None
    force = np.where(recording.contact[..., None], recording.force, 0.0)
    light = np.linalg.norm(force, axis=-1) < UNLOADED * recording.mass * GRAVITY
    # A foot in the air has no place of its force, and one that does not press yet or any more need not have one.
    absent = ~recording.contact | (light & ~np.isfinite(recording.cop).all(axis=-1))
    arm = np.where(absent[..., None], 0.0, recording.cop - com[:, None])
    return force.sum(axis=1), np.cross(arm, force).sum(axis=1)
