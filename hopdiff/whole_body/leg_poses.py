"""Legs: standing ones reach from hip to ankle, those in the air follow smooth curves from stance to stance."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.numerics import differentiation_matrix
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.places import Places, places_of
from hopdiff.whole_body.plan import Plan
from hopdiff.whole_body.support import Carried, Support
from hopdiff.whole_body.swing import ANKLE_MOMENTS, MOMENTS, swing_basis

LONGEST, SOFT = 0.9985, 0.0015  # of the straight leg: how far a leg reaches, and over what it gets there
SHORTEST = 0.35  # of the straight leg
SMOOTH = 1  # rates of leg angles that go on through touchdown and take-off by construction: the first
# In the air thigh, knee and tilt follow curves of their own, and the foot hangs from the shank at the ankle's angle:
# from thigh, knee, pitch of the foot and tilt to thigh, knee, ankle and tilt, and back.
_HUNG = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (-1.0, 1.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
_UNHUNG = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (1.0, -1.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0))


@lru_cache(maxsize=64)
def _ends(nodes: tuple[int, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """(K, 4) from values on the nodes of a contact to value and rate, in the time of their phase, at its end and at its
    start: what a swing begins and ends with."""
    size = sum(nodes)
    found = torch.zeros(size, 4, dtype=dtype, device=device)
    found[-1, 0] = found[0, 2] = 1.0
    found[size - nodes[-1] :, 1] = differentiation_matrix(nodes[-1], dtype, device)[-1]
    found[: nodes[0], 3] = differentiation_matrix(nodes[0], dtype, device)[0]
    return found


@lru_cache(maxsize=8)
def _hanging(dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    return torch.tensor(_HUNG, dtype=dtype, device=device), torch.tensor(_UNHUNG, dtype=dtype, device=device)


@lru_cache(maxsize=64)
def _order(plan: Plan, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor | None]:
    """(2 M,) which of the nodes of all contacts and swings, one after the other, each node of both sides is; and signs
    (4, 2 M) of thigh, knee, foot and tilt there, None where none changes."""
    size = sum(plan.nodes)
    index, sign, first = [0] * (2 * size), torch.ones(4, 2 * size, dtype=dtype, device=device), 0
    for contact in plan.contacts:
        for phases in (contact.phases, plan.swing(contact)):
            for piece in places_of(plan, contact.limb, phases, dtype, device):
                for k in range(piece.own.stop - piece.own.start):
                    node = piece.side * size + piece.period.start + k
                    index[node] = first + piece.own.start + k
                    sign[3, node] = -1.0 if piece.mirrored else 1.0
            first += sum(plan.nodes[k % plan.count] for k in phases)
    return torch.tensor(index, device=device), sign if bool((sign < 0).any()) else None


class Swing(NamedTuple):
    """The flight of one leg. grid: its phases. places: its nodes in the period. whole: (P,) its duration [s].

    free: (P, 4, K) what its genes add to thigh, knee, ankle and tilt. ends: (P, 4, 4, K) what value and rate at
    take-off and at touchdown do.
    """

    grid: Grid
    places: Places
    whole: Tensor
    free: Tensor
    ends: Tensor


class Legs:
    """The legs of P candidates on the contacts of a support."""

    def __init__(self, support: Support) -> None:
        self.support, self.layout, self.genes = support, support.layout, support.genes
        plan, durations, speed = support.plan, support.grid.durations, support.speed
        self.swings: list[Swing] = []
        self.phases: list[Tensor] = []  # 0 at take-off, 1 at touchdown, on the nodes of each swing
        for contact in plan.contacts:
            phases = plan.swing(contact)
            own = Grid(
                tuple(plan.nodes[k % plan.count] for k in phases),
                torch.stack([durations[:, k % plan.count] for k in phases], dim=-1),
            )
            phase = own.times / own.total.unsqueeze(-1)
            self.phases.append(phase)
            places = places_of(plan, contact.limb, phases, speed.dtype, speed.device)
            self.swings.append(Swing(own, places, own.total, *self._curves(phase)))
        self.scales = [self._scale(k) for k in range(len(plan.contacts))]

    def _values(self, name: str, count: int) -> Tensor:
        """(P, count, 1) the genes name_1, name_2, ..."""
        return torch.stack([self.genes[f"{name}_{k}"] for k in range(1, count + 1)], dim=-1).unsqueeze(-1)

    def _curves(self, phase: Tensor) -> tuple[Tensor, Tensor]:
        """Of a `Swing`: free and ends."""
        free, ends = [], []
        bases = {moments: swing_basis(phase, moments, SMOOTH) for moments in (MOMENTS, ANKLE_MOMENTS, ())}
        rows = (("swing_thigh", MOMENTS), ("swing_knee", MOMENTS), ("swing_ankle", ANKLE_MOMENTS), (None, ()))
        for name, moments in rows:
            basis = bases[moments]
            middle = slice(SMOOTH + 1, SMOOTH + 1 + len(moments))
            ends.append(torch.cat((basis[..., : middle.start], basis[..., middle.stop :]), dim=-1).transpose(1, 2))
            own = basis[..., middle] @ self._values(name, len(moments)) if name else basis[..., :1] * 0.0
            free.append(own.squeeze(-1))
        return torch.stack(free, dim=1), torch.stack(ends, dim=1)

    def _scale(self, which: int) -> Tensor:
        """(P, 1, 4) of what `_ends` reads off a contact, from the time of its phases to that of the swing."""
        whole = self.swings[which].whole
        durations = self.support.footings[which].grid.durations
        one = torch.ones_like(whole)
        return torch.stack((one, whole / durations[:, -1], one, whole / durations[:, 0]), dim=-1).unsqueeze(1)

    def angles(self, hips: Tensor, carried: Carried) -> tuple[Tensor, list[Tensor], Tensor]:
        """Angles (P, 4, 2, M) of thigh, knee, foot and tilt; reach a contact; and by how much each contact's leg is
        too long at touchdown, and its foot too steep at take-off (P, C, 2). hips: (P, 2, 3, M) [m].
        """
        parts, reaches, slack = [], [], []
        for k, swing in enumerate(self.swings):
            line = carried.ankles[k] - self._hip(hips, self.support.pieces[k])
            angles, distance = self._reached(line, carried.pitches[k])
            reaches.append(distance / self.layout.leg)
            slack.append(self._slack(line, distance, carried.pitches[k]))
            parts += [angles, self._flown(angles, swing, k)]
        index, sign = _order(self.support.plan, hips.dtype, hips.device)
        legs = torch.cat(parts, dim=-1).index_select(-1, index)
        legs = legs if sign is None else legs * sign
        return legs.unflatten(-1, (2, -1)), reaches, torch.stack(slack, dim=1)

    def _hip(self, hips: Tensor, places: Places) -> Tensor:
        """(P, 3, K) the hip of the limb that stands, as it sees it [m]."""
        if places.whole is not None:
            return hips[:, places.sides[0], :, places.whole]
        both = hips.transpose(1, 2).flatten(2)
        size = hips.shape[-1]
        return both.index_select(-1, places.index + size * places.number) * places.flip

    def _flown(self, stance: Tensor, swing: Swing, which: int) -> Tensor:
        """Angles (P, 4, K) through the air, from those of the stance (P, 4, L)."""
        hung, unhung = _hanging(stance.dtype, stance.device)
        ends = _ends(self.support.footings[which].grid.nodes, stance.dtype, stance.device)
        met = (hung @ (stance @ ends)) * self.scales[which]
        found: Tensor = unhung @ ((met.unsqueeze(-1) * swing.ends).sum(2) + swing.free)
        return found

    def _reached(self, line: Tensor, pitch: Tensor) -> tuple[Tensor, Tensor]:
        """Angles (P, 4, K) of a leg from hip to ankle along lines (P, 3, K), and their lengths (P, K) [m]."""
        thigh, shank = self.layout.thigh, self.layout.shank
        left, up, ahead = line.unbind(1)
        squares = line**2
        down = torch.sqrt(squares[:, :2].sum(1))
        distance = torch.sqrt(squares.sum(1))
        share = LONGEST - SOFT * functional.softplus(LONGEST / SOFT - distance * (1.0 / (SOFT * self.layout.leg)))
        length = share.clamp_min(SHORTEST) * self.layout.leg
        cosine = (length**2 - (thigh**2 + shank**2)) * (0.5 / (thigh * shank))
        knee = torch.acos(cosine)
        offset = torch.atan2(shank * torch.sqrt(1.0 - cosine**2), thigh + shank * cosine)
        return torch.stack((torch.atan2(ahead, down) + offset, knee, pitch, torch.atan2(left, -up)), dim=1), distance

    def _slack(self, line: Tensor, distance: Tensor, pitch: Tensor) -> Tensor:
        """(P, 2) how much lower the hips, and steeper the foot, must be for the reach the genes ask for [m, rad]."""
        leg = self.layout.leg
        first, last = distance[:, 0], distance[:, -1]
        height = (self.genes["reach_touchdown"] * leg - first) * first / line[:, 1, 0]
        end = pitch[:, -1]
        s, c = torch.sin(end), torch.cos(end)
        ankle, _, ball = self.layout.sole
        raised, moved = ball * c + ankle * s, ankle * c - ball * s
        slope = -(line[:, 1, -1] * raised + line[:, 2, -1] * moved) / last
        steep = (last - self.genes["reach_takeoff"] * leg) / slope.clamp_min(0.05)
        return torch.stack((height, steep), dim=-1)
