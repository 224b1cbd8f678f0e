"""The way of the root joint over the ground, and its steps seen from the body itself (Kim & Lee 2021, eq. 1-4, 14).

Steps are taken in the frame of the root one frame earlier, so that a path that turns as a whole keeps its steps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation, unwrap


@dataclass(frozen=True)
class RootPath:
    """place: (..., T, 2) x and z of the root [m]. yaw: (..., T) where the body faces, from +z towards +x, without
    jumps [rad]."""

    place: Tensor
    yaw: Tensor

    @property
    def frames(self) -> int:
        return self.yaw.shape[-1]


def root_path(clip: Clip, rest_yaw: float = 0.0) -> RootPath:
    """The path of a clip's root, in float64. rest_yaw: where the body faces when the root is not turned [rad]."""
    turn = clip.rotations[:, 0].double()
    # The turn about y that comes nearest to the whole rotation: defined however the root leans.
    yaw = torch.atan2(turn[:, 0, 2] - turn[:, 2, 0], turn[:, 0, 0] + turn[:, 2, 2])
    return RootPath(clip.root_position[:, [0, 2]].double(), unwrap(yaw + rest_yaw))


def with_root_path(clip: Clip, before: RootPath, after: RootPath) -> Clip:
    """The clip led along another path: turned about y and moved over the ground; height, lean and pose stay.

    before: the path of the clip as `root_path` gives it. after: (T, 2) and (T,), of as many frames.
    """
    turn = axis_rotation("Y", after.yaw - before.yaw).to(clip.rotations)
    rotations = torch.cat(((turn @ clip.rotations[:, 0])[:, None], clip.rotations[:, 1:]), dim=1)
    height = clip.root_position[:, 1:2]
    place = after.place.to(clip.root_position)
    return replace(clip, root_position=torch.cat((place[:, :1], height, place[:, 1:]), dim=-1), rotations=rotations)


def raised(clip: Clip, rise: Tensor) -> Clip:
    """The clip with its root higher by (T,) [m]."""
    up = torch.stack((torch.zeros_like(rise), rise, torch.zeros_like(rise)), dim=-1)
    return replace(clip, root_position=clip.root_position + up.to(clip.root_position))


def steps_of(path: RootPath) -> Tensor:
    """(..., T - 1, 3) step to the left and step forward [m], and turn [rad], each frame from the one before."""
    moved = path.place.diff(dim=-2)
    yaw = path.yaw[..., :-1]
    c, s = torch.cos(yaw), torch.sin(yaw)
    x, z = moved.unbind(-1)
    return torch.stack((c * x - s * z, s * x + c * z, path.yaw.diff(dim=-1)), dim=-1)


def path_of(steps: Tensor, place: Tensor, yaw: Tensor) -> RootPath:
    """Steps (..., T - 1, 3) put together from a first place (..., 2) [m] and yaw (...) [rad] (eq. 14)."""
    turned = torch.cat((yaw.unsqueeze(-1), yaw.unsqueeze(-1) + steps[..., 2].cumsum(-1)), dim=-1)
    c, s = torch.cos(turned[..., :-1]), torch.sin(turned[..., :-1])
    left, ahead = steps[..., 0], steps[..., 1]
    moved = torch.stack((c * left + s * ahead, c * ahead - s * left), dim=-1).cumsum(-2)
    start = place.unsqueeze(-2)
    return RootPath(torch.cat((start, start + moved), dim=-2), turned)
