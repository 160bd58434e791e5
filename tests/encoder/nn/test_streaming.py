"""Every Streamable of the encoder keeps the contract, and wrong ones are caught."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from contracts import check_streaming, lively, noise
from torch import Tensor, nn

from encoder.audio.alignment import AudioFeatures, CausalLerp, Stack
from encoder.audio.config import PRESETS, AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.audio.resample import Resample
from encoder.nn.streaming import Buffered, State

WAV2VEC = AudioEncoderConfig(
    kind="wav2vec-large", sample_rate=16_000, feature_dim=0,
    layers=((8, 10, 5), (8, 8, 4), (8, 4, 2), (8, 4, 2), (8, 4, 2), (8, 1, 1), (8, 1, 1)),
    context=((2, 1), (3, 1), (13, 1)),
)  # fmt: skip
PAIR = replace(PRESETS["debug"], second=replace(PRESETS["phonetic-debug"], past_ticks=2))
AUDIO_CONFIGS = [PAIR, PRESETS["phonetic-debug"], PRESETS["debug"], WAV2VEC]


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
