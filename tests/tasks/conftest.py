from __future__ import annotations

from pathlib import Path

import pytest

from hopdiff.cli import main

# A budget for seconds, a search that needs no luck.
ARGUMENTS = ("speed=4", "beta=0.5", "seed=3", "fps=30", "search=ga", "search.population=40", "budget.evaluations=200")


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run."""
    folder = tmp_path_factory.mktemp("finished") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["hopdiff", *ARGUMENTS, f"hydra.run.dir={folder}"])
        assert main() == 0
    return folder
