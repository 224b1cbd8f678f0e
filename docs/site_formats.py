"""The tables of the page of file formats that code knows."""

from __future__ import annotations

from hopdiff.export.anatomy import SCHEMES


def joint_names() -> str:
    """The joints of exports in every scheme of names."""
    head = list(SCHEMES)
    rows = [[f"`{SCHEMES[scheme][joint]}`" for scheme in head] for joint in SCHEMES["hopdiff"]]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows))
