"""hopdiff: human running motion from a speed and a briskness, without motion capture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hopdiff.api import generate, save
    from hopdiff.runs.frame import results
    from hopdiff.types import HopdiffError

__version__ = "0.1.0"
__all__ = ["HopdiffError", "__version__", "generate", "results", "save"]


def __getattr__(name: str) -> Any:
    """Load the generator when it is first used, so that its parts can be imported without the whole."""
    if name in ("generate", "save"):
        from hopdiff import api

        return getattr(api, name)
    if name == "results":
        from hopdiff.runs.frame import results

        return results
    if name == "HopdiffError":
        from hopdiff.types import HopdiffError

        return HopdiffError
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
