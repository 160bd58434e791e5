"""The ablation's audio encoder: as the phonetic one, but with half a second of lookahead.

Same layers, sizes and names; every convolution is centred instead of causal. It cannot run live:
`fed_causally` shows what happens if one tries (paper, table 2).
"""

import torch
from torch import Tensor
from torch.nn import functional

from encoder.audio.encoder import AudioEncoder, RunningNorm
from encoder.nn.streaming import State
from encoder.training.clips import stacked

HISTORY_FRAMES = 30  # of sound a live tick re-reads: more than the network's reach to the past


class CentredEncoder(AudioEncoder):
    """Waveform [B, T, 1] -> features [B, T / stride, width]; the whole clip at once."""

    def layered(self, x: Tensor, state: State) -> tuple[Tensor, State]:
        x = x.transpose(1, 2)
        for i, (conv, norm) in enumerate(self.layers()):
            left = conv.context // 2
            padded = functional.pad(x, (left, conv.context - left))
            y = functional.conv1d(padded, conv.weight, conv.bias, conv.stride, 0, conv.dilation)
            if isinstance(norm, RunningNorm):
                y, _ = norm.step(y, state["statistics"])
            else:
                y = norm(y)
            x = self.join(i, x, functional.relu(y))
        return x.transpose(1, 2), state


@torch.no_grad()
def fed_causally(encoder: CentredEncoder, audio: Tensor, samples_per_frame: int) -> Tensor:
    """Features [T, A] of each frame from sound up to its end only; audio [T * samples_per_frame].

    The lookahead is filled with zeros, as a live program would have to. Loudness statistics start
    anew in every window of HISTORY_FRAMES.
    """
    frames = len(audio) // samples_per_frame
    padded = functional.pad(audio, ((HISTORY_FRAMES - 1) * samples_per_frame, 0))
    windows = padded.unfold(0, HISTORY_FRAMES * samples_per_frame, samples_per_frame)
    newest = [stacked(encoder, part)[:, -1] for part in windows[:frames].split(50)]
    return torch.cat(newest)
