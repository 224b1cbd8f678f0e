"""Which parts of the body were found on a user's skeleton, for people and programs, and a file to say the rest in."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hopdiff.editing.leg_joints import SIDES
from hopdiff.whole_body.skeleton import JOINTS

NAMES_FILE = "retarget_names.yaml"
SEEN = 8  # names of joints that are told, of those that are no part


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for side in SIDES for part in parts)


# What several parts are together.
GROUPS = {
    "spine": ("waist", "chest", "upper_chest"),
    "arms": _both("shoulder", "elbow", "wrist"),
    "left arm": ("left_shoulder", "left_elbow", "left_wrist"),
    "right arm": ("right_shoulder", "right_elbow", "right_wrist"),
    "wrists": _both("wrist"),
    "collarbones": _both("collar"),
    "ankles": _both("ankle"),
    "toes": _both("toe"),
}
# Parts without which a body looks stiff; without legs it is refused.
WANTED = frozenset({"neck", "head", *_both("shoulder", "elbow", "ankle", "toe")})


@dataclass(frozen=True)
class MappingReport:
    """joints: part of the body -> name of the joint, of those that were found. others: names of the joints that are no
    part."""

    name: str
    joints: Mapping[str, str]
    others: Sequence[str]

    @classmethod
    def of(cls, name: str, names: Sequence[str], parts: Mapping[str, int]) -> MappingReport:
        """names: of all joints. parts: part -> joint."""
        known = set(parts.values())
        others = [joint for k, joint in enumerate(names) if k not in known]
        return cls(name, {part: names[parts[part]] for part in JOINTS if part in parts}, others)

    @property
    def missing(self) -> list[str]:
        return [part for part in JOINTS if part not in self.joints]

    @property
    def count(self) -> str:
        return f"{len(self.joints)} of {len(JOINTS)}"

    def sentence(self) -> str:
        """How many parts were found, which were not, and what else there is."""
        text = f"{self.name}: {self.count} parts found"
        if self.missing:
            text += f"; not {', '.join(grouped(self.missing))}"
            text += f"; other joints: {few(self.others)}" if self.others else "; no other joints"
        return text

    def warning(self) -> str | None:
        """What the user should do about it, None where nothing stays stiff that people see."""
        # A head moves without a neck.
        stiff = grouped(
            part for part in self.missing if part in WANTED and not (part == "neck" and "head" in self.joints)
        )
        if not stiff:
            return None
        return (
            f"{self.name}: {' and '.join(stiff)} not found, so that nothing moves there; write their joints into"
            f" {NAMES_FILE} of this folder and give it as retarget.names."
        )

    def numbers(self) -> dict[str, Any]:
        """The same for programs."""
        return {
            "skeleton": self.name,
            "found": len(self.joints),
            "of": len(JOINTS),
            "parts": dict(self.joints),
            "missing": self.missing,
            "other_joints": list(self.others),
        }

    def names_file(self) -> str:
        """YAML that retarget.names reads: a line for each part, blank where it was not found."""
        others = [json.dumps(one, ensure_ascii=False) for one in self.others]
        lines = [
            f"# Joints of {json.dumps(self.name, ensure_ascii=False)} by part of the body. Fill in what is blank, or",
            "# leave it, and give this file as retarget.names.",
            f"# Joints that are no part: {', '.join(others) or '-'}",
        ]
        for part in JOINTS:
            joint = self.joints.get(part)
            lines.append(f"{part}:" if joint is None else f"{part}: {json.dumps(joint, ensure_ascii=False)}")
        return "\n".join(lines) + "\n"


def grouped(parts: Iterable[str]) -> list[str]:
    """Parts by their names for people, those of a group by its name where all of them are there."""
    left, found = list(parts), []
    for name, group in GROUPS.items():
        own = [part for part in group if part in left]
        # An arm without its hand is an arm.
        core = [part for part in group if not part.endswith("wrist")] or group
        if set(core) <= set(own):
            found.append(name)
            left = [part for part in left if part not in own]
    return [*found, *(part.replace("_", " ") for part in left)]


def few(names: Sequence[str]) -> str:
    """The first of some names, and how many more there are."""
    more = len(names) - SEEN
    return ", ".join(names[:SEEN]) + (f" and {more} more" if more > 0 else "")
