from __future__ import annotations

from collections.abc import Iterator

import matplotlib as mpl
import pytest
import torch

mpl.use("Agg")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Small tensors are quickest on one thread, and results do not depend on the machine."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
