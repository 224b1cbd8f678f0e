from __future__ import annotations

from pathlib import Path

import pytest

from hopdiff.cli import main

# A budget for seconds, a search that needs no luck.
ARGUMENTS = ("speed=4", "beta=0.5", "seed=3", "fps=30", "search=ga", "search.population=40", "budget.evaluations=200")
# Some least run of a body, which is not searched for then.
LEAST = ("costs.least.external_work=0.2", "costs.least.contact_time=0.25")


def _run(folder: Path, *arguments: str) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["hopdiff", *ARGUMENTS, *arguments, f"hydra.run.dir={folder}"])
        assert main() == 0
    return folder


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of the default model."""
    return _run(tmp_path_factory.mktemp("finished") / "run", *LEAST)


@pytest.fixture(scope="session")
def finished_smooth(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished run of the smooth model."""
    return _run(tmp_path_factory.mktemp("finished_smooth") / "run", "model=smooth")


@pytest.fixture(params=["finished", "finished_smooth"], ids=["body", "smooth"])
def either(request: pytest.FixtureRequest) -> Path:
    """Both, one after the other."""
    folder: Path = request.getfixturevalue(request.param)
    return folder
