"""The background of the picture: a soft studio light, a colour, a green screen, or nothing."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

Rgba = tuple[float, float, float, float]  # 0..1 sRGB, straight alpha
Fill = Rgba | Literal["studio"]
GREY: Rgba = (0.16, 0.16, 0.16, 1.0)
FILLS: dict[str, Fill] = {
    "studio": "studio",
    "grey": GREY,
    "white": (0.94, 0.94, 0.94, 1.0),
    "green": (0.0, 0.694, 0.251, 1.0),  # of broadcast chroma keys
    "transparent": (0.0, 0.0, 0.0, 0.0),
}


def fill(name: str) -> Fill:
    """A name of FILLS or #rrggbb; raises InputError."""
    if name in FILLS:
        return FILLS[name]
    try:
        if len(name) != 7 or name[0] != "#":
            raise ValueError
        red, green, blue = bytes.fromhex(name[1:])
    except ValueError:
        raise InputError(
            f"--background: expected {', '.join(FILLS)} or #rrggbb, got {name!r}; "
            "try --background green"
        ) from None
    return (red / 255, green / 255, blue / 255, 1.0)


def flat(name: str) -> tuple[float, float, float]:
    """The one colour to draw over, 0..1: black where nothing shall be seen, grey for the studio."""
    chosen = fill(name)
    red, green, blue, alpha = GREY if chosen == "studio" else chosen
    return (red, green, blue) if alpha else (0.0, 0.0, 0.0)


def straight_alpha(
    picture: NDArray[np.uint8],  # [H, W, 4] drawn over black
) -> NDArray[np.uint8]:  # [H, W, 4]
    """Straight alpha, as PNG needs it: colours divided by their coverage."""
    out = picture.copy()
    alpha = picture[..., 3:].astype(np.float32)
    out[..., :3] = (picture[..., :3] * (255.0 / np.maximum(alpha, 1.0)) + 0.5).clip(0, 255)
    return out
