"""Build the gallery: `python -m experiments.kim2021 --clips FOLDER`."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.gallery import build
from experiments.kim2021.entries import GALLERY


def main(arguments: Sequence[str] | None = None) -> None:
    build(GALLERY, arguments)


if __name__ == "__main__":
    main()
