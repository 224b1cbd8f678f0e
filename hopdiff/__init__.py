"""hopdiff: human running motion from a speed and a briskness, without motion capture.

    run = hopdiff.generate(speed=5, beta=0.7)
    hopdiff.save(run, "out", "glb", "bvh_unreal")

Everything below is public; units are SI and radians unless a name ends in _deg or _bw. From the command line:
python -m hopdiff --help. Guides and the meaning of every setting: docs/.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hopdiff.api import generate, save
    from hopdiff.types import HopdiffError

__version__ = "0.1.0"
__all__ = ["HopdiffError", "__version__", "generate", "save"]


def __getattr__(name: str) -> Any:
    """Load the generator when it is first used, so that its parts can be imported without the whole."""
    if name in ("generate", "save"):
        from hopdiff import api

        return getattr(api, name)
    if name == "HopdiffError":
        from hopdiff.types import HopdiffError

        return HopdiffError
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, those that are loaded when first used included: what help(hopdiff) lists."""
    return sorted({*globals(), *__all__})
