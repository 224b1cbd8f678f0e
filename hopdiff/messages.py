"""How mistakes are put into words."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from hopdiff.types import HopdiffError

_KINDS = {
    **dict.fromkeys(("Float", "float"), "a number"),
    **dict.fromkeys(("Integer", "int"), "a whole number"),
    **dict.fromkeys(("Boolean", "bool"), "true or false"),
    "String": "a text",
}


def one_line(error: BaseException) -> str:
    """The first line of an exception's text."""
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0]


def near(name: str, choices: Iterable[str]) -> str:
    """' Did you mean ...?' if one of the choices resembles the name, else nothing."""
    match = get_close_matches(name, list(choices), n=1, cutoff=0.6)
    return f" Did you mean {match[0]!r}?" if match else ""


def unknown(what: str, name: str, choices: Iterable[str]) -> str:
    """The sentence for a name that is none of the choices."""
    known = sorted(choices)
    return f"Unknown {what} {name!r}: choose one of {', '.join(known)}.{near(name, known)}"


def choose(what: str, name: str, choices: Iterable[str]) -> str:
    """The name, if it is one of the choices. Raises HopdiffError otherwise."""
    if name not in (known := list(choices)):
        raise HopdiffError(unknown(what, name, known))
    return name


def wrong_value(name: str, text: str) -> str | None:
    """The sentence for OmegaConf's text on a value of the wrong type; None for texts on anything else."""
    if "is not Optional" in text or text.startswith("Incompatible value 'None'"):
        return f"{name} needs a value, not null."
    found = re.search(r"Value '(.*)' (?:of type '.*' could not be converted to|is not a valid) (\w+)", text)
    return f"{name} must be {_KINDS.get(found.group(2), found.group(2))}, not {found.group(1)!r}." if found else None


def plural(count: int, word: str) -> str:
    """1 run, 2 runs."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def say(*lines: str) -> None:
    """Print lines, though whoever reads them may have gone, as `| head` does."""
    try:
        print(*lines, sep="\n", flush=True)
    except BrokenPipeError:
        # What Python has left to print at its end goes nowhere either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def typed_names(overrides: Sequence[str]) -> list[str]:
    """The dotted names of the settings in overrides such as "speed=3", "+experiment=brisk", "~search"."""
    return [re.split("[=@:]", override.lstrip("+~"), maxsplit=1)[0] for override in overrides]
