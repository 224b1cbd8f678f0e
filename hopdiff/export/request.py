"""What is to be written for other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hopdiff.export.retarget import Target, read_target
from hopdiff.export.settings import ExportSettings, RetargetSettings
from hopdiff.export.write import different


@dataclass(frozen=True)
class Exports:
    """What is to be written, checked. files: settings by name. target: body for the motions, if not their own.

    retarget: what the motions on it shall be.
    """

    files: Mapping[str, ExportSettings] = field(default_factory=dict)
    target: Target | None = None
    retarget: RetargetSettings = field(default_factory=RetargetSettings)

    def __bool__(self) -> bool:
        return bool(self.files) or self.target is not None

    @classmethod
    def build(cls, files: Mapping[str, ExportSettings], retarget: RetargetSettings) -> Exports:
        """Raises HopdiffError, naming setting or file, for what cannot be, before any motion is made."""
        for name, settings in files.items():
            settings.check(name)
        retarget.check_clip("retarget")
        different([file for name, settings in files.items() for file in settings.files(name)])
        target = None if retarget.skeleton is None else read_target(retarget.skeleton, retarget.names)
        return cls(files, target, retarget)
