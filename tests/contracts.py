"""The streaming contract as one check (encoder/nn/streaming.py): apply it to every Streamable.

step == forward for random chunkings, values and gradients; NaN in the future changes nothing, nor
does NaN in entries of a new state that are called stale; a saved state resumes exactly; the
declared delay is the measured one.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from math import ceil

import torch
from torch import Tensor

from encoder.nn.streaming import State, Streamable

TOLERANCE = {torch.float32: 1e-5, torch.float64: 1e-9}


def chunkings(length: int, block: int, seed: int, count: int = 4) -> list[list[int]]:
    """Whole, block by block, and random splits of `length` into multiples of `block`."""
    draw = random.Random(seed)
    result = [[length], [block] * (length // block)]
    for _ in range(count - 2):
        left, sizes = length // block, []
        while left:
            sizes.append(draw.randint(1, min(left, 7)))
            left -= sizes[-1]
        result.append([size * block for size in sizes])
    return result


def run_steps(module: Streamable, x: Tensor, sizes: list[int], state: State) -> Tensor:
    """Step through x [B, T, C] in chunks; fails if a step writes into the state it was given."""
    outputs = []
    for chunk in x.split(sizes, 1):
        before = {key: value.clone() for key, value in state.items()}
        y, after = module.step(chunk, state)
        for key, value in before.items():
            assert torch.equal(value.nan_to_num(7), state[key].nan_to_num(7)), f"{key} was written"
        outputs.append(y)
        state = after
    return torch.cat(outputs, 1)


def assert_close(actual: Tensor, expected: Tensor, what: str, slack: float = 1.0) -> None:
    assert actual.shape == expected.shape, f"{what}: {actual.shape} != {expected.shape}"
    if expected.numel() == 0:
        return
    scale = float(expected.abs().max().clamp(min=1.0))
    error = float((actual - expected).abs().max()) / scale
    assert error <= slack * TOLERANCE[expected.dtype], f"{what}: error {error:.2e}"  # NaN fails too


def check_streaming(
    module: Streamable,
    x: Tensor,  # [B, T, C], T a multiple of the block size
    *,
    stale: Iterable[str] = (),  # entries of a new state that nothing may read yet
    junk: tuple[float, ...] = (float("nan"), 1e3),  # the future; no NaN where offline masks by zero
    seed: int = 0,
) -> None:
    batch, length = x.shape[:2]
    block = module.block_size
    assert length % block == 0 and length // block >= 4
    expected = module.forward(x).detach()
    assert len(expected[0]) >= int(length * module.ratio) and expected.std() > 0
    for sizes in chunkings(length, block, seed):
        state = module.init_state(batch)
        assert_close(run_steps(module, x, sizes, state).detach(), expected, f"chunks {sizes[:9]}")
    if stale:
        state = module.init_state(batch)
        state |= {name: torch.full_like(state[name], float("nan")) for name in stale}
        actual = run_steps(module, x, [block] * (length // block), state)
        assert_close(actual.detach(), expected, "stale NaN")
    _check_gradients(module, x, seed)
    _check_future(module, x, expected, junk)
    _check_resume(module, x, expected)
    assert measured_delay(module, x) == module.delay, "delay is not the declared one"


def _check_gradients(module: Streamable, x: Tensor, seed: int) -> None:
    gradients = []
    sizes = chunkings(x.shape[1], module.block_size, seed)[-1]
    for streaming in (False, True):
        leaf = x.clone().requires_grad_()
        state = module.init_state(len(x))
        y = run_steps(module, leaf, sizes, state) if streaming else module.forward(leaf)
        weight = torch.linspace(-1, 1, y.numel(), dtype=y.dtype).reshape(y.shape)
        (gradient,) = torch.autograd.grad((y * weight).sum(), leaf)
        gradients.append(gradient)
    assert gradients[0].abs().max() > 0
    scale = gradients[0].abs().max()
    # Sums of hundreds of terms in another order: float64 shows that only rounding differs.
    assert_close(gradients[1] / scale, gradients[0] / scale, "gradients", slack=5.0)


def _check_future(module: Streamable, x: Tensor, expected: Tensor, junk: tuple[float, ...]) -> None:
    block = module.block_size
    for cut in (block, x.shape[1] // block // 2 * block):
        outputs = module.forward(x[:, :cut]).shape[1]
        for value in junk:
            poisoned = x.clone()
            poisoned[:, cut:] = value
            actual = module.forward(poisoned)[:, :outputs].detach()
            assert_close(actual, expected[:, :outputs], f"future {value} after {cut}")


def _check_resume(module: Streamable, x: Tensor, expected: Tensor) -> None:
    block = module.block_size
    cut = x.shape[1] // block // 3 * block
    first, state = module.step(x[:, :cut], module.init_state(len(x)))
    saved = {key: value.detach().clone() for key, value in state.items()}
    module.step(torch.full_like(x[:, cut:], 5.0), state)  # another future of the same state
    rest, _ = module.step(x[:, cut:], saved)
    assert_close(torch.cat([first, rest], 1).detach(), expected, "resume")


def measured_delay(module: Streamable, x: Tensor) -> int:
    """Least distance from an output's block end back to the newest input it reads, by gradient."""
    leaf = x[:1].clone().requires_grad_()
    y = module.forward(leaf)
    delays = []
    for k in range(y.shape[1] // 2, min(y.shape[1] // 2 + 6, y.shape[1])):
        weight = torch.randn(y.shape[2], generator=torch.Generator().manual_seed(k)).to(y)
        (gradient,) = torch.autograd.grad(y[0, k] @ weight, leaf, retain_graph=True)
        newest = int(gradient[0].abs().amax(-1).nonzero().max())
        delays.append(ceil((k + 1) / module.ratio) - 1 - newest)
    return min(delays)


def noise(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def lively(module: torch.nn.Module, seed: int = 0) -> torch.nn.Module:
    """Zero-initialised gates and default statistics hide errors: replace them."""
    generator = torch.Generator().manual_seed(seed)
    for name, parameter in module.named_parameters():
        if "modulate" in name or "null" in name:
            torch.nn.init.normal_(parameter, std=0.3, generator=generator)
    for part in module.modules():
        if isinstance(part, torch.nn.BatchNorm1d):
            part.running_mean.normal_(0, 0.05, generator=generator)  # type: ignore[union-attr]
            part.running_var.uniform_(0.01, 0.1, generator=generator)  # type: ignore[union-attr]
    return module.eval()
