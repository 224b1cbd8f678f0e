"""Do the committed tables still hold? python -m experiments.check"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from experiments.kang1999 import recheck as kang1999
from experiments.provenance import ROOT, Recheck, judge
from experiments.reach import recheck as reach
from experiments.report import markdown

HERE = ROOT / "experiments"


class Page(NamedTuple):
    """page: below experiments/. entry: the module of it, there. recheck: None if that is not cheap."""

    page: str
    entry: str
    recheck: Callable[[Path], Recheck] | None = None


# Times (bench, scale), files in other programs (exports, rigs), captured clips that are not in the repository (edits,
# joins, kim2021, ways, realism, physics), whole searches (searches) and the tests (mutants) are not priced again here.
PAGES = (
    Page("bench/results.md", "bench/__main__.py"),
    Page("edits/results.md", "edits/__main__.py"),
    Page("exports/results.md", "exports/__main__.py"),
    Page("joins/results.md", "joins/__main__.py"),
    Page("kang1999/README.md", "kang1999/__main__.py"),
    Page("kang1999/departures.md", "kang1999/departures.py", kang1999.recheck),
    Page("kim2021/README.md", "kim2021/__main__.py"),
    Page("kim2021/contacts.md", "kim2021/contacts.py"),
    Page("kim2021/table_1.md", "kim2021/table_1.py"),
    Page("mutants/results.md", "mutants/__main__.py"),
    Page("physics/results.md", "physics/__main__.py"),
    Page("reach/results.md", "reach/__main__.py", reach.recheck),
    Page("realism/results.md", "realism/__main__.py"),
    Page("rigs/results.md", "rigs/__main__.py"),
    Page("scale/results.md", "scale/__main__.py"),
    Page("searches/results.md", "searches/__main__.py"),
    Page("unchanged/results.md", "unchanged/__main__.py"),
    Page("ways/results.md", "ways/__main__.py"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m experiments.check", description=__doc__)
    parser.add_argument("--only", nargs="*", metavar="STUDY", help="such as reach kang1999")
    parser.add_argument("--folder", type=Path, default=HERE, help="where the pages are, if not in experiments/")
    given = parser.parse_args(arguments)
    pages = [page for page in PAGES if not given.only or page.page.split("/")[0] in given.only]
    if not pages:
        parser.error(
            f"no study {', '.join(given.only)}; there are {', '.join(sorted({p.page.split('/')[0] for p in PAGES}))}"
        )
    rows, stale = [], False
    for page in pages:
        found = judge(given.folder / page.page, HERE / page.entry, page.recheck)
        stale |= found.holds is False
        said = {True: "holds", False: "**no longer holds**", None: "not priced again"}[found.holds]
        commit = f"{(found.origin.commit or 'none')[:12]}{' with changes' if found.origin.changed else ''}"
        rows.append((page.page, commit, found.origin.command or "none", said, found.text))
    print(markdown(("page", "made at", "by", "verdict", "why"), rows))
    return int(stale)


if __name__ == "__main__":
    sys.exit(main())
