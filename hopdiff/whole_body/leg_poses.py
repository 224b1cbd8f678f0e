"""Legs: standing ones reach from hip to ankle, those in the air follow smooth curves from stance to stance."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.support import Carried, Piece, Support, pieces
from hopdiff.whole_body.swing import ANKLE_MOMENTS, MOMENTS, swing_basis

LONGEST, SOFT = 0.9985, 0.0015  # of the straight leg: how far a leg reaches, and over what it gets there
SMOOTH = 1  # rates of leg angles that go on through touchdown and take-off by construction: the first


class Legs:
    """The legs of P candidates on the contacts of a support."""

    def __init__(self, support: Support) -> None:
        self.support, self.layout, self.genes = support, support.layout, support.genes
        plan, durations = support.plan, support.grid.durations
        self.swings: list[tuple[list[Piece], Tensor, tuple[Tensor, ...]]] = []
        self.phases: list[Tensor] = []  # 0 at take-off, 1 at touchdown, on the nodes of each swing
        for contact in plan.contacts:
            phases = plan.swing(contact)
            own = Grid(
                tuple(plan.nodes[k % plan.count] for k in phases),
                torch.stack([durations[:, k % plan.count] for k in phases], dim=-1),
            )
            phase = own.times / own.total.unsqueeze(-1)
            self.phases.append(phase)
            self.swings.append(
                (
                    pieces(plan, contact.limb, phases),
                    own.total,
                    tuple(swing_basis(phase, moments, SMOOTH) for moments in (MOMENTS, ANKLE_MOMENTS, ())),
                )
            )
        self.free = [
            torch.stack([self._values(name, len(moments)) for name in names], dim=1)
            for names, moments in ((("swing_thigh", "swing_knee"), MOMENTS), (("swing_ankle",), ANKLE_MOMENTS))
        ]

    def _values(self, name: str, count: int) -> Tensor:
        """(P, count) the genes name_1, name_2, ..."""
        return torch.stack([self.genes[f"{name}_{k}"] for k in range(1, count + 1)], dim=-1)

    def angles(self, hips: Tensor, carried: Carried) -> tuple[Tensor, list[Tensor], Tensor]:
        """Angles (P, 2, 4, M) of thigh, knee, foot and tilt; reach a contact; and by how much each contact's leg is
        too long at touchdown, and its foot too steep at take-off (P, C, 2).
        """
        layout = self.layout
        legs = hips.new_zeros(hips.shape[0], 2, 4, hips.shape[-1])
        signs = hips.new_tensor((1.0, 1.0, 1.0, -1.0))[:, None]
        flip = hips.new_tensor((-1.0, 1.0, 1.0))[:, None]
        reaches, slack = [], []
        for k, footing in enumerate(self.support.footings):
            places = self.support.pieces[k]
            hip = torch.cat(
                [hips[:, p.side, :, p.period] * (flip if p.mirrored else torch.ones_like(flip)) for p in places], dim=-1
            )
            line = carried.ankles[k] - hip
            angles, distance = self._reached(line, carried.pitches[k])
            reaches.append(distance / layout.leg)
            slack.append(self._slack(line, distance, carried.pitches[k], k))
            swing, whole, bases = self.swings[k]
            air = self._flown(angles, footing.grid, whole, bases)
            for values, where in ((angles, places), (air, swing)):
                for piece in where:
                    own = values[:, :, piece.own]
                    legs[:, piece.side, :, piece.period] = own * signs if piece.mirrored else own
        return legs, reaches, torch.stack(slack, dim=1)

    def _flown(self, stance: Tensor, grid: Grid, whole: Tensor, bases: tuple[Tensor, ...]) -> Tensor:
        """Angles (P, 4, K) through the air, from those of the stance (P, 4, L). whole: (P,) duration of the swing [s].

        Thigh and knee follow curves of their own; the foot hangs from the shank at the ankle's angle.
        """
        thigh, knee, pitch, tilt = stance.unbind(1)
        hung = torch.stack((thigh, knee, pitch - thigh + knee, tilt), dim=1)
        rates = grid.derivative(hung) * whole[:, None, None]
        ends = [torch.stack((hung[..., k], rates[..., k]), dim=-1) for k in (-1, 0)]
        parts = []
        for rows, free, basis in zip((slice(0, 2), slice(2, 3), slice(3, 4)), (*self.free, None), bases, strict=True):
            first, last = (end[:, rows] for end in ends)
            middle = () if free is None else (free,)
            parts.append(torch.cat((first, *middle, last), dim=-1) @ basis.transpose(-1, -2))
        thigh, knee, ankle, tilt = torch.cat(parts, dim=1).unbind(1)
        return torch.stack((thigh, knee, ankle + thigh - knee, tilt), dim=1)

    def _reached(self, line: Tensor, pitch: Tensor) -> tuple[Tensor, Tensor]:
        """Angles (P, 4, K) of a leg from hip to ankle along lines (P, 3, K), and their lengths (P, K) [m]."""
        thigh, shank = self.layout.thigh, self.layout.shank
        left, up, ahead = line.unbind(1)
        down = torch.sqrt(left**2 + up**2)
        distance = torch.sqrt(down**2 + ahead**2)
        share = LONGEST - SOFT * functional.softplus((LONGEST - distance / self.layout.leg) / SOFT)
        length = share.clamp_min(0.35) * self.layout.leg
        cosine = (length**2 - thigh**2 - shank**2) / (2.0 * thigh * shank)
        knee = torch.acos(cosine)
        offset = torch.atan2(shank * torch.sin(knee), thigh + shank * cosine)
        return torch.stack((torch.atan2(ahead, down) + offset, knee, pitch, torch.atan2(left, -up)), dim=1), distance

    def _slack(self, line: Tensor, distance: Tensor, pitch: Tensor, which: int) -> Tensor:
        """(P, 2) how much lower the hips, and steeper the foot, must be for the reach the genes ask for [m, rad]."""
        leg = self.layout.leg
        height = (distance[:, 0] - self.genes["reach_touchdown"] * leg) * distance[:, 0] / (-line[:, 1, 0])
        s, c = torch.sin(pitch[:, -1]), torch.cos(pitch[:, -1])
        ball, ankle = float(self.layout.ball[2]), -float(self.layout.ball[1])
        raised, moved = -(ball * c + ankle * s), -(ankle * c - ball * s)
        slope = (line[:, 1, -1] * raised + line[:, 2, -1] * moved) / distance[:, -1]
        steep = (distance[:, -1] - self.genes["reach_takeoff"] * leg) / slope.clamp_min(0.05)
        return torch.stack((height, steep), dim=-1)
