"""What is known of a body: where its joints are in the rest pose, which parts they are, how heavy those are."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import torch

from hopdiff.export.anatomy import ordinary_masses, parts_of
from hopdiff.export.body.loft import Floats, Surface
from hopdiff.geometry.skeleton import Skeleton

DENSITY = 1000.0  # kg/m^3
FOOT = 0.19  # of the mass of shank and foot
HAND = 0.27  # of the mass of forearm and hand
GROWN = 0.155  # height of head and neck in that of the body
SHORT = 1e-4  # m below which a bone has no direction
UP = np.array([0.0, 1.0, 0.0])


@dataclass(eq=False)
class Build:
    """A body in its rest pose, joint 0 at the origin, and what is made of it so far.

    places: (J, 3) joints [m]. left, ahead: (3,) level unit axes of the body. whole: whether joints that are no part
    carry nothing. young: how much larger its head is,
    in the body's height, than a grown-up's. made: surfaces by side. covered: joints
    whose bone up to their parent lies in a surface; taken: joints whose end lies in one.
    """

    skeleton: Skeleton
    places: Floats
    parts: Mapping[str, int]
    masses: Mapping[str, float]
    left: Floats
    ahead: Floats
    whole: bool = False
    young: float = 0.0
    made: dict[str, list[Surface]] = field(default_factory=lambda: {"left": [], "right": [], "middle": []})
    covered: set[int] = field(default_factory=set)
    taken: set[int] = field(default_factory=set)

    @classmethod
    def of(cls, skeleton: Skeleton, masses: Mapping[str, float] | None, told: Mapping[str, str] | None = None) -> Build:
        """told: part -> joint, in place of what names and shape tell."""
        straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
        places: Floats = skeleton.forward(torch.zeros(1, 3).double(), straight)[0][0].numpy()
        parts = parts_of(skeleton) if told is None else {part: skeleton.index(name) for part, name in told.items()}
        left = np.array([1.0, 0.0, 0.0])
        for part in ("hip", "shoulder"):
            if f"left_{part}" in parts and f"right_{part}" in parts:
                way = (places[parts[f"left_{part}"]] - places[parts[f"right_{part}"]]) * [1.0, 0.0, 1.0]
                if np.linalg.norm(way) > SHORT:
                    left = unit(way)
                    break
        known = dict(masses) if masses else ordinary_masses(places, parts)
        body = cls(skeleton, places, parts, known, left, np.cross(left, UP), told is not None)
        body.young = body._young()
        return body

    def at(self, part: str) -> Floats:
        found: Floats = self.places[self.parts[part]]
        return found

    def end(self, joint: int) -> Floats | None:
        """Where a bone ends that has no joint at its end."""
        site = self.skeleton.end_sites.get(self.skeleton.names[joint])
        if site is None or float(site.norm()) < 1e-6 or self.skeleton.children(joint):
            return None
        found: Floats = self.places[joint] + site.detach().double().cpu().numpy()
        return found

    def _young(self) -> float:
        joint = self.parts.get("head", self.parts.get("neck"))
        crown = None if joint is None else self.end(joint)
        if crown is None or "neck" not in self.parts:
            return 0.0
        head, height = crown[1] - self.at("neck")[1], crown[1] - self.places[:, 1].min()
        return float(np.clip(head / max(height, SHORT) - GROWN, 0.0, 0.2))

    def outwards(self, side: str) -> Floats:
        return self.left if side == "left" else -self.left

    def bone(self, start: str, end: str) -> float:
        """Length from one part to another [m]; 0 if either is missing."""
        if start not in self.parts or end not in self.parts:
            return 0.0
        return float(np.linalg.norm(self.at(end) - self.at(start)))


def unit(way: Floats) -> Floats:
    found: Floats = way / max(float(np.linalg.norm(way)), 1e-12)
    return found


def axes(way: Floats, ahead: Floats, out: Floats) -> tuple[Floats, Floats]:
    """Unit axes across a way (3,): outwards and ahead of a limb that hangs, and turned with it when it is raised."""
    deep = ahead - (ahead @ way) * way
    if np.linalg.norm(deep) < 0.3:
        # Along the way ahead, as arms that reach forwards: their front looks up.
        deep = UP - (UP @ way) * way
    deep = unit(deep)
    # A limb that hangs has its outside at `out`.
    hand = 1.0 if np.cross(-UP, ahead) @ out > 0.0 else -1.0
    return hand * np.cross(way, deep), deep


def thickness(mass: float, length: float, profile: Floats) -> float:
    """Mean radius [m] of a part of a mass and length, whose sections reach out, in, ahead and back by a profile's
    columns."""
    share = np.linspace(0.0, 1.0, 41)
    table = np.stack([np.interp(share, profile[:, 0], column) for column in profile.T[1:5]])
    area = 0.25 * (table[0] + table[1]) * (table[2] + table[3])
    return math.sqrt(mass / DENSITY / (math.pi * length * float(area.mean())))
