"""Files that appear whole or not at all, and errors that say what to put right."""

from __future__ import annotations

import json
import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from hopdiff.types import HopdiffError


@contextmanager
def whole_file(path: str | os.PathLike[str], mode: str = "w") -> Iterator[IO[Any]]:
    """Open a neighbour of `path` for writing and move it into place once the block has ended well.

    mode: "w" for text (UTF-8, newlines as written) or "wb" for bytes. If the block raises, also by Ctrl-C, an older
    file at `path` stays as it was and the half-written one is removed.
    Raises HopdiffError for whatever the operating system refuses: no such folder, no permission, no space.
    """
    if mode not in ("w", "wb"):
        raise ValueError(f'mode must be "w" or "wb", not {mode!r}')
    target = Path(path)
    draft = target.with_name(f".{target.name[:80]}.{secrets.token_hex(4)}.part")
    text = {} if "b" in mode else {"encoding": "utf-8", "newline": ""}
    try:
        with open(draft, mode.replace("w", "x"), **text) as file:  # type: ignore[call-overload]
            yield file
        os.replace(draft, target)
    except OSError as error:
        raise HopdiffError(f"cannot write {target}: {_reason(error)}.") from error
    finally:
        draft.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a whole file at once; see `whole_file`."""
    with whole_file(path, "w" if isinstance(data, str) else "wb") as file:
        file.write(data)


@contextmanager
def whole_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a new folder beside `path` to write in, and move it into place once the block has ended well.

    A folder that was at `path` before is replaced. If the block raises, also by Ctrl-C, that stays as it was and the
    half-written one is removed. Raises HopdiffError for whatever the operating system refuses.
    """
    target = Path(path)
    draft, old = (target.with_name(f".{target.name[:80]}.{secrets.token_hex(4)}.part") for _ in range(2))
    try:
        draft.mkdir()
        yield draft
        if target.exists():
            os.replace(target, old)
        os.replace(draft, target)
    except OSError as error:
        raise HopdiffError(f"cannot write {target}: {_reason(error)}.") from error
    finally:
        if old.exists() and not target.exists():
            # Where even that is refused, better under a strange name than lost.
            with suppress(OSError):
                os.replace(old, target)
        else:
            shutil.rmtree(old, ignore_errors=True)
        shutil.rmtree(draft, ignore_errors=True)


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a UTF-8 file, without a byte order mark.

    Raises HopdiffError, naming the file, where it cannot be read.
    """
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise HopdiffError(f"cannot read {path}: {_reason(error)}.") from error
    except UnicodeDecodeError as error:
        raise HopdiffError(f"cannot read {path}: it is not UTF-8 text (byte {error.start}).") from error


def read_json(path: str | os.PathLike[str]) -> Any:
    """The content of a JSON file. Raises HopdiffError, naming file and line, where it cannot be read."""
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise HopdiffError(f"{path}, line {error.lineno}: not JSON ({error.msg}, column {error.colno}).") from error
    except RecursionError as error:
        raise HopdiffError(f"{path}: not a sensible JSON file (nested too deeply).") from error
    except ValueError as error:
        raise HopdiffError(f"{path}: not a sensible JSON file (a number of too many digits).") from error


def _reason(error: OSError) -> str:
    return (error.strerror or str(error) or type(error).__name__).lower()
