"""From weights on disk (checkpoint.py) to torch modules."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import torch
from torch import nn

from encoder.nn.checkpoint import check_shapes
from encoder.types import Weights

Module = TypeVar("Module", bound=nn.Module)


def fill(module: Module, weights: Weights, path: Path, kind: str) -> Module:
    """Load weights into a module and set it to inference mode.

    Raises InputError where names or shapes do not match.
    """
    shapes = {name: tuple(tensor.shape) for name, tensor in module.state_dict().items()}
    check_shapes(weights, shapes, path, kind)
    module.load_state_dict({name: torch.from_numpy(array) for name, array in weights.items()})
    return module.eval()
