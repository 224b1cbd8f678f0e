"""Bodies that motions are played on: a user's own skeleton, what its joints are, and how it stands."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import torch
import yaml
from torch import Tensor

from hopdiff.editing.leg_joints import SIDES, Leg
from hopdiff.export.anatomy import CHAINS, REQUIRED, SCHEMES, parts_of
from hopdiff.export.mapping import MappingReport, few
from hopdiff.export.skin import Skin, SkinSole, skin_sole, stump_sole
from hopdiff.geometry.clip import Clip
from hopdiff.geometry.skeleton import Skeleton
from hopdiff.io.bvh import BvhFile
from hopdiff.io.files import read_text
from hopdiff.io.glb_file import GlbFile
from hopdiff.messages import near
from hopdiff.types import HopdiffError
from hopdiff.whole_body.skeleton import JOINTS

UNLIKE = 0.1  # of a leg's longer bone that the other must be long at least
UPRIGHT = 0.6  # of its length by which a leg must hang down for a body to stand
NEAR_GROUND = 0.12  # of a leg's length up to which a foot's lowest joint may be above the sole


@dataclass(frozen=True, eq=False)
class Target:
    """A body. name: for errors. parts: of the body, by the names of `full_body`, -> joint. rest: (J, 3, 3) the joints'
    orientations in the pose in which it stands upright, and every sole is level: the skeleton's own rest pose, or the
    first frame of its file where that is a heap of bones. file: where it comes from, of GLB files in the pose of the
    skeleton. skin: of that file. notes: what people should know about it."""

    name: str
    skeleton: Skeleton
    parts: Mapping[str, int]
    rest: Tensor
    file: BvhFile | GlbFile | None = None
    skin: Skin | None = None
    notes: tuple[str, ...] = ()

    @property
    def suffix(self) -> str:
        """Of the file that a motion on this body is written into."""
        return Path(self.file.path).suffix.lower() if isinstance(self.file, GlbFile) else ".bvh"

    @cached_property
    def places(self) -> Tensor:
        """(J, 3) of the joints in the rest pose [m]."""
        above = self._above()
        return self.skeleton.forward(self.skeleton.offsets[0], above.transpose(-1, -2) @ self.rest)[0]

    @cached_property
    def aligned(self) -> Skeleton:
        """The same joints with frames that are aligned with the axes in the rest pose."""
        offsets = torch.stack([self.places[k] - self.places[max(p, 0)] for k, p in enumerate(self.skeleton.parents)])
        offsets[0] = self.places[0]
        ends = {name: self.rest[self.skeleton.index(name)] @ end for name, end in self.skeleton.end_sites.items()}
        return Skeleton(self.skeleton.names, self.skeleton.parents, offsets, ends)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The left leg and the right."""
        parts = ("hip", "knee", "ankle", "toe")
        return tuple(Leg(side, *(self.parts.get(f"{side}_{part}") for part in parts)) for side in SIDES)  # type: ignore[arg-type]

    def report(self) -> MappingReport:
        """Which parts were found."""
        return MappingReport.of(Path(self.name).name, self.skeleton.names, self.parts)

    def own_frames(self, rotations: Tensor) -> Tensor:
        """Rotations (T, J, 3, 3) of the aligned joints as those of the skeleton's own."""
        return self._above().transpose(-1, -2) @ rotations @ self.rest

    def end_of(self, joint: int) -> Tensor | None:
        """(3,) from a joint to its end in the rest pose, if it has one [m]."""
        return self.aligned.end_sites.get(self.skeleton.names[joint])

    def depth(self, leg: Leg) -> float:
        """How far the sole is below the ankle in the rest pose, or below the end of the shank [m]."""
        if (sole := self.sole(leg)) is not None:
            return sole.depth
        if leg.ankle is None:
            return 0.0
        below = self.skeleton.below(leg.ankle)
        heights = [float(self.places[k, 1]) for k in below]
        heights += [float(self.places[k, 1] + end[1]) for k in below if (end := self.end_of(k)) is not None]
        lowest, thigh = min(heights), self.places[leg.hip, 1] - self.places[leg.ankle, 1]
        # A body that stands on y = 0 shows where its soles are; otherwise they are at the lowest joint of the foot.
        floor = 0.0 if 0.0 <= lowest < NEAR_GROUND * float(thigh) else lowest
        return float(self.places[leg.ankle, 1]) - floor

    def sole(self, leg: Leg) -> SkinSole | None:
        """What its skin shows of a foot; None without one."""
        return self._soles.get(leg.side)

    @cached_property
    def _soles(self) -> dict[str, SkinSole]:
        found: dict[str, SkinSole] = {}
        for leg in self.legs:
            if self.skin is None:
                continue
            if leg.ankle is None:
                sole = stump_sole(self.skin, leg.knee, self.places[leg.knee] + self.shank(leg))
            else:
                sole = skin_sole(self.skin, self.skeleton, self.places, leg.ankle, leg.toe, self.bones(leg))
            found |= {} if sole is None else {leg.side: sole}
        return found if len(found) == len(SIDES) else {}

    def upright(self) -> float:
        """How straight it stands, at most 1: the worst of the cosines of legs, hips and trunk with where they should
        point."""
        hips = self.places[[leg.hip for leg in self.legs]]
        across = hips[0] - hips[1]
        found = [1.0 - abs(float(across[1])) / max(float(across.norm()), 1e-9)]
        for leg in self.legs:
            line = self.places[leg.knee] + self.shank(leg) - self.places[leg.hip]
            found.append(-float(line[1]) / self.bones(leg))
        tops = [part for part in ("head", "neck", "left_shoulder", "upper_chest") if part in self.parts]
        if tops:
            up = self.places[self.parts[tops[0]]] - hips.mean(dim=0)
            found.append(float(up[1]) / max(float(up.norm()), 1e-9))
        return min(found)

    def standing(self) -> float:
        """Length of the stretched legs from hip to sole [m]."""
        return sum(self.bones(leg) + self.depth(leg) for leg in self.legs) / len(SIDES)

    def bones(self, leg: Leg) -> float:
        """Thigh and shank [m]."""
        return float((self.places[leg.knee] - self.places[leg.hip]).norm() + self.shank(leg).norm())

    def shank(self, leg: Leg) -> Tensor:
        """(3,) from knee to ankle, or to the end of the shank, in the rest pose [m]."""
        end = self.places[leg.ankle] - self.places[leg.knee] if leg.ankle is not None else self.end_of(leg.knee)
        assert end is not None  # `target_of` has seen to it
        return end

    def facing(self) -> float:
        """Where it faces in the rest pose, from +z towards +x, across the line from hip to hip [rad]."""
        across = self.places[self.parts["left_hip"]] - self.places[self.parts["right_hip"]]
        return 0.0 if float(across[[0, 2]].norm()) < 1e-6 else math.atan2(-float(across[2]), float(across[0]))

    def _above(self) -> Tensor:
        straight = torch.eye(3, dtype=torch.float64)
        return torch.stack([self.rest[p] if p >= 0 else straight for p in self.skeleton.parents])


def target_of(
    name: str,
    skeleton: Skeleton,
    parts: Mapping[str, int],
    pose: Tensor | None = None,
    file: BvhFile | GlbFile | None = None,
) -> Target:
    """A body, checked. pose: (J, 3, 3) rotations in which it stands if it does not with all of them 0.

    Raises HopdiffError, naming it, for parts that do not hang on each other, a missing leg, or a body that lies.
    """
    found = dict(parts)
    lacking = {side: [part for part in ("hip", "knee") if f"{side}_{part}" not in found] for side in SIDES}
    if all(lacking.values()):
        raise HopdiffError(
            f"{name} lacks a pair of legs, or its joints' names do not tell them: see retarget.names. Its joints:"
            f" {few(skeleton.names)}."
        )
    for side in SIDES:
        if lacking[side]:
            raise HopdiffError(f"{name} lacks a {side} leg: none of its joints is known to be the {lacking[side][0]}.")
        knee = found[f"{side}_knee"]
        end = skeleton.end_sites.get(skeleton.names[knee])
        if f"{side}_ankle" not in found and (end is None or float(end.norm()) < 1e-6):
            if not skeleton.children(knee):
                raise HopdiffError(f"{name} lacks a {side} leg: nothing hangs on {skeleton.names[knee]!r} to stand on.")
            found[f"{side}_ankle"] = max(skeleton.children(knee), key=lambda k: float(skeleton.offsets[k].norm()))
            found.pop(f"{side}_toe", None)
    if "pelvis" not in found:
        raise HopdiffError(f"{name} lacks a pelvis: its legs hang on no joint together.")
    for chain in CHAINS:
        for upper, lower in pairwise(part for part in chain if part in found):
            if found[upper] not in skeleton.above(found[lower]):
                ours, theirs = (skeleton.names[found[part]] for part in (lower, upper))
                raise HopdiffError(f"{name}: {ours!r} ({lower}) does not hang on {theirs!r} ({upper}).")
    straight = torch.eye(3, dtype=torch.float64).repeat(len(skeleton.names), 1, 1)
    for rotations in (straight, pose):
        if rotations is not None:
            rest = skeleton.forward(skeleton.offsets[0].double(), rotations.double())[1]
            target = Target(name, skeleton, found, rest, file)
            for leg in target.legs:
                thigh, shank = target.places[leg.knee] - target.places[leg.hip], target.shank(leg)
                short, long = sorted((float(thigh.norm()), float(shank.norm())))
                if short < UNLIKE * long:
                    raise HopdiffError(
                        f"{name} lacks a {leg.side} leg: {skeleton.names[leg.hip]!r} and {skeleton.names[leg.knee]!r}"
                        " are no thigh and shank, one of them is hardly there."
                    )
            if _stands(target):
                return target
    raise HopdiffError(
        f"{name}: its body does not stand upright in its rest pose, so that nothing can be told from it."
    )


def _stands(target: Target) -> bool:
    """Whether legs hang down, and what is known of the trunk is above them."""
    for leg in target.legs:
        ankle = target.places[leg.knee] + target.shank(leg)
        if not float(target.places[leg.hip, 1] - ankle[1]) > UPRIGHT * target.bones(leg):
            return False
    hips = target.places[[leg.hip for leg in target.legs]].mean(dim=0)
    tops = [part for part in ("head", "neck", "left_shoulder", "upper_chest") if part in target.parts]
    up = target.places[target.parts[tops[0]]] - hips if tops else hips.new_tensor((0.0, 1.0, 0.0))
    return float(up[1]) > UPRIGHT * float(up.norm())


def named_parts(skeleton: Skeleton, names: str, where: str) -> dict[str, int]:
    """Part of the body -> joint, for the names of joints that `read_target` describes. where: for errors.

    Raises HopdiffError for names that there are not, and joints that are needed and missing.
    """
    if names == "auto":
        return parts_of(skeleton)
    if Path(names).suffix in (".yaml", ".yml"):
        return _parts_in_file(skeleton, names)
    if names not in SCHEMES:
        known = ("auto", *SCHEMES)
        raise HopdiffError(
            f"names={names} must be one of {', '.join(known)}, or a YAML file with lines part: joint."
            f"{near(names, known)}"
        )
    # As programs write them: mixamorig:Hips also comes as mixamorig1:Hips, mixamorigHips and Hips.
    bare = {_bare(name): joint for joint, name in reversed(list(enumerate(skeleton.names)))}
    found = {part: bare[_bare(name)] for part, name in SCHEMES[names].items() if _bare(name) in bare}
    for part in REQUIRED:
        if part not in found:
            wanted = SCHEMES[names][part]
            hint = near(wanted, skeleton.names)
            raise HopdiffError(f"{where} has no joint {wanted!r} ({part}), which names={names} needs.{hint}")
    return found


def _bare(name: str) -> str:
    return re.sub(r"^mixamorig\d*[:_ ]?", "", name).lower()


def _parts_in_file(skeleton: Skeleton, path: str) -> dict[str, int]:
    try:
        content = yaml.safe_load(read_text(path))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise HopdiffError(f"{path}, line {line}: not YAML ({error.problem or error.context}).") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise HopdiffError(f"{path}: not a sensible YAML file ({type(error).__name__}).") from error
    if not isinstance(content, dict) or not content:
        raise HopdiffError(f"{path} must hold lines part: joint, such as left_hip: LeftUpLeg.")
    found: dict[str, int] = {}
    for part, joint in content.items():
        if part not in JOINTS:
            raise HopdiffError(
                f"{path}: there is no part {str(part)!r}; parts are {', '.join(JOINTS)}.{near(str(part), JOINTS)}"
            )
        if joint is None:
            continue
        if joint not in skeleton.names:
            hint = near(str(joint), skeleton.names)
            raise HopdiffError(f"{path}: {part} is {str(joint)!r}, but the skeleton has no such joint.{hint}")
        if (index := skeleton.index(joint)) in found.values():
            raise HopdiffError(f"{path}: {joint!r} is given for two parts.")
        found[part] = index
    for part in REQUIRED:
        if part not in found:
            raise HopdiffError(f"{path} lacks {part}, which is needed.")
    return found


def body_of(name: str, clip: Clip) -> Target:
    """The body that a clip is on. Raises HopdiffError, naming it, if its legs cannot be told."""
    pose = clip.rotations[0] if clip.frames else None
    return target_of(name, clip.skeleton, parts_of(clip.skeleton), pose)
