"""hopdiff: human running motion from a speed and a briskness, without motion capture.

generate, save       a run, and files of it for other programs
body                 the table of a body, to be changed and given to generate
results              a folder of runs as one table
optimise             any search on any problem; Search, Problem, Eval and Budget are the contract
Term                 a row of the objective, for generate(costs=[...])
HopdiffError         what is raised for whatever the user can put right

All names here are public; units are SI and radians unless a name ends in _deg or _bw. From the command line:
python -m hopdiff --help. Guides, every setting and file format: docs/.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hopdiff.api import body, generate, optimise, save
    from hopdiff.objective import Term
    from hopdiff.search.base import Eval, Problem, Search
    from hopdiff.search.loop import Budget, SearchResult
    from hopdiff.types import HopdiffError, Status

__version__ = "0.1.0"

# Public name -> the module that holds it, which is loaded when the name is first used.
_HOMES = {
    **dict.fromkeys(("body", "generate", "optimise", "save"), "hopdiff.api"),
    "Term": "hopdiff.objective",
    **dict.fromkeys(("Eval", "Problem", "Search"), "hopdiff.search.base"),
    **dict.fromkeys(("Budget", "SearchResult"), "hopdiff.search.loop"),
    **dict.fromkeys(("HopdiffError", "Status"), "hopdiff.types"),
}
__all__ = [
    "Budget",
    "Eval",
    "HopdiffError",
    "Problem",
    "Search",
    "SearchResult",
    "Status",
    "Term",
    "__version__",
    "body",
    "generate",
    "optimise",
    "save",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
