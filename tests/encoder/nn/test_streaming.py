"""Every Streamable of the encoder keeps the contract, and wrong ones are caught."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest
import torch
from contracts import check_streaming
from torch import Tensor, nn

from encoder.audio.alignment import AudioFeatures, CausalLerp, Stack
from encoder.audio.config import PRESETS, AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.audio.resample import Resample
from encoder.denoiser.config import DenoiserConfig
from encoder.denoiser.model import Denoiser
from encoder.nn.streaming import Buffered, State

WAV2VEC = AudioEncoderConfig(
    kind="wav2vec-large", sample_rate=16_000, feature_dim=0,
    layers=((8, 10, 5), (8, 8, 4), (8, 4, 2), (8, 4, 2), (8, 4, 2), (8, 1, 1), (8, 1, 1)),
    context=((2, 1), (3, 1), (13, 1)),
)  # fmt: skip
PAIR = replace(PRESETS["debug"], second=replace(PRESETS["phonetic-debug"], past_ticks=2))
AUDIO_CONFIGS = [PAIR, PRESETS["phonetic-debug"], PRESETS["debug"], WAV2VEC]


def noise(*shape: int, seed: int = 0, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def lively(module: nn.Module, seed: int = 0) -> nn.Module:
    """Zero-initialised gates and default statistics hide errors: replace them."""
    generator = torch.Generator().manual_seed(seed)
    for name, parameter in module.named_parameters():
        if "modulate" in name or "null" in name:
            nn.init.normal_(parameter, std=0.3, generator=generator)
    for part in module.modules():
        if isinstance(part, nn.BatchNorm1d):
            part.running_mean.normal_(0, 0.05, generator=generator)  # type: ignore[union-attr]
            part.running_var.uniform_(0.01, 0.1, generator=generator)  # type: ignore[union-attr]
    return module.eval()


class DenoiserStream(nn.Module):
    """The denoiser's three inputs side by side, at tau = N, as one Streamable."""

    block_size, ratio, delay = 1, Fraction(1), 0

    def __init__(self, config: DenoiserConfig) -> None:
        super().__init__()
        self.inner = lively(Denoiser(config))
        self.sizes = [config.expression_dim, config.audio_dim, config.condition_dim]

    def init_state(self, batch: int) -> State:
        return self.inner.init_state(batch)

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        noisy, audio, condition = x.split(self.sizes, -1)
        return self.inner.step(noisy, self.tau(x), audio, condition, state)

    def forward(self, x: Tensor) -> Tensor:
        noisy, audio, condition = x.split(self.sizes, -1)
        return self.inner(noisy, self.tau(x), audio, condition)

    def tau(self, x: Tensor) -> Tensor:
        return torch.full((len(x),), 200)


def poison_cache(state: State) -> State:
    nan = float("nan")
    return {**state, "keys": state["keys"] * nan, "values": state["values"] * nan}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("attention", ["softmax", "linear"])
def test_denoiser(attention: str, dtype: torch.dtype) -> None:
    config = DenoiserConfig(
        expression_dim=12, audio_dim=8, layers=2, dim=32, ff_dim=48, window=5, attention=attention,
        contact=6, direct_dim=3,
    )  # fmt: skip
    stream = DenoiserStream(config).to(dtype)
    assert stream.inner.contact is not None and stream.inner.direct is not None
    heads = stream.inner.contact, stream.inner.direct
    for tensor in (t for head in heads for t in (*head.buffers(), *head.parameters())):
        torch.nn.init.normal_(tensor)
    x = noise(2, 30, 26, dtype=dtype)
    # Offline the mask multiplies the future by an exact 0, and 0 * NaN is NaN: large numbers.
    check_streaming(stream, x, poison=poison_cache, junk=(1e3, -1e3))


def test_denoiser_far_past_the_training_length() -> None:
    stream = DenoiserStream(replace(DenoiserConfig(), layers=2, dim=32, ff_dim=48, audio_dim=8))
    x = noise(1, 400, 256 + 8 + 6)
    with torch.no_grad():
        expected, state = stream(x), stream.init_state(1)
        for t in range(400):
            y, state = stream.step(x[:, t : t + 1], state)
            assert (y[:, 0] - expected[:, t]).abs().max() < 1e-5


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("config", AUDIO_CONFIGS, ids=["pair", "phonetic", "compact", "wav2vec"])
def test_audio_encoder(config: AudioEncoderConfig, dtype: torch.dtype) -> None:
    encoder = lively(AudioEncoder(config)).to(dtype)
    x = 0.1 * noise(2, encoder.block_size * 40, 1, dtype=dtype)
    check_streaming(encoder, x)
    if config is WAV2VEC:
        check_streaming(Buffered(encoder, 1), x[:, : 160 * 5 + 3])


@pytest.mark.parametrize("factor", [2, 3])
def test_resample(factor: int) -> None:
    check_streaming(Resample(factor), noise(2, factor * 60, 1))
    check_streaming(Buffered(Resample(factor), 1), noise(1, factor * 40 + 1, 1))


def test_alignment() -> None:
    check_streaming(Stack(4, (3, 0)), noise(2, 40, 3))
    check_streaming(Stack(4, (1, 0), (2, 3)), noise(2, 40, 3))
    check_streaming(CausalLerp(3), noise(2, 47, 3))


@pytest.mark.parametrize("config", AUDIO_CONFIGS, ids=["pair", "phonetic", "compact", "wav2vec"])
def test_whole_audio_path_one_frame_a_tick(config: AudioEncoderConfig) -> None:
    features = AudioFeatures(lively(AudioEncoder(config)))
    x = 0.1 * noise(1, 1600 * 9, 1)
    state = features.init_state(1)
    for _ in range(7):
        y, state = features.step(x[:, :1600], state)
        assert y.shape == (1, 1, features.width)
    check_streaming(features, x)


class Leaky(CausalLerp):
    """Normalises by the whole sequence: what fairseq's norms do."""

    def forward(self, x: Tensor) -> Tensor:
        return super().forward(x - x.mean(1, keepdim=True))


class Late(Stack):
    """Declares no delay and has one."""

    def init_state(self, batch: int) -> State:
        return {"last": torch.zeros(batch, 1, 3)}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        joined = torch.cat([state["last"], x], 1)
        return joined[:, :-1], {"last": joined[:, -1:]}

    def forward(self, x: Tensor) -> Tensor:
        return self.step(x, self.init_state(len(x)))[0]


class Writes(Stack):
    """Changes the state it was given."""

    def init_state(self, batch: int) -> State:
        return {"sum": torch.zeros(batch, 1, 3)}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        state["sum"] += x.detach().sum(1, keepdim=True)
        return x, state


@pytest.mark.parametrize(
    "wrong", [Leaky(3), Late(1, (3, 0)), Writes(1, (3, 0))], ids=["leaky", "late", "writes"]
)
def test_the_contract_can_fail(wrong: nn.Module) -> None:
    with pytest.raises(AssertionError):
        check_streaming(wrong, noise(1, 40, 3))
