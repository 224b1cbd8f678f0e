"""What the joints do: torques and powers from the movement and the ground force (inverse dynamics).

Per unit of body mass. A joint's torque is what the segments beyond it need, given the ground force on the foot among
them; it is told by the axes of the segment above: flexion (left), turn (up), sideways (forward).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.layout import FEET, PARENTS
from hopdiff.whole_body.movement import Body, Movement


@dataclass(frozen=True, eq=False)
class Dynamics:
    """torque, rate: (P, S - 1, 3, M) of the joints that hold the segments after the pelvis [m^2/s^2, rad/s].

    torque_rate: (P, S - 1, 3, M) its derivative [m^2/s^3]. residual: (P, 3, M) moment about the pelvis that is left
    over [m^2/s^2].
    """

    torque: Tensor
    rate: Tensor
    torque_rate: Tensor
    residual: Tensor


def dynamics(movement: Movement, body: Body) -> Dynamics:
    """The joints' torques of a body whose movement is solved."""
    grid, layout = movement.grid, movement.layout
    com = body.carried.com.unsqueeze(1)
    centres, joints = body.centres - com, body.joints - com
    acceleration = grid.derivative(grid.derivative(body.centres))
    up = acceleration.new_tensor((0.0, GRAVITY, 0.0))[:, None]
    force = movement.shares[:, None, None] * (acceleration + up)
    frames = body.frames
    first = grid.derivative(frames)
    second = grid.derivative(first)
    spin = torch.einsum("sk,pskim->psim", movement.spread, torch.linalg.cross(frames, second, dim=3))
    moment = torch.linalg.cross(centres, force, dim=2) + spin
    ground = body.carried.force
    pushed = torch.linalg.cross(body.carried.cop - com, ground, dim=2)
    feet = torch.zeros_like(force)
    feet[:, FEET] = ground
    around = torch.zeros_like(moment)
    around[:, FEET] = pushed
    below = layout.above.T
    force = torch.einsum("sd,pdim->psim", below, force - feet)
    moment = torch.einsum("sd,pdim->psim", below, moment - around)
    torque = moment - torch.linalg.cross(joints, force, dim=2)
    omega = 0.5 * torch.linalg.cross(frames, first, dim=3).sum(2)
    holders = list(PARENTS[1:])
    axes = frames[:, holders]
    own = torch.einsum("pskim,psim->pskm", axes, torque[:, 1:])
    rate = torch.einsum("pskim,psim->pskm", axes, omega[:, 1:] - omega[:, holders])
    return Dynamics(own, rate, grid.derivative(own), torque[:, 0])


ANKLES = slice(FEET.start - 1, FEET.stop - 1)  # among the joints after the pelvis
