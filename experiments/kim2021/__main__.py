"""Build the gallery: `python -m experiments.kim2021 --clips FOLDER`."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.gallery import build
from experiments.kim2021.entries import GALLERY
from experiments.kim2021.table_1 import write_table


def main(arguments: Sequence[str] | None = None) -> None:
    given = build(GALLERY, arguments)
    if given.clips is not None and not given.figures:
        write_table(given.clips, given.out / "table_1.md")


if __name__ == "__main__":
    main()
