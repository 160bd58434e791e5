"""Self-supervised losses of the audio encoders: they need no truth, so any speech will do.

`future_loss` is wav2vec 1.0 (Schneider et al. 2019, eq. 2), for causal encoders. `masked_loss` is
wav2vec 2.0's task (Baevski et al. 2020, eq. 3) for encoders that see both sides, with the latents
themselves as targets instead of quantised ones.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

STEPS = 12  # features ahead, 100 ms
NEGATIVES = 10
EVERY = 4  # one position a frame is asked: neighbours say nearly the same
MASK_LENGTH = 10  # features
MASK_SHARE = 0.06  # of positions start a masked span
TEMPERATURE = 0.1


class Predictor(nn.Module):
    """The affine maps h_k from context to the latent k features later, and the masked vector."""

    def __init__(self, width: int, steps: int = STEPS) -> None:
        super().__init__()
        self.maps = nn.Linear(width, steps * width)
        self.mask = nn.Parameter(torch.randn(width) * 0.1)
        self.steps = steps


def distractors(latents: Tensor, places: int) -> Tensor:
    """Random latents of the same clip: [B, N, C] -> [B, places, NEGATIVES, C]."""
    batch, count, width = latents.shape
    rows = torch.randint(count, (batch, places * NEGATIVES, 1), device=latents.device)
    return latents.gather(1, rows.expand(-1, -1, width)).unflatten(1, (places, NEGATIVES))


def future_loss(latents: Tensor, context: Tensor, predictor: Predictor) -> Tensor:
    """Tell the latent k = 1..K features ahead from distractors of the same clip.

    latents, context [B, N, C] -> the mean of -log s(z . h) - log s(-z' . h), s the sigmoid.
    """
    batch, count, width = latents.shape
    places = torch.arange(0, count - predictor.steps, EVERY, device=latents.device)
    guess = predictor.maps(context[:, places]).unflatten(-1, (predictor.steps, width))
    ahead = places[:, None] + torch.arange(1, predictor.steps + 1, device=latents.device)
    true = latents[:, ahead]  # [B, P, K, C]
    scale = width**-0.5
    hit = functional.logsigmoid((guess * true).sum(-1) * scale)
    false = distractors(latents, len(places))
    score = torch.einsum("bpkc,bpnc->bpkn", guess, false) * scale
    return -(hit + functional.logsigmoid(-score).mean(-1)).mean()


def draw_mask(batch: int, count: int) -> Tensor:
    """[B, N] bool: spans of MASK_LENGTH, at least one in every clip."""
    starts = torch.rand(batch, count) < MASK_SHARE
    starts[torch.arange(batch), torch.randint(count, (batch,))] = True
    padded = functional.pad(starts.float()[:, None], (MASK_LENGTH - 1, 0))
    return functional.max_pool1d(padded, MASK_LENGTH, 1)[:, 0] > 0


def masked_loss(latents: Tensor, context: Tensor, mask: Tensor, predictor: Predictor) -> Tensor:
    """At masked places [B, N] tell the hidden latent from distractors by cosine similarity."""
    width = latents.shape[-1]
    guess = functional.linear(context, predictor.maps.weight[:width], predictor.maps.bias[:width])
    false = distractors(latents, latents.shape[1])  # [B, N, K, C]
    candidates = torch.cat([latents[:, :, None], false], 2)
    similar = functional.cosine_similarity(guess[:, :, None], candidates, -1) / TEMPERATURE
    return -functional.log_softmax(similar, -1)[..., 0][mask].mean()
