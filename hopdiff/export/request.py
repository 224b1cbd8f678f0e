"""What is to be written for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from hopdiff.export.retarget import Target, read_target
from hopdiff.export.settings import ExportSettings, RetargetSettings
from hopdiff.export.write import different
from hopdiff.types import HopdiffError


@dataclass(frozen=True)
class Exports:
    """What is to be written, checked. files: settings by name. target: body for the motions, if not their own.

    retarget: what the motions on it shall be.
    """

    files: Mapping[str, ExportSettings] = field(default_factory=dict)
    target: Target | None = None
    retarget: RetargetSettings = field(default_factory=RetargetSettings)

    def __post_init__(self) -> None:
        """Raises HopdiffError, naming the settings, for what cannot be had on another body."""
        again = self.retarget.cycles != 1 and self.target is not None
        for name, settings in self.files.items():
            if again and settings.format.strides:
                keys = "" if self.retarget.keys is not None else f" and set retarget.keys, as to {settings.keys}"
                raise HopdiffError(
                    f"exports.{name} is of single strides, of which retarget.cycles={self.retarget.cycles} lays several"
                    f" end to end: leave it at 1{keys}."
                )

    def __bool__(self) -> bool:
        return bool(self.files) or self.target is not None

    @classmethod
    def build(cls, files: Mapping[str, ExportSettings], retarget: RetargetSettings) -> Exports:
        """Raises HopdiffError, naming setting or file, for what cannot be, before any motion is made."""
        for name, settings in files.items():
            settings.check(name)
        retarget.check_clip("retarget")
        if retarget.skeleton is None:
            plain = RetargetSettings(names=retarget.names)
            for entry in fields(retarget):
                if getattr(retarget, entry.name) != getattr(plain, entry.name):
                    raise HopdiffError(
                        f"retarget.{entry.name} has no effect without retarget.skeleton, the body that motions are put"
                        " on: set it, too."
                    )
        different([file for name, settings in files.items() for file in settings.files(name)])
        target = None if retarget.skeleton is None else read_target(retarget.skeleton, retarget.names)
        return cls(files, target, retarget)
