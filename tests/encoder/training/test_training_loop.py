"""The loop under every stage: resuming, averages, damaged states, two processes, half precision."""

import os
import runpy
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from torch import nn

from encoder.training import loop
from encoder.training.loop import RunSettings
from encoder.training.stages import audio, contact, diffusion, distill, emotion, eyes, multimodal
from sensors.types import InputError

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]


def make() -> dict[str, nn.Module]:
    torch.manual_seed(0)
    return {"net": nn.Linear(3, 1)}


def train(
    modules: dict[str, nn.Module], run: loop.RunSettings, stop: int = 6, steps: int = 6
) -> None:
    def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
        if step >= stop:
            raise KeyboardInterrupt
        x = torch.randn(4, 3) + torch.tensor(rng.standard_normal(3), dtype=torch.float32)
        return {"total": (modules["net"](x) - x.sum(-1, keepdim=True)).square().mean()}

    loop.train("test", modules, step_losses, steps=steps, rate=0.1, run=run)


def test_resuming_equals_an_unbroken_run(tmp_path):
    whole, broken, resumed = make(), make(), make()
    train(whole, loop.RunSettings(state=tmp_path / "whole"))
    run = loop.RunSettings(state=tmp_path / "broken")
    with pytest.raises(KeyboardInterrupt):
        train(broken, run, stop=3)
    train(resumed, replace(run, resume=True))
    torch.testing.assert_close(resumed["net"].state_dict(), whole["net"].state_dict())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["broken.safetensors", "whole.safetensors"]


def test_a_full_disk_is_told_with_the_name_of_the_state(tmp_path):
    """Red before: a traceback of another library's error, at the end of the training."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        with pytest.raises(OSError, match=r"File too large: .*state\.safetensors"):
            train(make(), loop.RunSettings(state=tmp_path / "state"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


def test_what_is_left_is_the_average(tmp_path):
    modules = make()
    train(modules, loop.RunSettings(state=tmp_path / "state", average=0.5), steps=40, stop=40)
    last = load_file(tmp_path / "state.safetensors")
    assert torch.equal(modules["net"].weight, last["average/0"])
    assert not torch.equal(last["average/0"], last["net/weight"])


def test_resume_without_a_state_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match="without --resume"):
        train(make(), loop.RunSettings(state=tmp_path / "none", resume=True))
    (tmp_path / "bad.safetensors").write_bytes(b"\x08\0\0\0\0\0\0\0garbage!")
    with pytest.raises(InputError, match="without --resume"):
        train(make(), loop.RunSettings(state=tmp_path / "bad", resume=True))


def test_a_later_part_has_a_state_of_its_own_and_starts_anew_where_there_is_none(tmp_path):
    run = loop.RunSettings(state=tmp_path / "state", resume=True, seed=3)
    later = run.followed_by("late")
    assert later == replace(run, state=tmp_path / "state_late", resume=False)
    train(make(), later)
    assert later.file.is_file() and not run.file.exists()
    assert run.followed_by("late").resume
    assert not replace(run, resume=False).followed_by("late").resume


def test_half_precision_trains_and_keeps_full_weights(tmp_path):
    modules = make()
    run = loop.RunSettings(state=tmp_path / "state", precision="bfloat16")
    train(modules, run, steps=200, stop=200)
    assert modules["net"].weight.dtype == torch.float32
    assert (modules["net"].weight - 1).abs().max() < 0.1


WORKER = """
import os, sys
from pathlib import Path
import numpy as np, torch
from encoder.training import loop

rank = int(os.environ.get("RANK", "0"))
both = "RANK" not in os.environ
torch.manual_seed(0)
net = {"net": torch.nn.Linear(3, 1)}

def draw(step, rank):
    x = np.random.default_rng([step, rank]).standard_normal((4, 3))
    return torch.tensor(x, dtype=torch.float32)

def step_losses(step, rng):
    x = torch.cat([draw(step, 0), draw(step, 1)]) if both else draw(step, rank)
    return {"total": (net["net"](x) - x.sum(-1, keepdim=True)).square().mean()}

out = Path(sys.argv[1])
run = loop.RunSettings(state=out / f"s{rank}_{both}")
loop.train("test", net, step_losses, steps=5, rate=0.1, run=run)
np.save(out / f"weights_{rank}_{both}.npy", net["net"].weight.detach().numpy())
"""


def test_two_processes_take_the_step_of_the_whole_batch(tmp_path, monkeypatch):
    """torchrun with gloo: both processes end with the weights of one that sees both batches."""
    script = tmp_path / "worker.py"
    script.write_text(WORKER)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    launcher = [
        "-m", "torch.distributed.run", "--nproc-per-node=2", "--master-addr=127.0.0.1",
        "--master-port=0", "--rdzv-backend=c10d", "--rdzv-endpoint=127.0.0.1:0",
    ]  # fmt: skip
    subprocess.run(
        [sys.executable, *launcher, str(script), str(tmp_path)],
        check=True, env=environment, capture_output=True, timeout=120,
    )  # fmt: skip
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path)])
    runpy.run_path(str(script))
    first, second, alone = (
        np.load(tmp_path / f"weights_{name}.npy") for name in ("0_False", "1_False", "0_True")
    )
    assert np.array_equal(first, second)
    np.testing.assert_allclose(first, alone, atol=1e-6)
    states = {p.name for p in tmp_path.glob("s*.safetensors")}
    assert states == {"s0_False.safetensors", "s0_True.safetensors"}


class Halting(nn.Module):
    """A network with running means; sends Ctrl-C in its forward pass."""

    def __init__(self, at: int) -> None:
        super().__init__()
        self.norm, self.layer, self.calls, self.at = nn.BatchNorm1d(3), nn.Linear(3, 1), 0, at

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = self.layer(self.norm(x))
        self.calls += 1
        if self.calls == self.at:
            os.kill(os.getpid(), signal.SIGINT)
        return y


def halting(at: int = 0) -> dict[str, nn.Module]:
    torch.manual_seed(0)
    return {"net": Halting(at)}


def same(modules: dict[str, nn.Module], others: dict[str, nn.Module]) -> bool:
    one, other = (m["net"].state_dict() for m in (modules, others))
    return all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("place", ["forward", "update"])
def test_ctrl_c_amid_a_step_leaves_none_of_it(tmp_path, monkeypatch, place):
    """Red before: running means of the broken step were kept, and Ctrl-C amid an update kept a part
    of its weights, so that the resumed run took that step twice."""
    whole, broken, resumed = halting(), halting(3 * (place == "forward")), halting()
    train(whole, loop.RunSettings(state=tmp_path / "whole"))
    run = loop.RunSettings(state=tmp_path / "broken")
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        if place == "update":

            def halt(optimizer: torch.optim.Optimizer, *_: object) -> None:
                if optimizer.state[optimizer.param_groups[0]["params"][0]].get("step", 0) == 2:
                    os.kill(os.getpid(), signal.SIGINT)

            patch.setattr(loop, "adamw", hooked(halt))
        train(broken, run)
    train(resumed, replace(run, resume=True))
    assert same(resumed, whole)


def hooked(hook: Callable[..., None]) -> Callable[..., torch.optim.Optimizer]:
    """`adamw` with this called after each of its updates."""
    make = loop.adamw

    def made(*words: Any) -> torch.optim.Optimizer:
        optimizer = make(*words)
        optimizer.register_step_post_hook(hook)
        return optimizer

    return made


def test_resuming_with_other_settings_says_so(tmp_path):
    """Red before: another preset ended in a traceback, another seed was noted in the card only."""
    run = loop.RunSettings(state=tmp_path / "state")
    train(make(), run)
    with pytest.raises(InputError, match=r"with --seed 1 .* got one with --seed 0; repeat"):
        train(make(), replace(run, seed=1, resume=True))
    with pytest.raises(InputError, match="sizes of this preset"):
        train({"net": nn.Linear(4, 1)}, replace(run, resume=True))
    with pytest.raises(InputError, match="sizes of this preset"):
        train({"other": nn.Linear(3, 1)}, replace(run, resume=True))


def test_a_run_is_not_resumed_to_fewer_steps_than_it_has_made(tmp_path):
    """Red before: its weights were written with a card that told of fewer."""
    run = loop.RunSettings(state=tmp_path / "state")
    train(make(), run, steps=3)
    with pytest.raises(InputError, match="at most 2 steps .* got one of 3; ask for as many"):
        train(make(), replace(run, resume=True), steps=2)


def test_a_loss_that_is_no_number_ends_the_run_before_it_spoils_the_weights(tmp_path):
    modules, run = make(), loop.RunSettings(state=tmp_path / "state")

    def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
        loss = modules["net"](torch.ones(1, 3)).sum()
        return {
            "simple": loss,
            "odd": loss * (torch.nan if step else 1),
            "total": loss / (1 - step),
        }

    with pytest.raises(
        InputError, match="train test, step 1: expected finite losses, .* for odd, t"
    ):
        loop.train("test", modules, step_losses, steps=3, rate=0.1, run=run)
    kept = load_file(run.file)
    assert all(bool(tensor.isfinite().all()) for tensor in kept.values())


def test_a_gradient_that_is_no_number_ends_the_run_before_it_spoils_the_weights(tmp_path):
    """Red before: the state held NaN alone, and could not be resumed."""
    modules, run = make(), loop.RunSettings(state=tmp_path / "state")

    def step_losses(step: int, rng: np.random.Generator) -> loop.Losses:
        loss = modules["net"](torch.ones(1, 3)).sum()
        return {"total": loss + (loss * 0).sqrt() if step else loss}  # 0, of slope infinite

    with pytest.raises(InputError, match="train test, step 1: expected finite losses"):
        loop.train("test", modules, step_losses, steps=3, rate=0.1, run=run)
    assert all(bool(tensor.isfinite().all()) for tensor in load_file(run.file).values())


PATHS = {
    audio: ("pack", "output"),
    contact: ("streams", "student", "output"),
    diffusion: ("streams", "output"),
    distill: ("streams", "teacher", "output"),
    emotion: ("streams", "student", "output"),
    eyes: ("pictures", "output"),
    multimodal: ("streams", "student", "eyes", "output"),
}


@pytest.mark.parametrize("stage", PATHS, ids=lambda stage: stage.__name__.split(".")[-1])
def test_settings_win_over_the_preset(stage) -> None:
    needed = {name: Path(name) for name in PATHS[stage]} | {"run": RunSettings(state=Path("state"))}
    default = stage.preset("default", **needed)
    for name in ("debug", "paper"):
        plain = stage.preset(name, **needed)
        assert plain.steps != default.steps
        asked = stage.preset(name, steps=10, rate=0.5, **needed)
        assert (asked.steps, asked.rate) == (10, 0.5)


def test_an_unknown_preset_is_named_with_the_known_ones() -> None:
    with pytest.raises(InputError, match="debug, default, paper, got 'papre'"):
        diffusion.preset("papre")


def test_fine_tuning_takes_the_loss_of_the_lips_that_it_is_given() -> None:
    needed = {name: Path(name) for name in PATHS[emotion]} | {
        "run": RunSettings(state=Path("state"))
    }
    assert emotion.preset("default", fine_tune=True, **needed).lip_weight > 0
    assert emotion.preset("default", fine_tune=True, lip_weight=0.0, **needed).lip_weight == 0
