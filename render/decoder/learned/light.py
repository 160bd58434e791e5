"""The light decoder of `networks.py` in numpy: well under a millisecond on one core.

Every level doubles a map, and each texel makes its four children alone. So texels are kept in the
order of a quadtree, where the children of a row are the next four rows: nothing has to be moved.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from render.decoder.kernels import light as kernels
from render.types import Floats

SLOPE = np.float32(0.1)
# A product is made in so many parts: for large ones BLAS wakes threads, which spin for longer than
# the product takes, beside whatever else a tick does.
PARTS = 8


@dataclass(frozen=True)
class LightNet:
    """Weights, laid out for matrix products: texels are rows, channels last."""

    first: Floats  # [PARTS, 256, h * w * C0 / PARTS]
    first_bias: Floats  # [PARTS, h * w * C0 / PARTS]
    ups: tuple[Floats, ...]  # per level [C, 4 * C'], the four children of a texel side by side
    up_biases: tuple[Floats, ...]  # per level [4 * C']
    base: tuple[int, int]  # h, w of the coarsest level

    def __call__(self, code: Floats, biases: tuple[Floats, ...]) -> Floats:  # -> [texels, 2]
        """code [256] scaled to unit variance, biases of `nested` -> change of light, nested."""
        x = code @ self.first + self.first_bias
        for up, up_bias, bias in zip(self.ups, self.up_biases, biases, strict=True):
            x = x.reshape(bias.shape)
            kernels.activate(x, bias, SLOPE)
            x = x.reshape(PARTS, -1, len(up)) @ up
            x += up_bias
        return x.reshape(-1, 2)

    def nested(self, biases: tuple[Floats, ...]) -> tuple[Floats, ...]:
        """Biases per level [h * w, C], rows of a picture -> rows of a quadtree."""
        return tuple(bias[self.order(level)] for level, bias in enumerate(biases))

    def order(self, level: int) -> NDArray[np.intp]:  # [texels]
        """Where in the picture of a level the texels of the quadtree lie."""
        h, w = self.base
        order = np.arange(h * w)
        for _ in range(level):
            y, x = 2 * (order // w), 2 * (order % w)
            w *= 2
            order = np.stack([y * w + x, y * w + x + 1, (y + 1) * w + x, (y + 1) * w + x + 1], 1)
            order = order.ravel()
        return order

    @classmethod
    def of(cls, tensors: dict[str, NDArray]) -> "LightNet":
        """From a weights file (`tensors_of` wrote it)."""
        count = sum(name.startswith("light_up_weight") for name in tensors)
        wide = {k: v.astype(np.float32) for k, v in tensors.items() if k.startswith("light_")}
        first = wide["light_first"]
        return cls(
            np.ascontiguousarray(first.reshape(len(first), PARTS, -1).transpose(1, 0, 2)),
            wide["light_first_bias"].reshape(PARTS, -1),
            tuple(wide[f"light_up_weight{i}"] for i in range(count)),
            tuple(wide[f"light_up_bias{i}"] for i in range(count)),
            (int(tensors["light_base"][0]), int(tensors["light_base"][1])),
        )


def tensors_of(network) -> dict[str, NDArray]:  # type: ignore[no-untyped-def]  # networks.LightDecoder
    """The same weights for a file, half precision."""
    from render.decoder.learned.networks import BASE, CHANNELS

    def array(t) -> Floats:  # type: ignore[no-untyped-def]
        return t.detach().numpy().astype(np.float32)

    h, w = BASE
    first = array(network.first.weight).reshape(CHANNELS[0], h * w, -1).transpose(2, 1, 0)
    bias = array(network.first.bias).reshape(CHANNELS[0], h * w).T
    out: dict[str, NDArray] = {
        "light_first": first.reshape(len(first), -1).astype(np.float16),
        "light_first_bias": bias.ravel().astype(np.float16),
        "light_base": np.array(BASE, np.int32),
    }
    for i, up in enumerate(network.ups):
        weight = array(up.weight)  # [C, C', 2, 2]
        wide = weight.transpose(0, 2, 3, 1).reshape(len(weight), -1)
        out[f"light_up_weight{i}"] = wide.astype(np.float16)
        out[f"light_up_bias{i}"] = np.tile(array(up.bias), 4).astype(np.float16)
    return out
