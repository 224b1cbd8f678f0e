# No `from __future__ import annotations`: Hydra reads the types of the settings classes.
"""What a user can set about ways through scenes."""

import math
from dataclasses import dataclass, fields

from hopdiff.messages import choose
from hopdiff.types import HopdiffError

POSES = ("any", "standing")
# Settings that there were, and what does it now.
GONE = {
    "way.seconds": "ways are limited by steps of the search, the same on every machine: use way.expansions=NUMBER",
    "way.leg": "ways of any length are found in one search: leave it out, or raise way.expansions",
}


@dataclass
class WaySettings:
    """half_width: of the body, kept free around its path [m]. radius [m], angle_deg: how near to the goal the search
    ends; the edit does the rest. weight: of the distance to go against the time gone: 1 finds the quickest way, more
    finds one sooner. blend_cost: what a transition counts for [s]. bend: how much the clips may be made to turn more
    than they do, where they hold no walk as they are [degrees/s]. expansions: steps of the search, at most; a limit of
    time would let a busy machine find other ways than a free one. start, end: "any" frame of the graph or "standing"
    ones. start_frame: the one to start at, in place of those. tries: finished ways that are edited and checked, at
    most, in each of several searches.
    """

    half_width: float
    radius: float
    angle_deg: float
    weight: float
    blend_cost: float
    bend: float
    expansions: int
    start: str
    start_frame: int | None
    end: str
    tries: int

    def check(self) -> None:
        """Raises HopdiffError, naming the setting, for a number out of its range."""
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, float) and not math.isfinite(value):
                raise HopdiffError(f"way.{one.name} must be a finite number.")
        for name in ("radius", "angle_deg", "expansions", "tries"):
            if not getattr(self, name) > 0:
                raise HopdiffError(f"way.{name} must be above 0, not {getattr(self, name):g}.")
        for name in ("half_width", "blend_cost", "bend"):
            if not getattr(self, name) >= 0:
                raise HopdiffError(f"way.{name} must be 0 or more, not {getattr(self, name):g}.")
        if not self.weight >= 1:
            raise HopdiffError(f"way.weight must be 1 or more, not {self.weight:g}.")
        choose("way.start", self.start, POSES)
        choose("way.end", self.end, POSES)
