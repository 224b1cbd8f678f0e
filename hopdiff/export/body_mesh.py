"""A body to look at: limbs, trunk, head, hands and feet around the bones of a skeleton in its rest pose.

Parts are as thick as their masses make them at the density of water. They have smooth surfaces that bend at the
joints, and colours that tell left from right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import torch

from hopdiff.export.anatomy import ordinary_masses, parts_of
from hopdiff.export.loft import Floats, Ring, Surface, ellipsoid, joined, loft, through
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.whole_body.skeleton import HEEL, TOE_TIP

DENSITY = 1000.0  # kg/m^3
# Thickness along a limb, first as a share of its length, then against its mean.
UPPER = np.array([(0.0, 1.15), (0.3, 1.12), (0.6, 0.97), (0.85, 0.84), (1.0, 0.8)])
LOWER = np.array([(0.0, 0.98), (0.25, 1.22), (0.5, 1.05), (0.8, 0.72), (1.0, 0.62)])
# Of the foot ahead of the ankle: how far (in its reach), how wide and how high.
SOLE = ((0.3, 0.8, 0.85), (0.62, 1.0, 0.5), (0.85, 0.92, 0.36), (1.0, 0.6, 0.26))
FOOT = 0.19  # of the mass of shank and foot
HAND = 0.27  # of the mass of forearm and hand
SKULL = 0.75  # of the mass of head and neck
BONE = 0.12  # thickness of a joint's bone that is no part of a body, in its length


def body_mesh(skeleton: Skeleton, masses: Mapping[str, float] | None = None) -> dict[str, Surface]:
    """Surfaces by side: left, right and middle, in the rest pose with joint 0 at the origin [m].

    masses: of the eleven segments of hopdiff's bodies [kg] by joint; None for those of an ordinary build. Joints that
    are no known part of a body get plain bones.
    """
    return _Body(skeleton, masses).surfaces()


class _Body:
    def __init__(self, skeleton: Skeleton, masses: Mapping[str, float] | None) -> None:
        self.skeleton = skeleton
        straight = torch.eye(3, dtype=torch.float64).expand(1, len(skeleton.names), 3, 3)
        self.places: Floats = skeleton.forward(torch.zeros(1, 3).double(), straight)[0][0].numpy()
        self.parts = parts_of(skeleton)
        self.masses = dict(masses) if masses else ordinary_masses(self.places, self.parts)
        self.found: dict[str, list[Surface]] = {"left": [], "right": [], "middle": []}
        self.covered: set[int] = set()  # joints whose bone up to their parent lies in a surface
        self.taken: set[int] = set()  # joints whose end lies in one

    def surfaces(self) -> dict[str, Surface]:
        for side in ("left", "right"):
            self._limb(side, ("hip", "knee", "ankle"), (f"{side}_hip", f"{side}_knee"), FOOT)
            self._limb(side, ("shoulder", "elbow", "wrist"), (f"{side}_shoulder", f"{side}_elbow"), HAND)
            self._foot(side)
            self._hand(side)
        self._trunk()
        self._head()
        self._bones()
        return {side: joined(surfaces) for side, surfaces in self.found.items() if surfaces}

    def at(self, part: str) -> Floats:
        found: Floats = self.places[self.parts[part]]
        return found

    def end(self, joint: int) -> Floats | None:
        """Where a bone ends that has no joint at its end."""
        site = self.skeleton.end_sites.get(self.skeleton.names[joint])
        if site is None or float(site.norm()) < 1e-6 or self.skeleton.children(joint):
            return None
        found: Floats | None = self.places[joint] + site.detach().double().cpu().numpy()
        return found

    def _limb(self, side: str, names: tuple[str, str, str], segments: tuple[str, str], beyond: float) -> None:
        upper, middle, lower = (f"{side}_{name}" for name in names)
        if upper not in self.parts or middle not in self.parts:
            return
        a, b = self.parts[upper], self.parts[middle]
        tip = self.at(lower) if lower in self.parts else self.end(b)
        if (
            tip is None
            or min(np.linalg.norm(self.places[b] - self.places[a]), np.linalg.norm(tip - self.places[b])) < 1e-4
        ):
            return
        beyond = beyond if lower in self.parts else 0.0
        rings: list[Ring] = []
        whole = (self.masses[segments[0]], (1.0 - beyond) * self.masses[segments[1]])
        bones = ((self.places[a], self.places[b], UPPER, whole[0]), (self.places[b], tip, LOWER, whole[1]))
        thick = [_radius(mass, start, stop, profile) for start, stop, profile, mass in bones]
        knee = 0.5 * (thick[0] * UPPER[-1, 1] + thick[1] * LOWER[0, 1])
        for k, (start, stop, profile, _) in enumerate(bones):
            length = float(np.linalg.norm(stop - start))
            for share in (0.0, 0.04, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.96, 1.0)[k:]:
                # Along both bones from the knee, in its thickness: it bends from one side of the knee to the other.
                past = (share if k else share - 1.0) * length / knee
                below = _smooth(0.5 + 0.5 * past)
                radius = thick[k] * float(through(profile)(share)[0])
                radius += (knee - radius) * max(0.0, 1.0 - (share if k else 1.0 - share) / 0.2)
                rings.append(
                    Ring.around(start + share * (stop - start), stop - start, radius, {a: 1.0 - below, b: below})
                )
        self.found[side].append(loft(rings, thick[0] * UPPER[0, 1] * 0.8, thick[1] * LOWER[-1, 1] * 0.7))
        self.covered |= {b} | ({self.parts[lower]} if lower in self.parts else set())
        self.taken |= set() if lower in self.parts else {b}

    def _foot(self, side: str) -> None:
        if f"{side}_ankle" not in self.parts or f"{side}_knee" not in self.parts:
            return
        ankle_joint = self.parts[f"{side}_ankle"]
        toe_joint = self.parts.get(f"{side}_toe")
        ankle, shank = self.at(f"{side}_ankle"), np.linalg.norm(self.at(f"{side}_knee") - self.at(f"{side}_ankle"))
        tip = self.end(ankle_joint) if toe_joint is None else self.end(toe_joint)
        ball = None if toe_joint is None else self.places[toe_joint]
        far = tip if tip is not None else ball
        way = np.array([0.0, 0.0, 1.0]) if far is None else far - ankle
        ahead = way * np.array([1.0, 0.0, 1.0])
        if np.linalg.norm(ahead) < 1e-3:
            return
        ahead = ahead / np.linalg.norm(ahead)
        size = 1.16 * float(shank)  # of shank and foot together
        sole = min(float(point[1]) for point in (ball, tip, ankle - 0.1 * size) if point is not None)
        sole = min(sole, float(ankle[1]) - 0.08 * size) if far is None else sole
        reach = max(float((far - ankle) @ ahead), TOE_TIP * size) if far is not None else TOE_TIP * size
        bend = float((ball - ankle) @ ahead) if ball is not None else 2.0 * reach
        half, high = 0.085 * size, float(ankle[1]) - sole
        rings = []
        outline = ((-HEEL * size, 0.62, 0.7), (-0.3 * HEEL * size, 0.7, 1.0), *((a * reach, b, c) for a, b, c in SOLE))
        for share, wide, tall in outline:
            toes = 0.0 if toe_joint is None else _smooth(0.5 + (share - bend) / (0.3 * reach))
            weights = {ankle_joint: 1.0 - toes} | ({} if toe_joint is None else {toe_joint: toes})
            centre = ankle + share * ahead
            centre[1] = sole + 0.5 * tall * high
            across = np.cross([0.0, 1.0, 0.0], ahead) * (wide * half)
            rings.append(Ring(centre, across, np.array([0.0, 0.5 * tall * high, 0.0]), weights))
        self.found[side].append(loft(rings, 0.3 * half, 0.3 * half))
        self.covered |= {joint for joint in (toe_joint,) if joint is not None}
        self.taken |= {joint for joint in (ankle_joint, toe_joint) if joint is not None}

    def _hand(self, side: str) -> None:
        if f"{side}_wrist" not in self.parts or f"{side}_elbow" not in self.parts:
            return
        wrist = self.parts[f"{side}_wrist"]
        fore = self.at(f"{side}_wrist") - self.at(f"{side}_elbow")
        if np.linalg.norm(fore) < 1e-4:
            return
        tip = self.end(wrist)
        way = fore / np.linalg.norm(fore) * 0.7 * np.linalg.norm(fore) if tip is None else tip - self.places[wrist]
        length, volume = float(np.linalg.norm(way)), HAND * self.masses[f"{side}_elbow"] / DENSITY
        radius = math.sqrt(volume / (4.0 / 3.0 * math.pi * 0.5 * length))
        frame = Ring.around(self.places[wrist], way, radius, {})
        self.found[side].append(
            ellipsoid(self.places[wrist] + 0.45 * way, (0.55 * way, 1.25 * frame.across, 0.8 * frame.deep), wrist)
        )
        self.taken.add(wrist)

    def _trunk(self) -> None:
        names = ("pelvis", "waist", "chest", "upper_chest", "neck")
        line = [self.parts[name] for name in names if name in self.parts]
        hips = [f"{side}_hip" for side in ("left", "right")]
        tops = [f"{side}_shoulder" for side in ("left", "right")]
        if "pelvis" not in self.parts or not all(part in self.parts for part in (*hips, *tops)):
            return
        low = 0.5 * (self.at(hips[0]) + self.at(hips[1]))
        shoulders = 0.5 * (self.at(tops[0]) + self.at(tops[1]))
        top = self.at("neck") if "neck" in self.parts else shoulders
        if (length := float(np.linalg.norm(top - low))) < 1e-3:
            return
        up = (top - low) / length
        left = self.at(tops[0]) - self.at(tops[1])
        left = left - (left @ up) * up
        wide, left = 0.5 * float(np.linalg.norm(left)), left / np.linalg.norm(left)
        hip = 0.5 * float(np.linalg.norm(self.at(hips[0]) - self.at(hips[1])))
        thigh = math.sqrt(self.masses[hips[0]] / DENSITY / math.pi / max(self._thigh(), 1e-3))
        broad, chest = hip + 0.95 * thigh, 0.95 * wide
        shoulder = float((shoulders - low) @ up) / length
        # Height, half width and half depth of the rings.
        outline = np.array(
            [
                (-0.09, 0.62 * broad, 0.72),
                (0.02, broad, 0.95),
                (0.14, 0.97 * broad, 0.95),
                (0.34, 0.84 * broad, 0.83),
                (0.55, max(0.9 * chest, 0.8 * broad), 0.95),
                (0.74, chest, 1.0),
                (shoulder, 0.98 * chest, 0.72),
                (max(0.97, shoulder + 0.05), 0.45 * chest, 0.5),
            ]
        )
        mass = self.masses["pelvis"] + self.masses["waist"]
        area = np.trapezoid(np.pi * outline[:, 1] * outline[:, 2], outline[:, 0] * length)
        depth = mass / DENSITY / area
        heights = [float((self.places[joint] - low) @ up) / length for joint in line]
        rings, curve = [], through(outline)
        # Evenly, for a smooth surface.
        for height in np.linspace(outline[0, 0], outline[-1, 0], 24):
            half, deep = curve(height).tolist()
            # Between two joints of the spine a ring follows both: mid-way from joint to joint it goes over.
            weights = _between(height, heights[: max(1, len(line) - 1)], line)
            centre = low + height * length * up
            rings.append(Ring(centre, half * left, depth * deep * np.cross(left, up), weights))
        self.found["middle"].append(loft(rings, 0.05 * length, 0.04 * length))
        inside = {
            self.parts[part]
            for part in (*names, *hips, *tops, *(f"{s}_collar" for s in ("left", "right")))
            if part in self.parts
        }
        # Whatever lies between them, too: a joint of the spine without a name of its own.
        self.covered |= inside | {joint for part in inside for joint in self.skeleton.above(part)}

    def _thigh(self) -> float:
        return float(np.linalg.norm(self.at("left_hip") - self.at("left_knee"))) if "left_knee" in self.parts else 0.4

    def _head(self) -> None:
        base = self.parts.get("neck", self.parts.get("head"))
        if base is None:
            return
        joint = self.parts.get("head", base)
        crown = self.end(joint)
        volume = SKULL * self.masses["neck"] / DENSITY
        ball = (volume * 3.0 / (4.0 * math.pi)) ** (1.0 / 3.0)  # radius of a round head
        if crown is None:
            way = self.places[joint] - self.places[base] if joint != base else np.array([0.0, 1.0, 0.0])
            crown = self.places[joint] + 2.2 * ball * way / np.linalg.norm(way)
        up = crown - self.places[base]
        if float(np.linalg.norm(up)) < 1e-3:
            return
        # Some skeletons end where the skull begins.
        length = max(float(np.linalg.norm(up)), 2.6 * ball)
        up = up / np.linalg.norm(up)
        crown = self.places[base] + length * up
        tall = min(0.43 * length, 1.25 * ball)
        thick = math.sqrt(volume / (4.0 / 3.0 * math.pi * tall))
        frame = Ring.around(crown, up, thick, {})
        middle = crown - tall * up + 0.08 * thick * frame.deep / thick
        self.found["middle"].append(ellipsoid(middle, (tall * up, 0.9 * frame.across, 1.1 * frame.deep), joint))
        # Without a joint of its own the neck comes from between the shoulders.
        deep = 0.1 if "neck" in self.parts else 0.35
        start, stop = self.places[base] - deep * length * up, crown - 1.2 * tall * up
        rings = [
            Ring.around(
                start + share * (stop - start),
                up,
                0.55 * thick * (1.15 - 0.15 * share),
                {base: 1.0 - share, joint: share} if joint != base else {base: 1.0},
            )
            for share in (0.0, 0.5, 1.0)
        ]
        self.found["middle"].append(loft(rings))
        self.covered |= {joint, base}
        self.taken.add(joint)

    def _bones(self) -> None:
        """Plain bones to joints and ends that no surface holds."""
        inside = self.covered | self.taken
        for joint, parent in enumerate(self.skeleton.parents):
            # Fingers lie in the hand.
            hidden = self.taken.intersection((joint, *self.skeleton.above(joint)))
            pairs = [(parent, self.places[joint])] if parent >= 0 and joint not in self.covered else []
            tip = self.end(joint)
            pairs += [(joint, tip)] if tip is not None and joint not in inside else []
            for owner, place in pairs:
                length = float(np.linalg.norm(place - self.places[owner]))
                if hidden or length < 1e-4:
                    continue
                rings = [
                    Ring.around(
                        self.places[owner] + share * (place - self.places[owner]),
                        place - self.places[owner],
                        BONE * length * size,
                        {owner: 1.0},
                    )
                    for share, size in ((0.05, 0.7), (0.25, 1.0), (0.95, 0.4))
                ]
                side = "middle" if abs(place[0]) < 1e-3 else "left" if place[0] > 0 else "right"
                self.found[side].append(loft(rings, 0.05 * length, 0.05 * length))


def _radius(mass: float, start: Floats, stop: Floats, profile: Floats) -> float:
    """Mean radius of a limb of a mass [m], whose thickness goes by a profile."""
    share = np.linspace(0.0, 1.0, 101)
    squares = through(profile)(share)[:, 0] ** 2
    return math.sqrt(mass / DENSITY / (math.pi * float(np.linalg.norm(stop - start)) * float(squares.mean())))


def _between(height: float, heights: Sequence[float], line: Sequence[int]) -> dict[int, float]:
    """Shares of the joints of the spine in a ring: that of the highest joint below it, eased over at the joints."""
    shares: dict[int, float] = {line[0]: 1.0}
    for k in range(1, len(heights)):
        room = 0.35 * max(heights[k] - heights[k - 1], 1e-6)
        past = _smooth(0.5 + 0.5 * (height - heights[k]) / room)
        shares = {joint: share * (1.0 - past) for joint, share in shares.items()} | {line[k]: past}
    return shares


def _smooth(share: float) -> float:
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)
