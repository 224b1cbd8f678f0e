"""A whole-body movement that goes on for ever: everything about it at any moment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from hopdiff.motion import SIDES
from hopdiff.numerics import GRAVITY
from hopdiff.whole_body.grid import Grid
from hopdiff.whole_body.kinematics import Angles, all_frames, trunk_frames
from hopdiff.whole_body.layout import JOINT_OF, PARENTS, SEGMENTS, Layout
from hopdiff.whole_body.movement import Body, Movement
from hopdiff.whole_body.plan import Plan

PLACES = ("root", "com", "left_cop", "right_cop")  # curves that go along with the way
TOES_AT_EASE = 0.25  # of a swing in which bent toes straighten
TOES_BEND = math.radians(60.0)  # at most, unless the ground bends them further

# Curves that a movement is made of: name, how many, which of them change sign in the mirror image. Pairs are left and
# right, and change places there.
_CURVES: tuple[tuple[str, int, tuple[float, ...]], ...] = (
    ("root", 3, (-1.0, 1.0, 1.0)),
    ("com", 3, (-1.0, 1.0, 1.0)),
    ("pelvis", 3, (1.0, -1.0, -1.0)),
    ("chest", 3, (1.0, -1.0, -1.0)),
)
_PAIRS: tuple[tuple[str, int, tuple[float, ...]], ...] = (
    ("thigh", 1, (1.0,)),
    ("knee", 1, (1.0,)),
    ("foot", 1, (1.0,)),
    ("tilt", 1, (-1.0,)),
    ("shoulder", 1, (1.0,)),
    ("elbow", 1, (1.0,)),
    ("force", 3, (-1.0, 1.0, 1.0)),
    ("cop", 3, (-1.0, 1.0, 1.0)),
)


class BodyPose(NamedTuple):
    """P movements at T moments. root: (P, T, 3) pelvis joint [m]. rotations: (P, T, 22, 3, 3), each in its parent's
    frame. com: (P, T, 3) [m]. force: (P, T, 2, 3) ground force in body weights. cop: (P, T, 2, 3) [m]. contact:
    (P, T, 2) bool. curves: name -> (P, T) [rad].
    """

    root: Tensor
    rotations: Tensor
    com: Tensor
    force: Tensor
    cop: Tensor
    contact: Tensor
    curves: dict[str, Tensor]


@dataclass(frozen=True, eq=False)
class BodyGait:
    """Solved movements of P candidates. channels: (P, C, M) the curves above on the nodes of the period. abduction,
    inward: (P,) of both arms [rad]. way: (P,) gone in a period [m]. swapped: whether left and right are exchanged;
    time then begins at what was the right foot's touchdown.
    """

    layout: Layout
    plan: Plan
    grid: Grid
    channels: Tensor
    abduction: Tensor
    inward: Tensor
    way: Tensor
    swapped: bool = False

    @classmethod
    def of(cls, movement: Movement, body: Body, swapped: bool = False) -> BodyGait:
        angles, carried = body.angles, body.carried
        singles = (body.root, carried.com, angles.pelvis, angles.chest)
        pairs = (angles.thigh, angles.knee, angles.foot, angles.tilt, angles.shoulder, angles.elbow)
        vectors = (carried.force / GRAVITY, carried.cop)
        channels = torch.cat((*singles, *pairs, *(vector.flatten(1, 2) for vector in vectors)), dim=1)
        return cls(
            movement.layout,
            movement.plan,
            movement.grid,
            channels.detach(),
            angles.abduction.detach(),
            angles.inward.detach(),
            (movement.speed * movement.grid.total).detach(),
            swapped,
        )

    @property
    def stride_time(self) -> Tensor:
        """(P,) [s]."""
        return self.grid.total * (2.0 if self.plan.mirrored else 1.0)

    @property
    def contacts(self) -> Tensor:
        """(P, 2, 2) when each foot, left first, comes down and leaves within the stride [s]."""
        durations = self.grid.durations
        ends = torch.cumsum(durations.repeat(1, 2 if self.plan.mirrored else 1), dim=1)
        spans: dict[str, Tensor] = {}
        for contact in self.plan.contacts:
            first = contact.phases[0]
            start = ends[:, first] - durations[:, first % self.plan.count]
            spans[contact.limb] = torch.stack((start, ends[:, contact.phases[-1]]), dim=-1)
        if self.plan.mirrored:
            spans["right"] = spans["left"] + self.grid.total[:, None]
        if self.swapped:
            begun = spans["right"][:, :1]
            spans = {"left": spans["right"] - begun, "right": spans["left"] - begun + self.stride_time[:, None]}
        return torch.stack([spans[side] for side in SIDES], dim=1)

    @property
    def _begun(self) -> Tensor:
        """(P, 1) when time begins, in that of the curves [s]."""
        if not self.swapped:
            return torch.zeros_like(self.way).unsqueeze(-1)
        phase = next(contact.phases[0] for contact in self.plan.contacts if contact.limb == "right")
        return self.grid.durations[:, :phase].sum(-1, keepdim=True)

    @property
    def contact_times(self) -> Tensor:
        """(P, 2) of the left and the right foot [s]."""
        return self.contacts[:, :, 1] - self.contacts[:, :, 0]

    @property
    def flight_times(self) -> Tensor:
        """(P, 2) from each foot's take-off to the other's touchdown [s]."""
        spans, stride = self.contacts, self.stride_time
        left = spans[:, 1, 0] - spans[:, 0, 1]
        right = spans[:, 0, 0] + stride - spans[:, 1, 1]
        return torch.stack((left, right), dim=-1)

    def sample(self, times: Tensor) -> BodyPose:
        """The movements at times (T,) since left touchdown, anywhere in their endless course [s]."""
        named = self._at(times + self._begun)
        if self.swapped:
            named = self._mirrored(named)
            ahead = named["com"].new_tensor((0.0, 0.0, 1.0))[:, None] * self._at(self._begun)["com"]
            for name in PLACES:
                named[name] = named[name] - ahead
        contact, since = self._standing(times)
        return self._pose(named, contact, since)

    def _at(self, times: Tensor) -> dict[str, Tensor]:
        """Curves by name, (P, n, T) each, at times (P, T) since the start of the first period [s]."""
        period = self.grid.total.unsqueeze(-1)
        # A moment that lies on a touchdown but for rounding belongs to the new period.
        count = torch.floor(times / period + 1e-12)
        named = self._named(self.grid.sample(self.channels, (times - count * period).clamp_min(0.0)))
        if self.plan.mirrored:
            odd = (count % 2.0 == 1.0).unsqueeze(1)
            mirrored = self._mirrored(named)
            named = {name: torch.where(odd, mirrored[name], values) for name, values in named.items()}
        gone = (count * self.way.unsqueeze(-1)).unsqueeze(1)
        ahead = gone * gone.new_tensor((0.0, 0.0, 1.0))[:, None]
        return {name: values + ahead if name in PLACES else values for name, values in named.items()}

    def _named(self, values: Tensor) -> dict[str, Tensor]:
        """Curves by name, (P, n, T) each; of pairs left and right apart."""
        found, first = {}, 0
        for name, size, _ in _CURVES:
            found[name] = values[:, first : first + size]
            first += size
        for name, size, _ in _PAIRS:
            for side in SIDES:
                found[f"{side}_{name}"] = values[:, first : first + size]
                first += size
        return found

    def _mirrored(self, named: dict[str, Tensor]) -> dict[str, Tensor]:
        found = {}
        for name, _, signs in _CURVES:
            found[name] = named[name] * named[name].new_tensor(signs)[:, None]
        for name, _, signs in _PAIRS:
            for side, other in (SIDES, SIDES[::-1]):
                found[f"{side}_{name}"] = named[f"{other}_{name}"] * named[f"{other}_{name}"].new_tensor(signs)[:, None]
        return found

    def _standing(self, times: Tensor) -> tuple[Tensor, Tensor]:
        """(P, T, 2) whether each foot stands, and the share of its swing that is over where it does not."""
        stride = self.stride_time[:, None, None]
        start, end = self.contacts[:, None, :, 0], self.contacts[:, None, :, 1]
        slack = 1e-9
        since = times[None, :, None] - start
        since = since - stride * torch.floor((since + slack) / stride)
        standing = since <= end - start + slack
        # The moment of a touchdown belongs to the stance, from whichever side rounding puts it.
        return standing, ((since - (end - start)) / (stride - (end - start))).clamp(0.0, 1.0)

    def _pose(self, named: dict[str, Tensor], contact: Tensor, since: Tensor) -> BodyPose:
        def pair(name: str) -> Tensor:
            return torch.cat((named[f"left_{name}"], named[f"right_{name}"]), dim=1)

        pelvis, chest = named["pelvis"], named["chest"]
        angles = Angles(
            pelvis,
            0.5 * (pelvis + chest),
            chest,
            torch.zeros_like(chest),
            pair("thigh"),
            pair("knee"),
            pair("foot"),
            pair("tilt"),
            pair("shoulder"),
            pair("elbow"),
            self.abduction,
            self.inward,
        )
        frames = all_frames(angles, trunk_frames(angles))
        # Axes as columns: (P, T, S, 3, 3).
        turned = frames.permute(0, 4, 1, 3, 2)
        root = named["root"].transpose(1, 2)
        rotations = self._bend_toes(self._rotations(turned), root, angles.foot.transpose(1, 2), contact, since)
        standing = contact.unsqueeze(-1)
        force = torch.stack([named[f"{side}_force"].transpose(1, 2) for side in SIDES], dim=2)
        cop = torch.stack([named[f"{side}_cop"].transpose(1, 2) for side in SIDES], dim=2)
        curves = {
            "trunk": chest[:, 0],
            "trunk_side": chest[:, 1],
            "pelvis_roll": pelvis[:, 1],
            "pelvis_yaw": pelvis[:, 2],
        }
        for k, side in enumerate(SIDES):
            curves[f"{side}_hip"] = angles.thigh[:, k]
            curves[f"{side}_knee"] = angles.knee[:, k]
            curves[f"{side}_ankle"] = angles.foot[:, k] - angles.thigh[:, k] + angles.knee[:, k]
            curves[f"{side}_shoulder"] = angles.shoulder[:, k]
            curves[f"{side}_elbow"] = angles.elbow[:, k]
        return BodyPose(
            root,
            rotations,
            named["com"].transpose(1, 2),
            torch.where(standing, force, 0.0),
            cop,
            contact,
            curves,
        )

    def _rotations(self, turned: Tensor) -> Tensor:
        """(P, T, 22, 3, 3) of the joints, with straight toes."""
        names = self.layout.skeleton.names
        straight = torch.eye(3).to(turned).expand(*turned.shape[:2], 3, 3)
        found = dict.fromkeys(names, straight)
        for k, segment in enumerate(SEGMENTS):
            own = turned[:, :, k]
            parent = PARENTS[k]
            found[JOINT_OF[segment]] = own if parent < 0 else turned[:, :, parent].transpose(-1, -2) @ own
        return torch.stack([found[name] for name in names], dim=2)

    def _bend_toes(self, rotations: Tensor, root: Tensor, pitch: Tensor, contact: Tensor, since: Tensor) -> Tensor:
        """The rotations with toes that lie on the ground while the heel comes up, and straighten in the air above it.

        pitch: (P, T, 2) of the feet [rad].
        """
        skeleton = self.layout.skeleton
        toes = [skeleton.index(f"{side}_toe") for side in SIDES]
        height = skeleton.forward(root, rotations)[0][:, :, toes, 1].clamp_min(0.0)
        length = (self.layout.toe - self.layout.ball).norm()
        ease = (1.0 - since / TOES_AT_EASE).clamp(0.0, 1.0)
        ease = torch.where(contact, torch.ones_like(ease), ease**2 * (3.0 - 2.0 * ease))
        bend = ease * pitch.clamp(-TOES_BEND, 0.0)
        # As steep as toes may point down; those that do not reach the ground may as they like.
        steepest = torch.where(height < length, (height / length).clamp(max=1.0).asin(), math.pi)
        bend = torch.minimum(bend, pitch + steepest)
        c, s, none = bend.cos(), bend.sin(), torch.zeros_like(bend)
        rows = (none + 1.0, none, none, none, c, -s, none, s, c)
        bent = torch.stack(rows, dim=-1).unflatten(-1, (3, 3))
        return rotations.index_copy(2, torch.tensor(toes, device=rotations.device), bent)
