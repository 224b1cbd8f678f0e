"""`hopdiff.results`: the runs below a folder as a data frame, where pandas is installed."""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hopdiff.runs.table import run_rows

# Not among the libraries that hopdiff needs.
pandas = import_module("pandas") if find_spec("pandas") else None


def results(folder: str | os.PathLike[str]) -> Any:
    """All runs at or below a folder as one table: a pandas.DataFrame where pandas is installed, else a list of dicts.

        table = hopdiff.results("multirun/2024-05-17_10-00-00")
        table.groupby("search.population")["cost"].median()

    One row a run (task=run, replay and path), in the order of the numbers in the folders' names. Columns:

    - run: path of its folder, relative to the given one.
    - status: "complete", "interrupted" (the best run so far), "failed", "running" (or ended from outside), or "broken"
      (a file of it is missing or damaged). sentence: of a failed or broken run what was wrong, else None.
    - notes: flags such as "energy_off_target", with blanks between them; "" if there is none.
    - every setting that differs among the runs, by its dotted name in config.yaml ("search.population"; a choice is
      "search.name"), and seed. What merely comes with a choice is left out: all settings of search=ga differ from those
      of search=cmaes. Lists are texts, "[[0,0],[2,6]]". The choice of "+experiment=" is "experiment".
    - all of metrics.json, SI units unless a name ends in _deg, _bw or _nm.

    What a run lacks is None (missing in a DataFrame). Folders of other tasks are passed over.
    Raises HopdiffError if there is no such folder, or no run in it.
    """
    rows = run_rows(Path(folder))
    return rows if pandas is None else pandas.DataFrame(rows)
