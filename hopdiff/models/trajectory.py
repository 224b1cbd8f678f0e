"""What a model hands to the costs: one step of every candidate, sampled in time."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

# Joint angles that cost energy, with the joint whose inertia they move and the axis they turn about
# (0 left: flexion, 1 up: yaw, 2 forward: sideways).
JOINT_CHANNELS: tuple[tuple[str, str, int], ...] = (
    ("left_thigh", "left_hip", 0),
    ("right_thigh", "right_hip", 0),
    ("left_knee", "left_knee", 0),
    ("right_knee", "right_knee", 0),
    ("left_tilt", "left_hip", 2),
    ("right_tilt", "right_hip", 2),
    ("pelvis_roll", "pelvis", 2),
    ("pelvis_yaw", "pelvis", 1),
    ("trunk_lean", "waist", 0),
    ("trunk_side", "waist", 2),
    ("trunk_yaw", "waist", 1),
    ("neck_flex", "neck", 0),
    ("neck_side", "neck", 2),
    ("left_shoulder", "left_shoulder", 0),
    ("right_shoulder", "right_shoulder", 0),
    ("left_abduction", "left_shoulder", 2),
    ("right_abduction", "right_shoulder", 2),
    ("left_elbow", "left_elbow", 0),
    ("right_elbow", "right_elbow", 0),
)
LEG_CHANNELS = 4  # the first four channels are the ones that connectivity compares at take-off


class Trajectory(NamedTuple):
    """One step (left stance and the flight after it) of P candidates at M moments; of a limp both steps in a row.

    Every step is described as if its left leg carried.
    weights: (P, M) [s], so that sum(weights * f) is the integral of f over all of it; zero where a moment is unused.
    angles: (P, M, C) in the order of JOINT_CHANNELS [rad]; accelerations: (P, M, C) [rad/s^2].
    rates_before, rates_after: (P, 4) leg joint rates predicted across take-off from the stance and found at the
        start of flight [rad/s], compared by connectivity; (P, 8) for two take-offs.
    balance_error: (P, M, 2) target minus actual centre of mass on the ground plane, left and forward [m].
    com_height: (P, M) [m]. foot_height: (P, K, 2) left and right contact point above the ground at K moments, dense
        enough that nothing dips between them [m].
    leg_force: (P, M) force along the stance leg in body weights, zero in flight.
    reach: (P,) longest stance leg in units of the straight leg. trunk_from_pelvis: (P, M) waist flexion [rad].
    contact_time, flight_time, speed: (P,), means over the steps [s, s, m/s]. sway_stiffness: (P,) of the fore-aft
        balance [1/s].
    pelvis_tilt: (P,) [rad]. solved: (P,) bool, whether the step exists at all.
    """

    weights: Tensor
    angles: Tensor
    accelerations: Tensor
    rates_before: Tensor
    rates_after: Tensor
    balance_error: Tensor
    com_height: Tensor
    foot_height: Tensor
    leg_force: Tensor
    reach: Tensor
    pelvis_tilt: Tensor
    contact_time: Tensor
    flight_time: Tensor
    speed: Tensor
    sway_stiffness: Tensor
    solved: Tensor

    @property
    def duration(self) -> Tensor:
        """Time that is covered (P,) [s]."""
        return self.weights.sum(-1)


def join_steps(both: Trajectory, side_stiffness: Tensor) -> Trajectory:
    """The trajectories (P) of whole strides from those (2 P) of their steps, left steps first.

    side_stiffness: (2 P,) of the sideways balance [1/s]. It has to hold the body too: nothing that one step does is
    undone by the mirror image of it.
    """

    def row(values: Tensor) -> Tensor:
        return torch.cat(values.chunk(2), dim=1)

    def mean(values: Tensor) -> Tensor:
        return torch.stack(values.chunk(2)).mean(0)

    along = ["weights", "angles", "accelerations", "rates_before", "rates_after", "balance_error"]
    along += ["com_height", "foot_height", "leg_force"]
    means = ("pelvis_tilt", "contact_time", "flight_time", "speed")
    return both._replace(
        **{name: row(getattr(both, name)) for name in along},
        **{name: mean(getattr(both, name)) for name in means},
        reach=torch.maximum(*both.reach.chunk(2)),
        sway_stiffness=torch.minimum(*torch.minimum(both.sway_stiffness, side_stiffness).chunk(2)),
        solved=torch.logical_and(*both.solved.chunk(2)),
    )
