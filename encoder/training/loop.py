"""The training loop of all stages: resumable, with moving averages, mixed precision, processes.

A run's state is ONE safetensors file (weights, averages, optimiser; step and loss curve as JSON in
its header), replaced as a whole: after a kill at any moment the last one is valid.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import cos, pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from tqdm import tqdm

from encoder.training import parallel
from sensors import files
from sensors.types import InputError

SAVE_SECONDS = 60.0
CURVE_POINTS = 200  # of the loss curve in a card
Losses = dict[str, Tensor]
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

    def card(self, metrics: Mapping[str, float], curve: "Curve") -> dict[str, Any]:
        """The part of a checkpoint's card that is common to all stages."""
        rounded = {key: round(value, 5) for key, value in metrics.items()}
        return {"seed": self.seed, "metrics": rounded, "curve": curve, **dict(self.note)}


Curve = dict[str, list[float]]  # "step" and each loss, thinned to CURVE_POINTS


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


class Average:
    """Exponential moving average of the trained parameters; young averages follow faster."""

    def __init__(self, parameters: list[Tensor], decay: float) -> None:
        self.parameters, self.decay = parameters, decay
        self.values = [p.detach().clone() for p in parameters]

    @torch.no_grad()
    def update(self, step: int) -> None:
        keep = min(self.decay, (1 + step) / (10 + step))
        for value, parameter in zip(self.values, self.parameters, strict=True):
            value.lerp_(parameter, 1 - keep)

    @torch.no_grad()
    def use(self) -> None:
        """Copy the averages into the parameters."""
        for parameter, value in zip(self.parameters, self.values, strict=True):
            parameter.copy_(value)


class _State:
    """State of a run at a step, saved to and loaded from its file."""

    def __init__(
        self, modules: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer, decay: float
    ) -> None:
        self.modules, self.optimizer = modules, optimizer
        self.parameters = [p for group in optimizer.param_groups for p in group["params"]]
        self.average = Average(self.parameters, decay)
        self.step = 0
        self.smooth: dict[str, float] = {}
        self.curve: Curve = {"step": []}

    def note(self, losses: Losses, every: int) -> None:
        for key, tensor in losses.items():
            value = float(tensor.detach())
            old = self.smooth.get(key, value)
            self.smooth[key] = old + 0.03 * (value - old)
        if self.step % every == 0:
            self.curve["step"].append(self.step)
            for key, value in self.smooth.items():
                self.curve.setdefault(key, []).append(round(value, 5))

    def save(self, path: Path) -> None:
        tensors = {
            f"{key}/{name}": tensor
            for key, module in self.modules.items()
            for name, tensor in module.state_dict().items()
        }
        for index, (parameter, value) in enumerate(
            zip(self.parameters, self.average.values, strict=True)
        ):
            tensors[f"average/{index}"] = value
            for name, tensor in self.optimizer.state.get(parameter, {}).items():
                tensors[f"optimizer/{index}/{name}"] = tensor
        words = json.dumps({"step": self.step, "smooth": self.smooth, "curve": self.curve})
        path.parent.mkdir(parents=True, exist_ok=True)
        tensors = {name: tensor.detach().cpu().clone() for name, tensor in tensors.items()}
        with files.replacing(path) as draft:
            save_file(tensors, draft, {"run": words})

    def load(self, path: Path) -> None:
        with _opened(path) as (file, run):
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        for key, module in self.modules.items():
            prefix = f"{key}/"
            module.load_state_dict(
                {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
            )
        for index, parameter in enumerate(self.parameters):
            self.average.values[index].copy_(tensors[f"average/{index}"])
            prefix = f"optimizer/{index}/"
            self.optimizer.state[parameter] = {
                n.removeprefix(prefix): t if n.endswith("/step") else t.to(parameter.device)
                for n, t in tensors.items()
                if n.startswith(prefix)
            }
        self.step, self.smooth, self.curve = run["step"], run["smooth"], run["curve"]


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    """A state's tensors and what its header says of the run; raises InputError."""
    try:
        with safe_open(path, "pt") as file:
            yield file, json.loads((file.metadata() or {})["run"])
    except (FileNotFoundError, SafetensorError, KeyError) as error:
        raise InputError(
            f"--resume: expected the state of a run in {path}, got {error}; "
            "run the stage without --resume"
        ) from error


def steps_done(run: RunSettings) -> int:
    """Of a run that is resumed; raises InputError where it left no state."""
    with _opened(run.file) as (_, about):
        return int(about["step"])


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
    state = _State(modules, optimizer, run.average)
    if run.resume:
        state.load(run.file)
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
            with torch.autocast(device_type, torch.bfloat16, run.precision == "bfloat16"):
                losses = step_losses(step, rng)
            optimizer.zero_grad(set_to_none=True)
            losses["total"].backward()
            parallel.average_gradients(state.parameters, ranks)
            nn.utils.clip_grad_norm_(state.parameters, 1.0)
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
