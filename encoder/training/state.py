"""What a training run keeps between steps, in memory and on disk.

A run's state is ONE safetensors file (weights, averages, optimiser; seed, step and loss curve as
JSON in its header), replaced as a whole: after a kill at any moment the last one is valid.
"""

import json
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from sensors import files
from sensors.types import InputError

Losses = dict[str, Tensor]
Curve = dict[str, list[float]]  # "step" and each loss, thinned


class Settings(Protocol):
    """What of a run's settings a state depends on."""

    @property
    def seed(self) -> int: ...
    @property
    def average(self) -> float: ...


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


class RunState:
    """State of a run at a step, saved to and loaded from its file."""

    def __init__(
        self, modules: Mapping[str, nn.Module], optimizer: torch.optim.Optimizer, run: Settings
    ) -> None:
        self.modules, self.optimizer, self.seed = modules, optimizer, run.seed
        self.parameters = [p for group in optimizer.param_groups for p in group["params"]]
        self.average = Average(self.parameters, run.average)
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

    @contextmanager
    def buffers_kept(self) -> Generator[None]:
        """Running means are as before a block that fails or is stopped: its step is taken anew."""
        buffers = [buffer for module in self.modules.values() for buffer in module.buffers()]
        before = [buffer.clone() for buffer in buffers]
        try:
            yield
        except BaseException:
            for buffer, old in zip(buffers, before, strict=True):
                buffer.copy_(old)
            raise

    def _tensors(self) -> dict[str, Tensor]:
        """Weights and averages by their names in the file."""
        tensors = {
            f"{key}/{name}": tensor
            for key, module in self.modules.items()
            for name, tensor in module.state_dict().items()
        }
        return tensors | {f"average/{k}": value for k, value in enumerate(self.average.values)}

    def save(self, path: Path) -> None:
        tensors = self._tensors()
        for index, parameter in enumerate(self.parameters):
            for name, tensor in self.optimizer.state.get(parameter, {}).items():
                tensors[f"optimizer/{index}/{name}"] = tensor
        words = json.dumps(
            {"seed": self.seed, "step": self.step, "smooth": self.smooth, "curve": self.curve}
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        tensors = {name: tensor.detach().cpu().clone() for name, tensor in tensors.items()}
        files.write_bytes(path, save(tensors, {"run": words}))

    def load(self, path: Path) -> None:
        """Raises InputError where the file is damaged, or of a run with other settings."""
        with opened(path) as (file, run):
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        check_seed(path, run, self.seed)
        known = {name: tensor.shape for name, tensor in self._tensors().items()}
        kept = {name: tensor.shape for name, tensor in tensors.items()}
        if {n: s for n, s in kept.items() if not n.startswith("optimizer/")} != known:
            raise _of_another(path, "the sizes of this preset", "others")
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
def opened(path: Path) -> Iterator[tuple[Any, dict[str, Any]]]:
    """A state's tensors and what its header says of the run; raises InputError."""
    try:
        with safe_open(path, "pt") as file:
            yield file, json.loads((file.metadata() or {})["run"])
    except (FileNotFoundError, SafetensorError, KeyError, ValueError) as error:
        raise InputError(
            f"--resume: expected the state of a run in {path}, got {error}; "
            "run the stage without --resume"
        ) from error


def check_seed(path: Path, run: dict[str, Any], seed: int) -> None:
    """Raises InputError unless `run`, of a state's header, had this seed."""
    if (kept := run.get("seed", seed)) != seed:
        raise _of_another(path, f"--seed {seed}", f"--seed {kept}")


def _of_another(path: Path, expected: str, got: str) -> InputError:
    return InputError(
        f"--resume: expected the state of a run with {expected} in {path}, got one with {got}; "
        "repeat its settings, or run the stage without --resume"
    )
