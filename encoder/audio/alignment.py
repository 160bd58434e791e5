"""Audio features -> 30 FPS, and the whole path from raw 48 kHz samples to `audio_features` [T, A].

An encoder at 24 kHz makes exactly 4 features a tick: they are stacked, nothing is blurred, and the
mean of each of the last `past_ticks` ticks stands behind them. wav2vec makes 3 1/3: a causal
interpolation reads them at a constant age, so no tick waits for a feature.
All counting is in integers; nothing drifts.
"""

from __future__ import annotations

from fractions import Fraction

import torch
from torch import Tensor, nn

from encoder.audio.config import AudioEncoderConfig
from encoder.audio.encoder import AudioEncoder
from encoder.audio.framing import lerp_place, lerp_ready
from encoder.audio.resample import Resample
from encoder.nn.streaming import Buffered, State
from sensors.types import SAMPLE_RATE, SAMPLES_PER_FRAME


class Stack(nn.Module):
    """Puts neighbouring features side by side: four 8.3 ms features -> one 30 FPS frame.

    parts: (channels, past) of the encoders whose features lie side by side; each part of a frame
    ends with the means of `past` frames before it, the newest first.
    """

    delay = 0

    def __init__(self, count: int, *parts: tuple[int, int]) -> None:
        super().__init__()
        self.block_size, self.parts = count, parts
        self.ratio = Fraction(1, count)

    def init_state(self, batch: int) -> State:
        sizes = {f"means{i}": part for i, part in enumerate(self.parts) if part[1]}
        return {n: torch.zeros(batch, past, channels) for n, (channels, past) in sizes.items()}

    def step(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        """x [B, T, C] -> [B, T / count, sum of (count + past) * channels]."""
        frames, rows, after = x.unflatten(1, (-1, self.block_size)), list[Tensor](), dict(state)
        own = frames.split([channels for channels, _ in self.parts], -1)
        for i, (part, (_, past)) in enumerate(zip(own, self.parts, strict=True)):
            rows.append(part.flatten(2))
            if past:
                means = torch.cat([state[f"means{i}"].to(x), part.mean(2)], 1)
                count = part.shape[1]
                rows += [means[:, past - k : past - k + count] for k in range(1, past + 1)]
                after[f"means{i}"] = means[:, count:]
        return torch.cat(rows, -1), after

    def forward(self, x: Tensor) -> Tensor:
        return self.step(x, self.init_state(x.shape[0]))[0]


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


def stack_of(config: AudioEncoderConfig) -> Stack:
    """How features of an encoder at 24 kHz become frames."""
    return Stack(config.features_a_tick, *config.parts)


class AudioFeatures(nn.Module):
    """Raw 48 kHz sound [B, T * 1600, 1] -> audio_features [B, T, A]: resample, encode, align."""

    block_size = SAMPLES_PER_FRAME
    ratio = Fraction(1, SAMPLES_PER_FRAME)
    delay = 0

    def __init__(self, encoder: AudioEncoder) -> None:
        super().__init__()
        factor, remainder = divmod(SAMPLE_RATE, encoder.config.sample_rate)
        assert remainder == 0
        self.encoder = encoder
        self.width = encoder.config.frame_width
        if encoder.config.features_a_tick:
            self.parts = nn.ModuleList([Resample(factor), encoder, stack_of(encoder.config)])
        else:
            width = encoder.config.width
            self.parts = nn.ModuleList(
                [Buffered(Resample(factor), 1), Buffered(encoder, 1), CausalLerp(width)]
            )

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
