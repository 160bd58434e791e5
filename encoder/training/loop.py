"""The training loop of all stages: resumable, with moving averages, mixed precision, processes.

What it keeps between steps is `state.py`'s.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, isfinite, pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from encoder import stopping
from encoder.training import parallel
from encoder.training.state import Curve, Losses, RunState, check_seed, opened
from sensors.types import InputError

SAVE_SECONDS = 60.0
CURVE_POINTS = 200  # of the loss curve in a card
StepLosses = Callable[[int, np.random.Generator], Losses]  # (step, its random source) -> losses


@dataclass(frozen=True, kw_only=True)
class RunSettings:
    """How a stage runs: files, device, precision; independent of what it trains."""

    state: Path  # without suffix
    seed: int = 0
    resume: bool = False
    device: str = "cpu"
    precision: Literal["float32", "bfloat16"] = "float32"  # of the networks' products
    compile: bool = False  # torch.compile: fused kernels, minutes to start
    average: float = 0.999  # decay of the moving average (EMA) that is written at the end
    note: tuple[tuple[str, str], ...] = ()  # for the card: command, commit, ...

    @property
    def file(self) -> Path:
        return self.state.with_suffix(".safetensors")

    def followed_by(self, name: str) -> "RunSettings":
        """Of a part that is trained after this one, with a state of its own; not resumed where
        there is none yet."""
        run = replace(self, state=self.state.with_name(f"{self.state.stem}_{name}"))
        return replace(run, resume=self.resume and run.file.is_file())

    def card(self, metrics: Mapping[str, float], curve: Curve) -> dict[str, Any]:
        """The part of a checkpoint's card that is common to all stages."""
        rounded = {key: round(value, 5) for key, value in metrics.items()}
        return {"seed": self.seed, "metrics": rounded, "curve": curve, **dict(self.note)}


def cosine(step: int, steps: int, peak: float, warmup: int = 50) -> float:
    """Learning rate of a step: linear warm-up, then a cosine down to 2 % of the peak."""
    if step < warmup:
        return peak * (step + 1) / warmup
    done = (step - warmup) / max(steps - warmup, 1)
    return peak * (0.02 + 0.98 * (0.5 + 0.5 * cos(pi * min(done, 1.0))))


def halved(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Matrices as float16, to save space; vectors and statistics keep their precision."""
    return {
        name: tensor.half() if tensor.is_floating_point() and tensor.ndim > 1 else tensor
        for name, tensor in tensors.items()
    }


def adamw(modules: Mapping[str, nn.Module], rate: float) -> torch.optim.AdamW:
    parameters = [p for module in modules.values() for p in module.parameters() if p.requires_grad]
    return torch.optim.AdamW(parameters, lr=rate, betas=(0.9, 0.98), weight_decay=0.01)


def steps_done(run: RunSettings) -> int:
    """Of a run that is resumed; raises InputError where it left no state, or had another seed."""
    with opened(run.file) as (_, about):
        pass
    check_seed(run.file, about, run.seed)
    return int(about["step"])


def _check(name: str, step: int, losses: Losses) -> None:
    """Raise InputError before a loss, or its gradient, that is no number spoils the weights."""
    if not isfinite(float(losses["total"].detach())):
        odd = [key for key, value in losses.items() if not isfinite(float(value.detach()))]
        raise InputError(
            f"train {name}, step {step}: expected finite losses, got none for {', '.join(odd)}; "
            "check the data, or train with --precision float32 or another --seed"
        )


def train(
    name: str,
    modules: Mapping[str, nn.Module],
    step_losses: StepLosses,
    *,
    steps: int,
    rate: float,
    run: RunSettings,
) -> tuple[dict[str, float], Curve]:
    """AdamW on the "total" of `step_losses` up to `steps`; leaves the averages in `modules`.

    The whole state is written about once a minute, at the end, and on Ctrl-C (which is raised again
    afterwards). Every step of every process has its own random source, so a resumed run goes on
    exactly like an unbroken one. Returns smoothed losses and their curve.
    """
    ranks = parallel.join(run.device)
    optimizer = adamw(modules, rate)
    state = RunState(modules, optimizer, run)
    if run.resume:
        state.load(run.file)
        if state.step > steps:  # its card would tell of fewer than were made
            raise InputError(
                f"--resume: expected a run of at most {steps} steps in {run.file}, got one of "
                f"{state.step}; ask for as many with --steps, or run the stage without --resume"
            )
    device_type = torch.device(run.device).type
    saved_at = time.monotonic()
    bar = tqdm(
        range(state.step, steps), initial=state.step, total=steps, desc=name, mininterval=2,
        disable=not ranks.leads,
    )  # fmt: skip
    try:
        for step in bar:
            for group in optimizer.param_groups:
                group["lr"] = cosine(step, steps, rate)
            rng = np.random.default_rng([run.seed, step, ranks.rank])
            torch.manual_seed(int(rng.integers(1 << 62)))
            with state.buffers_kept():
                with torch.autocast(device_type, torch.bfloat16, run.precision == "bfloat16"):
                    losses = step_losses(step, rng)
                _check(name, step, losses)
                optimizer.zero_grad(set_to_none=True)
                losses["total"].backward()
                parallel.average_gradients(state.parameters, ranks)
                norm = nn.utils.clip_grad_norm_(state.parameters, 1.0)
                _check(name, step, {"total": norm})
            with stopping.postponed():  # else the state would be of half a step
                optimizer.step()
                state.step = step + 1
                state.average.update(step)
                state.note(losses, max(1, steps // CURVE_POINTS))
            shown = {key: f"{value:.3g}" for key, value in state.smooth.items()}
            bar.set_postfix(shown, refresh=False)
            if ranks.leads and time.monotonic() - saved_at > SAVE_SECONDS:
                state.save(run.file)
                saved_at = time.monotonic()
    finally:
        if ranks.leads:
            state.save(run.file)
    parallel.average_buffers((b for m in modules.values() for b in m.buffers()), ranks)
    state.average.use()
    return state.smooth, state.curve
