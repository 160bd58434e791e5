"""What all stages share: a resumable loop with a progress bar that Ctrl-C leaves safely."""

import time
from collections.abc import Callable, Mapping
from math import cos, pi
from pathlib import Path
from typing import Any

import torch
from torch import nn
from tqdm import tqdm

from sensors.types import InputError

SAVE_SECONDS = 60.0


def cosine(step: int, steps: int, peak: float, warmup: int = 50) -> float:
    """Learning rate of a step: linear warm-up, then a cosine down to 2 % of the peak."""
    if step < warmup:
        return peak * (step + 1) / warmup
    done = (step - warmup) / max(steps - warmup, 1)
    return peak * (0.02 + 0.98 * (0.5 + 0.5 * cos(pi * min(done, 1.0))))


def halved(tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Matrices as float16, to ship small; vectors and statistics keep their precision."""
    return {
        name: tensor.half() if tensor.is_floating_point() and tensor.ndim > 1 else tensor
        for name, tensor in tensors.items()
    }


def adamw(modules: Mapping[str, nn.Module], rate: float) -> torch.optim.AdamW:
    parameters = [p for module in modules.values() for p in module.parameters() if p.requires_grad]
    return torch.optim.AdamW(parameters, lr=rate, betas=(0.9, 0.98), weight_decay=0.01)


def train(
    name: str,
    modules: Mapping[str, nn.Module],
    optimizer: torch.optim.Optimizer,
    step_losses: Callable[[int], dict[str, torch.Tensor]],
    *,
    steps: int,
    rate: float,
    state_path: Path,
    resume: bool,
) -> dict[str, float]:
    """Run `step_losses(step) -> {name: loss}` up to `steps`, minimising "total".

    The whole state goes to `state_path` about once a minute, at the end, and on Ctrl-C (which is
    raised again afterwards). Every step draws from its own seed, so a resumed run goes on exactly
    like an unbroken one. Returns smoothed losses.
    """
    first = 0
    if resume:
        if not state_path.is_file():
            raise InputError(
                f"--resume: expected {state_path}, found none; run the stage without --resume"
            )
        state = torch.load(state_path, weights_only=True)
        first = state["step"]
        optimizer.load_state_dict(state["optimizer"])
        for key, module in modules.items():
            module.load_state_dict(state[key])

    def save(step: int) -> None:
        state: dict[str, Any] = {"step": step, "optimizer": optimizer.state_dict()}
        state.update({key: module.state_dict() for key, module in modules.items()})
        state_path.parent.mkdir(parents=True, exist_ok=True)
        partial = state_path.with_suffix(".partial")
        torch.save(state, partial)
        partial.replace(state_path)

    smooth: dict[str, float] = {}
    done, saved_at = first, time.monotonic()
    bar = tqdm(range(first, steps), initial=first, total=steps, desc=name, mininterval=2)
    try:
        for step in bar:
            for group in optimizer.param_groups:
                group["lr"] = cosine(step, steps, rate)
            torch.manual_seed(step)
            losses = step_losses(step)
            optimizer.zero_grad(set_to_none=True)
            losses["total"].backward()
            parameters = [p for group in optimizer.param_groups for p in group["params"]]
            nn.utils.clip_grad_norm_(parameters, 1.0)
            optimizer.step()
            done = step + 1
            for key, value in losses.items():
                old = smooth.get(key, float(value.detach()))
                smooth[key] = old + 0.03 * (float(value.detach()) - old)
            bar.set_postfix({key: f"{value:.3g}" for key, value in smooth.items()}, refresh=False)
            if time.monotonic() - saved_at > SAVE_SECONDS:
                save(done)
                saved_at = time.monotonic()
    finally:
        save(done)
    return smooth
