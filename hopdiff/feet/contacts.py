"""When feet stand, and how much they slide while they do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from hopdiff.editing.leg_joints import Leg
from hopdiff.feet.track import leg_tracks
from hopdiff.geometry.clip import Clip

LOW = 0.04  # m above its own floor up to which a point may stand
STILL = 0.35  # m/s up to which it may move
HASTE = 0.15  # of the body's speed: what a point of a fast runner may move
SHORTEST = 0.08  # s of a contact
LEVEL = 0.02  # m above the lowest ground up to which ground counts as level
RAISED = 0.15  # s of a contact on higher ground: a jump's highest point is no contact
GAP = 0.05  # s that a contact may be interrupted
FLOOR = 0.05  # share of the frames in which a point is lower than its floor
GLANCE = 1.0 / 30.0  # s over which speeds are measured
LEG = 0.9  # m; length of the leg for which LOW is meant


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points of the feet and when they stand. points: leg and joint, -1 for the end site of the knee; names: for
    people. touching: (T, P) bool. floor: (P,) height of each point while it stands where the ground is lowest [m].
    level: (T, L) by how much the ground under each leg is higher than there [m]."""

    legs: tuple[Leg, ...]
    points: tuple[tuple[int, int], ...]
    names: tuple[str, ...]
    touching: Tensor
    floor: Tensor
    level: Tensor

    def heights(self) -> Tensor:
        """(T, P) height of each point while it stands on the ground that is there [m]."""
        return self.floor + self.at_points(self.level)

    def at_points(self, values: Tensor) -> Tensor:
        """(T, P) values of each point's leg, from (T, L)."""
        return values[:, [leg for leg, _ in self.points]]

    def plants(self, leg: int) -> list[tuple[int, int]]:
        """First and last frame of every time in which any point of a leg stands."""
        return list(spans(self.stands(leg)))

    def stands(self, leg: int) -> Tensor:
        """(T,) whether any point of a leg stands."""
        own = [k for k, (which, _) in enumerate(self.points) if which == leg]
        return self.touching[:, own].any(dim=-1)

    def standing(self) -> Tensor:
        """(T, L) whether any point of each leg stands."""
        return torch.stack([self.stands(leg) for leg in range(len(self.legs))], dim=-1)


def find_contacts(clip: Clip, legs: tuple[Leg, ...]) -> Contacts:
    """Points that are low and still for a while: ankle and toe of each leg, or the end of its shank.

    The ground need not be level: a point that is still stands, however high it is, if at some time in between no point
    of a foot is lower. Times are seconds, so the frame rate does not matter; heights go with the length of the legs.
    """
    points, names = [], []
    for k, leg in enumerate(legs):
        parts = (("heel", leg.ankle), ("toe", leg.toe))
        found = [(f"{leg.side} {part}", joint) for part, joint in parts if joint is not None]
        for name, joint in found or [(f"{leg.side} foot", -1)]:
            points.append((k, joint))
            names.append(name)
    draft = Contacts(legs, tuple(points), tuple(names), *(torch.zeros(0),) * 3)
    places = contact_points(clip, draft)
    height = places[..., 1]
    floor = torch.quantile(height[:: max(1, len(height) // 5000)], FLOOR, dim=0)
    root = clip.root_position.double()
    way = float(root[:, [0, 2]].diff(dim=0).norm(dim=-1).sum()) / max(clip.duration, clip.frame_time)
    size = leg_length(clip, legs[0]) / LEG
    still = _speed(places, clip.frame_time) < max(STILL, HASTE * way)
    above = height - floor
    ground = _grounds(above, still, clip.frame_time, size)
    touching = still & (above - ground < LOW * size)
    touching = torch.stack([_lasting(column, clip.frame_time) for column in touching.unbind(-1)], dim=-1)
    own = [[p for p, (which, _) in enumerate(points) if which == k] for k in range(len(legs))]
    level = torch.stack([_level(ground[:, k], touching[:, k]) for k in own], dim=-1)
    return Contacts(legs, tuple(points), tuple(names), touching, floor, level)


def known_contacts(clip: Clip, legs: tuple[Leg, ...], stands: Tensor) -> Contacts:
    """The contacts of a clip whose feet are known to stand on level ground in frames (T, L), left and right; which of
    their points do is seen from how low and still they are.

    A foot that stands has one such point at least: the lowest one.
    """
    found = find_contacts(clip, legs)
    touching = found.touching & found.at_points(stands)
    above = contact_points(clip, found)[..., 1] - found.floor
    for k in range(len(legs)):
        own = [i for i, (leg, _) in enumerate(found.points) if leg == k]
        lowest = above[:, own] == above[:, own].amin(dim=-1, keepdim=True)
        lacking = stands[:, k] & ~touching[:, own].any(dim=-1)
        touching[:, own] |= lowest & lacking[:, None]
    return replace(found, touching=touching, level=torch.zeros_like(found.level))


def _grounds(above: Tensor, still: Tensor, frame_time: float, size: float) -> Tensor:
    """(T, P) how high the ground is below points that are still, above where it is lowest [m].

    above: (T, P) of the points above their floors there. Where they are only a little above them, the ground is level.
    """
    ground = torch.zeros_like(above)
    least = above.amin(dim=-1)
    for k in range(above.shape[1]):
        for first, last in spans(still[:, k]):
            own = above[first : last + 1, k]
            lowest = float(own.min())
            long = (last - first + 1) * frame_time >= RAISED
            if lowest > LEVEL * size and long and float((own - least[first : last + 1]).min()) < LOW * size:
                ground[first : last + 1, k] = lowest - LEVEL * size
    return ground


def _level(ground: Tensor, touching: Tensor) -> Tensor:
    """(T,) how high the ground is below a foot: where points (T, P) of it touch, and from one such place to another."""
    frames = touching.any(dim=-1).nonzero().flatten()
    if not len(frames) or not bool(ground.any()):
        return torch.zeros(len(ground), dtype=torch.float64)
    stood = (ground * touching).sum(-1) / touching.sum(-1).clamp_min(1)
    at = np.interp(np.arange(len(ground)), frames.numpy(), stood[frames].numpy())
    return torch.from_numpy(at)


def contact_points(clip: Clip, contacts: Contacts) -> Tensor:
    """(T, P, 3) places of the points of a clip [m], in float64."""
    tracks = leg_tracks(clip, contacts.legs)
    return torch.stack([tracks[leg].point(joint) for leg, joint in contacts.points], dim=1)


def leg_length(clip: Clip, leg: Leg) -> float:
    """From hip to ankle, or to the end of the shank [m]."""
    skeleton = clip.skeleton
    shank = skeleton.offsets[leg.ankle] if leg.ankle is not None else skeleton.end_sites[skeleton.names[leg.knee]]
    return float(skeleton.offsets[leg.knee].norm() + shank.norm())


def slide_numbers(clip: Clip, contacts: Contacts) -> dict[str, float]:
    """How still the feet of a clip stand. slide_speed: mean horizontal speed of standing points [m/s]. drift: farthest
    that one gets within a contact from where it began [m]. foot_depth: deepest below its floor [m]. contact_share: of
    frames with a standing point."""
    places = contact_points(clip, contacts)
    ground = places[..., [0, 2]]
    both = contacts.touching[1:] & contacts.touching[:-1]
    pace = ground.diff(dim=0).norm(dim=-1) / clip.frame_time
    drift = 0.0
    for k in range(len(contacts.points)):
        for first, last in spans(contacts.touching[:, k]):
            own = ground[first : last + 1, k]
            drift = max(drift, float((own - own[0]).norm(dim=-1).max()))
    return {
        "slide_speed": float(pace[both].mean()) if bool(both.any()) else 0.0,
        "drift": drift,
        "foot_depth": max(0.0, float((contacts.heights() - places[..., 1]).max())),
        "contact_share": float(contacts.touching.any(dim=-1).double().mean()),
    }


def spans(flags: Tensor) -> Iterator[tuple[int, int]]:
    """First and last frame of every run of true in (T,)."""
    padded = torch.cat((torch.zeros(1, dtype=torch.int8), flags.to(torch.int8), torch.zeros(1, dtype=torch.int8)))
    change = padded.diff()
    starts, ends = (change == 1).nonzero().flatten().tolist(), (change == -1).nonzero().flatten().tolist()
    yield from ((first, after - 1) for first, after in zip(starts, ends, strict=True))


def _lasting(flags: Tensor, frame_time: float) -> Tensor:
    """(T,) with short interruptions filled and short contacts dropped, those at the ends of the clip aside."""
    filled = flags.clone()
    for first, last in spans(~flags):
        if first > 0 and last < len(flags) - 1 and (last - first + 1) * frame_time < GAP:
            filled[first : last + 1] = True
    kept = filled.clone()
    for first, last in spans(filled):
        if first > 0 and last < len(flags) - 1 and (last - first + 1) * frame_time < SHORTEST:
            kept[first : last + 1] = False
    return kept


def _speed(places: Tensor, frame_time: float) -> Tensor:
    """(T, P) speeds, measured over a glance so that the noise of fast cameras does not count [m/s]."""
    half = max(1, round(0.5 * GLANCE / frame_time))
    frames = torch.arange(len(places))
    before, after = (frames - half).clamp_min(0), (frames + half).clamp_max(len(places) - 1)
    found: Tensor = (places[after] - places[before]).norm(dim=-1) / ((after - before).clamp_min(1) * frame_time)[
        :, None
    ]
    return found
