"""Dimension letters, failure codes and the one error class that users see.

Shapes in docstrings use these letters:

    P  candidates of a population      T  frames of a clip
    N  nodes in time (per phase)       J  joints
    G  genes                           C  motion channels

Units are SI and radians unless a name ends in ``_deg`` or ``_bw`` (body weights).
World axes: x to the runner's left, y up, z forward (heading 0 = +z).
"""

from __future__ import annotations

import math
from enum import IntEnum


class HopdiffError(Exception):
    """Something the user can put right; its text is one sentence that names the culprit."""


def check_asked(speed: float, beta: float) -> None:
    """Raises HopdiffError if speed [m/s] is not positive and finite, or beta not in [0, 1)."""
    if not (math.isfinite(speed) and speed > 0):
        raise HopdiffError(f"speed must be a positive number of m/s, not {speed}.")
    if not (math.isfinite(beta) and 0.0 <= beta < 1.0):
        raise HopdiffError(f"beta must be at least 0 and below 1, not {beta}.")


class Status(IntEnum):
    """Why a candidate cannot run; 0 means that it can."""

    OK = 0
    STANCE_UNSOLVED = 1
    LEG_COLLAPSED = 2
    LEG_OVERREACH = 3
    LEG_FORCE = 4
    FOOT_UNDERGROUND = 5
    JOINT_LIMIT = 6
    BALANCE_UNSTABLE = 7
    NOT_FINITE = 8
    NO_FLIGHT = 9
    PULLED_DOWN = 10
    SLIPPERY = 11
    LEGS_MEET = 12
    NOT_CLOSED = 13

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.OK: "The candidate is a possible run.",
    Status.STANCE_UNSOLVED: "No stance was found that bounces back with the speed it came with.",
    Status.LEG_COLLAPSED: "The stance leg folds further than the knee allows.",
    Status.LEG_OVERREACH: "The foot lies beyond the reach of the stretched leg.",
    Status.LEG_FORCE: "The stance leg would have to push harder than the body can bear.",
    Status.FOOT_UNDERGROUND: "A foot passes below the ground.",
    Status.JOINT_LIMIT: "A joint leaves its range.",
    Status.BALANCE_UNSTABLE: "The balance gains push the body away from its support.",
    Status.NOT_FINITE: "The motion holds a number that is not finite.",
    Status.NO_FLIGHT: "The leg gives too little lift for a flight phase.",
    Status.PULLED_DOWN: "The ground would have to hold a foot down.",
    Status.SLIPPERY: "A foot needs more friction than the ground has.",
    Status.LEGS_MEET: "The legs run into each other.",
    Status.NOT_CLOSED: "No motion was found in which the body does what its momentum asks.",
}
