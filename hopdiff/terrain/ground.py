"""What feet stand on: heights over the ground plane, and where a sole fits."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import cache

import torch
from torch import Tensor

SAMPLES = 48  # that a mean height is taken of
AT_ONCE = 16384  # places whose mean heights are looked up together
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))  # rad
HALF_WIDTH = 0.04  # m; of a sole


class Ground(ABC):
    """A surface over the whole ground plane, x to the left and z forward; everything in float64.

    Places are x and z [m], headings angles from +z towards +x [rad]. Where the surface has edges, `footing` keeps feet
    off them, `height_over` swings over them, and `mean_height` is what a body follows.
    """

    @property
    def flat(self) -> bool:
        """Whether it is level at height 0 everywhere, so that nothing needs to be done."""
        return False

    @property
    def stepped(self) -> bool:
        """Whether there are steps in it, which feet must get over."""
        return False

    @abstractmethod
    def height(self, place: Tensor) -> Tensor:
        """(...) height [m] at places (..., 2)."""

    @abstractmethod
    def normal(self, place: Tensor) -> Tensor:
        """(..., 3) unit normal, up, at places (..., 2); on an edge that of one of its sides."""

    @abstractmethod
    def height_over(self, place: Tensor, reach: float) -> Tensor:
        """(...) a height [m] that nothing exceeds within `reach` [m] of places (..., 2): what a foot swings over."""

    def footing(self, place: Tensor, heading: Tensor, ahead: float, behind: float) -> Tensor:
        """(N, 2) the least shift [m] that brings feet wholly on one tread.

        place: (N, 2) of the feet. heading: (N,). ahead, behind: how far a sole reaches from there to its toes and its
        heel [m]. Zero where the sole lies over no edge. Where treads are shorter than soles, the sole stays out of the
        higher one and overhangs the lower.
        """
        return torch.zeros_like(points_of(place))

    def mean_height(self, place: Tensor, reach: float) -> Tensor:
        """(...) mean height within `reach` [m] of places (..., 2) [m]: without steps, for a pelvis to follow."""
        here = points_of(place)
        around, flat = reach * _sunflower(), here.reshape(-1, 2)
        means = [self.height(some.unsqueeze(-2) + around).mean(-1) for some in flat.split(AT_ONCE)]
        return torch.cat(means).reshape(here.shape[:-1])

    def sole_normal(self, place: Tensor, heading: Tensor, ahead: float, behind: float) -> Tensor:
        """(..., 3) unit normal, up, of the plane that a sole lies on: of the heights under its heel, toes and sides.

        place: (..., 2). heading: (...). ahead, behind: see `footing`.
        """
        here, along = points_of(place), direction(heading)
        aside = torch.stack((along[..., 1], -along[..., 0]), dim=-1)
        toe, heel = here + ahead * along, here - behind * along
        rise = (self.height(toe) - self.height(heel)) / (ahead + behind)
        sides = self.height(here + HALF_WIDTH * aside) - self.height(here - HALF_WIDTH * aside)
        gradient = rise.unsqueeze(-1) * along + (sides / (2.0 * HALF_WIDTH)).unsqueeze(-1) * aside
        return normal_of(gradient)

    def above(self, points: Tensor) -> Tensor:
        """(...) how far points (..., 3) in the world are above the ground below them [m]; negative where they sink."""
        points = points_of(points)
        return points[..., 1] - self.height(points[..., [0, 2]])


class Flat(Ground):
    """Level at height 0."""

    @property
    def flat(self) -> bool:
        return True

    def height(self, place: Tensor) -> Tensor:
        return torch.zeros_like(points_of(place)[..., 0])

    def normal(self, place: Tensor) -> Tensor:
        return normal_of(torch.zeros_like(points_of(place)))

    def height_over(self, place: Tensor, reach: float) -> Tensor:
        return self.height(place)


@cache
def _sunflower() -> Tensor:
    """(SAMPLES, 2) places that fill the unit disk evenly, no two of them in line (Vogel 1979)."""
    number = torch.arange(SAMPLES, dtype=torch.float64)
    angle, radius = GOLDEN * number, ((number + 0.5) / SAMPLES).sqrt()
    return radius.unsqueeze(-1) * torch.stack((torch.sin(angle), torch.cos(angle)), dim=-1)


def points_of(place: Tensor) -> Tensor:
    """Places or points as the ground reckons with them: float64 on the processor, without gradients."""
    return place.detach().cpu().double()


def direction(heading: Tensor) -> Tensor:
    """(..., 2) x and z of the unit vector of headings (...)."""
    heading = points_of(heading)
    return torch.stack((torch.sin(heading), torch.cos(heading)), dim=-1)


def normal_of(gradient: Tensor) -> Tensor:
    """(..., 3) unit normal, up, of a surface that rises by gradient (..., 2) in x and z."""
    x, z = gradient.unbind(-1)
    normal = torch.stack((-x, torch.ones_like(x), -z), dim=-1)
    found: Tensor = normal / normal.norm(dim=-1, keepdim=True)
    return found
