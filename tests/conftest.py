from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import hypothesis
import matplotlib as mpl
import pytest
import torch

mpl.use("Agg")
# Examples are the same each time, so that what passed passes again; nothing is kept in the tree.
hypothesis.settings.register_profile("hopdiff", database=None, derandomize=True)
hypothesis.settings.load_profile("hopdiff")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """`few(n)`: of the cases of a test the first of every n is run at once, the others are marked thorough."""
    seen: Counter[str] = Counter()
    for item in items:
        if (few := item.get_closest_marker("few")) is not None:
            test = item.nodeid.partition("[")[0]
            if seen[test] % few.args[0]:
                item.add_marker(pytest.mark.thorough)
            seen[test] += 1


@pytest.fixture(autouse=True, scope="session")
def nothing_compiled(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Whatever the user has compiled, tests know nothing of it, nor do the programs that they start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOPDIFF_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small tensors are quickest on one thread, and results do not depend on the machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
