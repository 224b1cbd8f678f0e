"""Feet that stand still again after the path of a clip was changed, on level ground or on any other.

The edit moves every frame by a turn and a shift of its own, so a foot that stood still over many frames slides. For
the time of a contact one turn and shift is taken for all of its frames instead: the foot then does exactly what it did
in the source, elsewhere. Legs follow by inverse kinematics, as they were bent. Where a leg is too short for a print,
its heel comes up first, as long as only its ball stands; then the print moves a little along the way; then the body
comes down, by no more than people do; and what is still out of reach is given up: the foot lands later or leaves
sooner.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from hopdiff.editing.root_path import root_path
from hopdiff.feet.contacts import Contacts, spans
from hopdiff.feet.footing import Footing, body_rise
from hopdiff.feet.frames import apart
from hopdiff.feet.optimised import Sliding, Stand, optimised_ways
from hopdiff.feet.prints import (
    STEP_TIME,
    FootPrint,
    GroundMove,
    foot_prints,
    shortened,
    spread,
    steps_in,
    unhurried,
    weights,
)
from hopdiff.feet.reach import EASY, lacking, longest
from hopdiff.feet.track import LegTrack, leg_tracks, smooth_step, turned
from hopdiff.feet.way import HEEL_RAMP, FootWay, lowering, sunk
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.rotation import axis_rotation
from hopdiff.terrain.ground import Ground

FEET_BY = ("fast", "optimised")
LOWEST = 0.07  # m by which the root is lowered at most
LOWEST_UNEVEN = 0.09  # m where the ground asks for it
MISS = 0.003  # m that a foot in contact may be off its print
SHIFTS = (0.0, 0.03, -0.03, 0.06, -0.06, 0.1, -0.1, 0.14, -0.14)  # m along the way by which prints are tried
SHIFT_COST = 0.1  # m of lowering that a metre of a shifted print counts as
PASSES = 3  # of giving up contacts that are out of reach
RISE = 0.05  # m by which a foot is lifted in a step where it stood in the source


@dataclass(frozen=True, eq=False)
class Planted:
    """clip: with feet that stand. touching: (T, L) bool, which feet stand. given_up: (T, L) bool, those that do in the
    source and cannot here. lowered: (T,) by how much the root is, against the ground [m]."""

    clip: Clip
    touching: Tensor
    given_up: Tensor
    lowered: Tensor

    def kept(self, contacts: Contacts) -> Tensor:
        """(T, P) bool, which of the source's points of contact stand here too."""
        return contacts.touching & contacts.at_points(self.touching)


def clean_feet(
    source: Clip,
    edited: Clip,
    contacts: Contacts,
    ground: Ground | None = None,
    still: bool | Tensor = False,
    rise: Tensor | None = None,
    kept: tuple[int, int] | None = None,
    by: str = "fast",
) -> Planted:
    """The edited clip with feet that stand where the source's stand.

    edited: the source on another root path; contacts: of the source. The first and the last frame stay as they are, or
    all up to one frame and from another one on (kept), through which the edit must be one turn and shift each.
    ground: what it walks on, level at height 0 if None. still: whether, or (T,) in which frames, feet that slide in the
    source, as in a blend of two motions, are held too. Otherwise doing it again changes nothing, and neither does it
    without an edit. rise: (T,) by how much the edit raises the body [m]. by: one of FEET_BY, how ankles and root are
    found between the contacts.
    """
    edit = GroundMove.between(root_path(source), root_path(edited))
    if ground is not None and ground.flat:
        ground = None
    head, tail = kept or (0, source.frames - 1)
    tracks = leg_tracks(source, contacts.legs)
    stands = contacts.standing()
    feet = []
    for k, track in enumerate(tracks):
        # A step that one foot makes is known to the next.
        foot = _Foot(track, edit, contacts, k, source.frame_time, ground, still, stands, (head, tail))
        stands[:, k] = foot.stands
        feet.append(foot)
    rise = torch.zeros(source.frames, dtype=torch.float64) if rise is None else rise
    if ground is not None:
        rise = rise + body_rise([foot.footing for foot in feet if foot.footing is not None], source.frame_time)
    for _ in range(PASSES):
        ways, lowered = _ways(feet, rise, by, (head, tail))
        given_up = [foot.give_up(way.missed(lowered)) for foot, way in zip(feet, ways, strict=True)]
        if not any(given_up):
            break
    else:
        ways, lowered = _ways(feet, rise, by, (head, tail))
    root = edited.root_position.clone()
    root[:, 1] = (source.root_position[:, 1].double() + rise - lowered).to(root)
    rotations = edited.rotations.clone()
    turn = axis_rotation("Y", edit.turn)
    for way in ways:
        way.pose(rotations, turn, lowered)
    if kept is not None:
        for here in (slice(0, head + 1), slice(tail, None)):
            root[here], rotations[here] = edited.root_position[here], edited.rotations[here]
    stands = torch.stack([foot.stands for foot in feet], dim=-1)
    stood = torch.stack([foot.stood for foot in feet], dim=-1)
    return Planted(replace(edited, root_position=root, rotations=rotations), stands, stood & ~stands, lowered)


def _ways(feet: Sequence[_Foot], rise: Tensor, by: str, kept: tuple[int, int]) -> tuple[list[FootWay], Tensor]:
    """The ways of the feet, and (T,) by how much the root is lowered [m]."""
    if by == "optimised":
        return optimised_ways([foot.sliding(rise) for foot in feet], feet[0].frame_time, LOWEST, kept)
    ways = [foot.way(rise) for foot in feet]
    if feet[0].footing is None:
        return ways, lowering(ways, LOWEST, kept)
    # The last pose may be lower too over uneven ground: that is the root's matter alone.
    return ways, lowering(ways, LOWEST_UNEVEN, (kept[0], 2 * len(rise)))


class _Foot:
    """One foot: where its prints are, and the way that its ankle takes from one to the next."""

    def __init__(
        self,
        track: LegTrack,
        edit: GroundMove,
        contacts: Contacts,
        number: int,
        frame_time: float,
        ground: Ground | None,
        still: bool | Tensor,
        stands: Tensor,
        kept: tuple[int, int],
    ) -> None:
        self.track, self.edit, self.frame_time, self.kept = track, edit, frame_time, kept
        self.hip = edit(track.hip)
        own = [i for i, (which, _) in enumerate(contacts.points) if which == number]
        joints = [contacts.points[i][1] for i in own]
        points = torch.stack([track.point(joint) for joint in joints], dim=1)
        touching = contacts.touching[:, own]
        self.stood = touching.any(dim=-1)
        heels = [touching[:, n] for n, joint in enumerate(joints) if joint == track.leg.ankle]
        heel = torch.stack(heels).any(0) if heels else ~self.stood
        self.flat = smooth_step(1.0 - apart(heel) * frame_time / HEEL_RAMP)
        self.reach = longest(track)
        held = still if isinstance(still, Tensor) else torch.full_like(self.stood, still)
        self.slide = _slide(points, touching & held[:, None]) if bool(held.any()) else None
        self.middle = points.mean(dim=1)
        others = stands[:, torch.arange(stands.shape[1]) != number].any(dim=-1)
        plants = steps_in(edit, self.middle, contacts.plants(number), others, frame_time, kept)
        prints = foot_prints(edit, self.middle, plants, frame_time, kept)
        self.prints = unhurried(edit, prints, self.middle, others, frame_time, kept)
        self.stands = torch.zeros_like(self.stood)
        for one in self.prints:
            self.stands[one.frames] = True
        self.footing: Footing | None = None
        self._way: FootWay | None = None
        if ground is None:
            self._way = self.way(torch.zeros_like(edit.turn))
            need = self._way.sink()
            far = [float(need[one.frames].max()) > MISS for one in self.prints]
            if any(far):
                self._way = None
                self.prints = [self._shifted(one) if too else one for one, too in zip(self.prints, far, strict=True)]
        else:
            floors, level = contacts.floor[own], contacts.level[:, number]
            self.footing = Footing(ground, track, edit, self.prints, points, floors, level)
            self.prints = self.footing.prints

    def _shifted(self, one: FootPrint) -> FootPrint:
        """The print moved along the way to where the body must be lowered least."""
        if one.pinned:
            return one
        here, track = one.frames, self.track
        hip, reach, free = self.hip[here], self.reach[here], EASY * (1.0 - self.flat[here])
        axis = turned(axis_rotation("Y", one.move.turn).expand(len(hip), 3, 3), track.left[here])
        ankle, ball = one.move(self._own(one, here)), None if track.ball is None else one.move(track.ball[here])
        way = functional.normalize((hip[-1] - hip[0])[[0, 2]], dim=0)
        by = torch.tensor(SHIFTS, dtype=torch.float64)[:, None] * way
        more = torch.stack((by[:, 0], torch.zeros(len(by), dtype=by.dtype), by[:, 1]), dim=-1)[:, None]
        down, off = lacking(hip, ankle + more, None if ball is None else ball + more, axis, reach, free)
        cost = down.amax(-1) + off.amax(-1) + SHIFT_COST * by.norm(dim=-1)
        return replace(one, move=one.move.shifted(by[int(cost.argmin())]))

    def _own(self, one: FootPrint, here: slice) -> Tensor:
        """(T', 3) ankle of the source [m], without its slide if that is to be taken away."""
        own = self.track.ankle[here]
        if self.slide is None:
            return own
        own = own.clone()
        head, tail = self.kept
        end = head if one.first - head <= tail - one.last else tail
        own[:, [0, 2]] -= self.slide[here] - (self.slide[end] if one.pinned else self.slide[one.frames].mean(dim=0))
        return own

    def way(self, rise: Tensor) -> FootWay:
        """From print to print. rise: (T,) of the body [m]."""
        if self._way is not None and not bool(rise.any()):
            return self._way
        track = self.track
        own, turn = self.edit(track.ankle), self.edit.turn
        ankle, yaw, weight = own.clone(), turn.clone(), torch.zeros_like(turn)
        for one, (here, share) in zip(
            self.prints, weights(self.prints, len(own), self.frame_time, self.kept), strict=True
        ):
            move = spread(one.move, one, here)
            ankle[here] += share[:, None] * (move(self._own(one, here)) - own[here])
            yaw[here] += share * (move.turn - turn[here])
            weight[here] += share
        return self._along(ankle, yaw, weight, rise)

    def sliding(self, rise: Tensor) -> Sliding:
        """The foot as the edit leads it, and its contacts, to be found together with others."""
        own, turn = self.edit(self.track.ankle), self.edit.turn
        weight = torch.zeros_like(turn)
        for here, share in weights(self.prints, len(own), self.frame_time, self.kept):
            weight[here] += share
        stands = [
            Stand(
                one.frames,
                one.move(self._own(one, one.frames)),
                one.move.turn.expand(one.last + 1 - one.first),
                # Where ground is not level a print is on its tread already.
                free=self.footing is None and not one.pinned,
            )
            for one in self.prints
        ]
        return Sliding(own, turn, stands, lambda ankle, yaw: self._along(ankle, yaw, weight, rise))

    def _along(self, ankle: Tensor, yaw: Tensor, weight: Tensor, rise: Tensor) -> FootWay:
        """The way of an ankle (T, 3) over level ground [m], on the ground that is there."""
        ankle = sunk(ankle, -self._lift())
        frame, hip = axis_rotation("Y", yaw), sunk(self.hip, -rise)
        floor = None
        if self.footing is not None:
            ankle, frame, floor = self.footing.lifted(ankle, frame, self.stands, self.frame_time)
        return FootWay(
            self.track,
            hip,
            ankle,
            frame,
            self.stands,
            weight,
            self.flat,
            self.frame_time,
            kept=self.kept,
            floor=floor,
        )

    def _lift(self) -> Tensor:
        """(T,) by how much the foot is lifted where it has left the ground, or not come to it, unlike in the source."""
        lift = torch.zeros(len(self.stood), dtype=torch.float64)
        for first, last in spans(~self.stands):
            first, last = max(first, self.kept[0] + 1), min(last, self.kept[1] - 1)
            count = int((self.stood[first : last + 1]).sum())
            if count:
                share = torch.linspace(0.0, math.pi, last - first + 3, dtype=torch.float64)[1:-1]
                most = RISE * min(1.0, count * self.frame_time / STEP_TIME)
                lift[first : last + 1] = most * torch.sin(share) ** 2
        return lift

    def give_up(self, missed: Tensor) -> bool:
        """Leave out the frames of contacts that are out of reach (T,) [m]; whether there are any."""
        bad = missed > MISS
        if not bool(bad.any()):
            return False
        kept, stands = [], torch.zeros_like(self.stands)
        for one in self.prints:
            out = bad[one.frames]
            if bool(out.any()):
                found = _reached(~out, one, self.kept)
                if found is None:
                    continue
                one = shortened(one, *found)
            kept.append(one)
            stands[one.frames] = True
        self.prints, self.stands, self._way = kept, stands, None
        return True


def _reached(good: Tensor, one: FootPrint, kept: tuple[int, int]) -> tuple[int, int] | None:
    """First and last frame of the part of a contact that is kept: the longest, or that which begins or ends in
    frames that stay."""
    if not bool(good.any()):
        return None
    bad = (~good).nonzero().flatten()
    if one.first <= kept[0]:
        return (one.first, one.first + int(bad[0]) - 1) if int(bad[0]) > 0 else None
    if one.last >= kept[1]:
        return (one.first + int(bad[-1]) + 1, one.last) if bool(good[-1]) else None
    edges = torch.cat((good.new_zeros(1), good, good.new_zeros(1))).int().diff()
    starts, ends = (edges == 1).nonzero().flatten(), (edges == -1).nonzero().flatten()
    best = int((ends - starts).argmax())
    return one.first + int(starts[best]), one.first + int(ends[best]) - 1


def _slide(points: Tensor, touching: Tensor) -> Tensor:
    """(T, 2) how far a foot has slid over the ground so far, by those of its points (T, P, 3) that touch it [m]."""
    both = (touching[1:] & touching[:-1]).double()
    moved = (points[:, :, [0, 2]].diff(dim=0) * both.unsqueeze(-1)).sum(dim=1) / both.sum(dim=1).clamp_min(1.0)[:, None]
    return torch.cat((torch.zeros_like(moved[:1]), moved.cumsum(dim=0)))
