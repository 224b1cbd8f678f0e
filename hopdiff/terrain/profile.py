"""Slopes and stairs: ground whose height changes in one direction only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from hopdiff.terrain.ground import Ground, direction, normal_of, points_of

EDGE = 0.01  # m; a sole keeps so far from an edge
BEND = math.tan(math.radians(5.0))  # change of gradient from which on a sole is not laid over a bend
INFINITE = 1e9  # m; how far the first and the last piece reach


@dataclass(frozen=True, eq=False)
class Profile(Ground):
    """Straight pieces one after the other.

    start: x and z [m] from which the way s along `heading` [rad] is counted. breaks: (B,) s at which pieces end [m],
    ascending. heights, gradients: (B + 1,) of the pieces: height at their beginning (of the first one at its end) [m],
    and its change with s.
    """

    start: tuple[float, float]
    heading: float
    breaks: Tensor
    heights: Tensor
    gradients: Tensor

    @property
    def stepped(self) -> bool:
        return bool(self._is_edge.any())

    def height(self, place: Tensor) -> Tensor:
        return self._height(self._way(place))

    def normal(self, place: Tensor) -> Tensor:
        gradient = self.gradients[self._piece(self._way(place))]
        return normal_of(gradient.unsqueeze(-1) * self._along)

    def height_over(self, place: Tensor, reach: float) -> Tensor:
        way = self._way(place)
        found = torch.maximum(self._height(way - reach), self._height(way + reach))
        first, last = self._piece(way - reach), self._piece(way + reach)
        # Pieces are straight: between both ends the highest place is on one of the sides of a break.
        top = torch.maximum(self.heights[1:], self._at(torch.arange(len(self.breaks)), self.breaks))
        for k in range(int((last - first).max()) if way.numel() else 0):
            inside = first + k < last
            found = torch.where(inside, torch.maximum(found, top[(first + k).clamp_max(len(top) - 1)]), found)
        return found

    def footing(self, place: Tensor, heading: Tensor, ahead: float, behind: float) -> Tensor:
        way, share = self._way(place), direction(heading) @ self._along
        low, high = torch.minimum(ahead * share, -behind * share), torch.maximum(ahead * share, -behind * share)
        edges = self.breaks[self._is_edge]
        ends = torch.cat((edges.new_tensor([-INFINITE]), edges, edges.new_tensor([INFINITE])))
        climbs = self._jump[self._is_edge] >= 0.0
        # Whether the ground beyond the lower and the upper end of a tread is higher than the tread.
        higher_before = torch.cat((climbs.new_zeros(1), ~climbs))
        higher_after = torch.cat((climbs, climbs.new_zeros(1)))
        middle = torch.searchsorted(edges, way, right=True)
        best = torch.full_like(way, math.inf)
        for k in (-1, 0, 1):
            tread = (middle + k).clamp(0, len(edges))
            lower, upper = ends[tread] - low + EDGE, ends[tread + 1] - high - EDGE
            # A sole that is longer than its tread keeps out of the higher of both sides.
            hanging = torch.where(
                higher_before[tread], lower, torch.where(higher_after[tread], upper, 0.5 * (lower + upper))
            )
            wanted = torch.where(lower <= upper, way.clamp(lower, upper), hanging)
            best = torch.where((wanted - way).abs() < best.abs(), wanted - way, best)
        return best.unsqueeze(-1) * self._along

    @property
    def _along(self) -> Tensor:
        return direction(torch.tensor(self.heading))

    @property
    def _jump(self) -> Tensor:
        """(B,) by how much the ground rises at each break [m]."""
        return self.heights[1:] - self._at(torch.arange(len(self.breaks)), self.breaks)

    @property
    def _is_edge(self) -> Tensor:
        """(B,) whether a sole must not lie over a break: a step, or a bend."""
        return (self._jump.abs() > 1e-3) | (self.gradients.diff().abs() > BEND)

    def _way(self, place: Tensor) -> Tensor:
        here = points_of(place)
        found: Tensor = (here - here.new_tensor(self.start)) @ self._along
        return found

    def _piece(self, way: Tensor) -> Tensor:
        return torch.searchsorted(self.breaks, way.contiguous(), right=True)

    def _height(self, way: Tensor) -> Tensor:
        return self._at(self._piece(way), way)

    def _at(self, piece: Tensor, way: Tensor) -> Tensor:
        """Height of pieces, or of the lines that they lie on, at s."""
        origin = self.breaks[(piece - 1).clamp_min(0)]
        return self.heights[piece] + self.gradients[piece] * (way - origin)


def slope(angle: float, heading: float, start: tuple[float, float], length: float | None = None) -> Profile:
    """Ground that rises by an angle [rad], negative downwards, in the direction of `heading` [rad] from `start` on [m].

    length: of the slope as seen from above [m], after which the ground is level again; None for no end.
    """
    gradient = math.tan(angle)
    breaks, heights, gradients = [0.0], [0.0, 0.0], [0.0, gradient]
    if length is not None:
        breaks.append(length)
        heights.append(gradient * length)
        gradients.append(0.0)
    return Profile(start, heading, *(torch.tensor(one, dtype=torch.float64) for one in (breaks, heights, gradients)))


def stairs(rise: float, run: float, heading: float, start: tuple[float, float], steps: int) -> Profile:
    """Steps of a height (negative downwards) and a depth [m] in the direction of `heading` [rad].

    start: a place at the foot of the first riser [m]. steps: how many risers there are; the last leads on level ground.
    """
    number = torch.arange(steps, dtype=torch.float64)
    heights = rise * torch.arange(steps + 1, dtype=torch.float64)
    return Profile(start, heading, run * number, heights, torch.zeros_like(heights))
