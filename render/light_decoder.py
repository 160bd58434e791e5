"""The light decoder of `render/networks.py` in numpy: well under a millisecond on one core."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
SLOPE = np.float32(0.1)


@dataclass(frozen=True)
class LightNet:
    """Weights, laid out for matrix products: texels are rows, channels last."""

    first: Floats  # [256, h * w * C0]
    first_bias: Floats  # [h * w * C0]
    ups: tuple[Floats, ...]  # per level [C, 4 * C'], the four children of a texel side by side
    up_biases: tuple[Floats, ...]  # per level [4 * C']
    base: tuple[int, int]  # h, w of the coarsest level

    def __call__(self, code: Floats, biases: tuple[Floats, ...]) -> Floats:  # -> [texels, 2]
        """code [256] scaled to unit variance, biases per level [h * w, C] -> change of light."""
        h, w = self.base
        x = (code @ self.first + self.first_bias).reshape(h * w, -1)
        for up, up_bias, bias in zip(self.ups, self.up_biases, biases, strict=True):
            x = x + bias
            x = np.maximum(x, SLOPE * x) @ up + up_bias
            # [h, w, 2, 2, C'] -> rows of the doubled map
            x = x.reshape(h, w, 2, 2, -1).transpose(0, 2, 1, 3, 4).reshape(4 * h * w, -1)
            h, w = 2 * h, 2 * w
        return x

    @classmethod
    def of(cls, tensors: dict[str, NDArray]) -> "LightNet":
        """From a weights file (`tensors_of` wrote it)."""
        count = sum(name.startswith("light_up_weight") for name in tensors)
        wide = {k: v.astype(np.float32) for k, v in tensors.items() if k.startswith("light_")}
        return cls(
            wide["light_first"],
            wide["light_first_bias"],
            tuple(wide[f"light_up_weight{i}"] for i in range(count)),
            tuple(wide[f"light_up_bias{i}"] for i in range(count)),
            (int(tensors["light_base"][0]), int(tensors["light_base"][1])),
        )


def tensors_of(network) -> dict[str, NDArray]:  # type: ignore[no-untyped-def]  # networks.LightDecoder
    """The same weights for a file, half precision."""
    from render.networks import BASE, CHANNELS

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
