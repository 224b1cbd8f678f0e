"""What the joints do: torques and powers from the movement and the ground force (inverse dynamics).

Per unit of body mass. A joint's torque is what the segments beyond it need, given the ground force on the foot among
them; it is told by the axes of the segment above: flexion (left), turn (up), sideways (forward).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.numerics import GRAVITY, constant, cross
from hopdiff.whole_body.layout import COUNT, FEET, PARENTS
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
    up = constant((0.0, GRAVITY, 0.0), com.dtype, com.device)[:, None]
    force = movement.shares[:, None, None] * (acceleration + up)
    frames = body.frames
    first = grid.derivative(frames)
    second = grid.derivative(first)
    spin = cross(movement.spread[:, :, None, None] * frames, second, dim=3).sum(2)
    moment = cross(centres, force, dim=2) + spin
    ground = body.carried.force
    pushed = cross(body.carried.cop - com, ground, dim=2)
    # The ground acts on the feet.
    feet = (0, 0, 0, 0, FEET.start, COUNT - FEET.stop)
    needed = torch.cat((force - functional.pad(ground, feet), moment - functional.pad(pushed, feet)), dim=2)
    force, moment = (layout.above.T @ needed.flatten(2)).unflatten(2, (6, -1)).split(3, dim=2)
    torque = moment - cross(joints, force, dim=2)
    omega = 0.5 * cross(frames, first, dim=3).sum(2)
    holders = list(PARENTS[1:])
    axes = frames[:, holders]
    turned = torch.stack((torque[:, 1:], omega[:, 1:] - omega[:, holders]), dim=1)
    own, rate = (axes.unsqueeze(1) * turned.unsqueeze(3)).sum(4).unbind(1)
    return Dynamics(own, rate, grid.derivative(own), torque[:, 0])


ANKLES = slice(FEET.start - 1, FEET.stop - 1)  # among the joints after the pelvis
