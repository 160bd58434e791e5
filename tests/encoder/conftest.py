"""Every encoder test: one thread (small tensors only lose time on more) and one torch seed."""

from __future__ import annotations

import pytest
import torch


@pytest.fixture(autouse=True)
def repeatable_torch() -> None:
    torch.set_num_threads(1)
    torch.manual_seed(0)
