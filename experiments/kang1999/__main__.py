"""Build the gallery: `python -m experiments.kang1999`."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.gallery import build
from experiments.kang1999.entries import GALLERY


def main(arguments: Sequence[str] | None = None) -> None:
    build(GALLERY, arguments)


if __name__ == "__main__":
    main()
