"""TalkSHOW's face (Yi et al. 2023): convolutions over the clip, from features to expression.

As published: convolutions of 3 frames and 256 channels with layer norms, three with a way round
them, then three, a squared error, no noise. Otherwise: our features and codes instead of wav2vec
2.0 and FLAME, no talker's identity (ours are unseen), one decoder for jaw and face.
"""

from torch import Tensor, nn
from torch.nn import functional

from encoder.training.geometry import TrainingFace
from encoder.training.peers.parts import Batch, Losses, PeerConfig, PeerNetwork, WholeClipEars


class NormedConvolution(nn.Module):
    """[B, T, C] -> [B, T, C]; a frame hears its neighbours on both sides."""

    def __init__(self, dim: int, *, residual: bool) -> None:
        super().__init__()
        self.conv, self.norm = nn.Conv1d(dim, dim, 3, padding=1), nn.LayerNorm(dim)
        self.residual = residual

    def forward(self, x: Tensor) -> Tensor:
        y = self.norm(self.conv(x.transpose(1, 2)).transpose(1, 2))
        return functional.leaky_relu(y + x if self.residual else y, 0.2)


class TalkShow(PeerNetwork):
    """A regression: what it shows of a clip is one answer."""

    draws = False

    def __init__(self, config: PeerConfig) -> None:
        super().__init__(config)
        self.ears = WholeClipEars(config)
        places = range(2 * (config.layers - 1))
        half = len(places) // 2
        self.layers = nn.Sequential(
            *(NormedConvolution(config.dim, residual=k < half) for k in places)
        )
        self.leave = nn.Linear(config.dim, config.expression_dim)

    def forward(self, audio: Tensor) -> Tensor:  # [B, T, A] -> x0 [B, T, 256]
        return self.leave(self.layers(self.ears(audio)))

    def losses(self, batch: Batch, face: TrainingFace) -> Losses:
        codes, audio, _, weight = batch
        simple = self.error(self(audio), self.standardise(codes), weight)
        return {"simple": simple, "total": simple}

    def codes(self, audio: Tensor, noise: Tensor, truth: Tensor | None = None) -> Tensor:
        return self.unstandardise(self(audio))
