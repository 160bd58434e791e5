"""Audio features -> 30 FPS, and the whole path from raw 48 kHz samples to `audio_features` [T, A].

The compact encoder makes exactly 4 features a tick: they are stacked, nothing is blurred. wav2vec
makes 3 1/3: a causal interpolation reads them at a constant age, so no tick waits for a feature.
All counting is in integers; nothing drifts.
"""

from __future__ import annotations

from fractions import Fraction

import torch
from torch import Tensor, nn

from encoder.audio.encoder import AudioEncoder
from encoder.audio.framing import lerp_place, lerp_ready
from encoder.audio.resample import Resample
from encoder.nn.streaming import Buffered, State
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME


class Stack(nn.Module):
    """Puts `count` neighbouring features side by side: four 8.3 ms features -> one 30 FPS frame."""

    delay = 0

    def __init__(self, count: int) -> None:
        super().__init__()
        self.block_size = count
        self.ratio = Fraction(1, count)

    def init_state(self, batch: int) -> State:
        return {}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        return self.forward(x), state

    def forward(self, x: Tensor) -> Tensor:  # [B, T, C] -> [B, T / count, count * C]
        return x.reshape(x.shape[0], x.shape[1] // self.block_size, -1)


class CausalLerp(nn.Module):
    """100 Hz features -> 30 FPS frames by interpolation between the two newest that are in time."""

    block_size = 1
    ratio = Fraction(3, 10)
    delay = 0
    kept = 5  # features a frame may still need: frame t + 1 starts 3 1/3 after frame t

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.channels = channels

    def init_state(self, batch: int) -> State:
        tail = torch.zeros(batch, 0, self.channels)
        return {"tail": tail, "count": torch.zeros((), dtype=torch.int64)}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """x [B, n, C] with any n -> [B, 0 or more, C]."""
        before = int(state["count"])
        after = before + x.shape[1]
        x = torch.cat([state["tail"].to(x), x], 1)
        oldest, frames = after - x.shape[1], []
        for frame in range(lerp_ready(before), lerp_ready(after)):
            left, weight = lerp_place(frame)
            right = min(left + 1, after - 1) if weight == 0 else left + 1
            frames.append(torch.lerp(x[:, left - oldest], x[:, right - oldest], weight))
        y = torch.stack(frames, 1) if frames else x[:, :0]
        return y, {"tail": x[:, -self.kept :], "count": state["count"] + (after - before)}

    def forward(self, x: Tensor) -> Tensor:  # [B, T, C] -> [B, lerp_ready(T), C]
        return self.step(x, self.init_state(x.shape[0]))[0]


class AudioFeatures(nn.Module):
    """Raw 48 kHz sound [B, T * 1600, 1] -> audio_features [B, T, A]: resample, encode, align."""

    block_size = SAMPLES_PER_FRAME
    ratio = Fraction(1, SAMPLES_PER_FRAME)
    delay = 0

    def __init__(self, encoder: AudioEncoder) -> None:
        super().__init__()
        factor, remainder = divmod(SAMPLE_RATE, encoder.config.sample_rate)
        assert remainder == 0
        stacked, blurred = divmod(SAMPLES_PER_FRAME, factor * encoder.config.stride)
        self.encoder = encoder
        self.parts = nn.ModuleList([Resample(factor), encoder, Stack(stacked)])
        if blurred:
            width = encoder.config.width
            self.parts = nn.ModuleList(
                [Buffered(Resample(factor), 1), Buffered(encoder, 1), CausalLerp(width)]
            )
        self.width = encoder.config.width * (1 if blurred else stacked)

    def init_state(self, batch: int) -> State:
        states = [part.init_state(batch) for part in self.parts]  # type: ignore[operator]
        return {f"{i}.{key}": v for i, state in enumerate(states) for key, v in state.items()}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        after: State = {}
        for i, part in enumerate(self.parts):
            mine = {key[2:]: v for key, v in state.items() if key.startswith(f"{i}.")}
            x, mine = part.step(x, mine)  # type: ignore[operator]
            after |= {f"{i}.{key}": v for key, v in mine.items()}
        return x, after

    def forward(self, x: Tensor) -> Tensor:
        return self.step(x, self.init_state(x.shape[0]))[0]
