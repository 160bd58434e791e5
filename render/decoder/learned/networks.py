"""The learned part of the prior (paper Sec. 3): maps in texture space, in torch.

IdentityEncoder: mean texture and mean geometry -> a bias map for every level of the decoder.
ExpressionEncoder: change of geometry and of texture -> what the linear rig does not explain.
LightDecoder: code and bias maps -> how the light on the face changes with the expression.
The decoder also runs without torch: see `render/decoder/learned/light.py`.
"""

import itertools

from torch import Tensor, nn
from torch.nn import functional as F

from render.decoder.learned.atlas import HEIGHT, WIDTH

CODE_DIM = 256
CHANNELS = (64, 64, 48, 24)  # of the decoder's levels, coarse to fine
BASE = (HEIGHT // 16, WIDTH // 16)  # size of the coarsest level
IDENTITY_INPUTS = 8  # texture 3, geometry 3, light at rest 2
EXPRESSION_INPUTS = 5  # change of geometry 3, of light 2
LIGHT_OUTPUTS = 2  # sky, key
SLOPE = 0.1


class Pyramid(nn.Module):
    """Halves the map level by level."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        #  64x128 -> 32x64 -> 16x32 -> 8x16 -> 4x8
        widths = (inputs, 12, 24, 32, 48)
        self.steps = nn.ModuleList(
            nn.Conv2d(a, b, 4, stride=2, padding=1) for a, b in itertools.pairwise(widths)
        )

    def forward(self, x: Tensor) -> list[Tensor]:  # [B, C, 64, 128] -> coarse to fine
        out = []
        for step in self.steps:
            x = F.leaky_relu(step(x), SLOPE)
            out.append(x)
        return out[::-1]


class IdentityEncoder(nn.Module):
    """Theta_id: one bias map per level."""

    def __init__(self) -> None:
        super().__init__()
        self.pyramid = Pyramid(IDENTITY_INPUTS)
        inputs = (48, 32, 24, 12)
        self.heads = nn.ModuleList(
            nn.Conv2d(a, b, 3, padding=1) for a, b in zip(inputs, CHANNELS, strict=True)
        )

    def forward(self, x: Tensor) -> list[Tensor]:
        return [head(level) for head, level in zip(self.heads, self.pyramid(x), strict=True)]


class ExpressionEncoder(nn.Module):
    """Mean of what the rig leaves open, and the uncertainty of every dimension."""

    def __init__(self, free_dim: int) -> None:
        super().__init__()
        self.pyramid = Pyramid(EXPRESSION_INPUTS)
        self.mean = nn.Linear(48 * BASE[0] * BASE[1], free_dim)
        self.log_variance = nn.Linear(48 * BASE[0] * BASE[1], CODE_DIM)
        nn.init.zeros_(self.log_variance.weight)
        nn.init.constant_(self.log_variance.bias, -3.0)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor]:  # -> [B, free_dim], [B, 256]
        flat = self.pyramid(x)[0].flatten(1)
        return self.mean(flat), self.log_variance(flat).clamp(-10, 4)


class LightDecoder(nn.Module):
    """Doubles the map level by level; each texel becomes four (a 2 x 2 transposed convolution)."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Linear(CODE_DIM, CHANNELS[0] * BASE[0] * BASE[1])
        outputs = (*CHANNELS[1:], LIGHT_OUTPUTS)
        self.ups = nn.ModuleList(
            nn.ConvTranspose2d(a, b, 2, stride=2) for a, b in zip(CHANNELS, outputs, strict=True)
        )

    def forward(self, code: Tensor, biases: list[Tensor]) -> Tensor:  # -> [B, 2, 64, 128]
        x = self.first(code).reshape(-1, CHANNELS[0], *BASE)
        for up, bias in zip(self.ups, biases, strict=True):
            x = up(F.leaky_relu(x + bias, SLOPE))
        return x


def divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """KL(N(mean, variance) || N(0, 1)), mean of the batch, sum of the dimensions."""
    return 0.5 * (mean**2 + log_variance.exp() - log_variance - 1).sum(-1).mean()
