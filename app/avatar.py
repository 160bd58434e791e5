"""`livedrive avatar list | show`: who can be driven, and a picture of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from tyro.conf import Positional, subcommand


@dataclass(kw_only=True)
class List:
    """Name the avatars."""

    def run(self) -> None:
        from render import identity

        for name in identity.names():
            print(name)


@dataclass(kw_only=True)
class Show:
    """Draw one avatar at rest."""

    name: Positional[str]
    picture: Path
    """PNG to write."""
    size: int = 512
    yaw: float = 0.0
    """Camera angle in degrees, towards the subject's left."""
    background: str = "grey"
    """Behind the head: grey, white, green, transparent or #rrggbb."""
    stereo: bool = False
    """Both eyes of someone before the head, side by side, the left eye's picture on the left."""

    def run(self) -> None:
        from PIL import Image

        from app.background import flat, straight_alpha
        from render import cameras, identity
        from render.decoder import EXPRESSION_DIM, Decoder
        from render.renderer import create_renderer
        from render.stereo import draw_pair, side_by_side

        who = identity.load(self.name)
        ahead = np.tile(np.array([0, 0, 1], np.float32), (2, 1))
        _, gaussians = Decoder.load().decode(np.zeros(EXPRESSION_DIM, np.float32), ahead, who)
        behind = flat(self.background)
        camera = cameras.portrait(self.size, self.size, yaw_deg=self.yaw, background=behind)
        renderer = create_renderer()
        if self.stereo:
            picture = draw_pair(renderer, gaussians, side_by_side(camera))
        else:
            renderer.draw(gaussians, camera)
            picture = renderer.read_rgba()
        transparent = self.background == "transparent"
        Image.fromarray(straight_alpha(picture) if transparent else picture[..., :3]).save(
            self.picture
        )
        renderer.close()
        print(f"wrote {self.picture.resolve()}")


@dataclass(kw_only=True)
class Avatar:
    """Avatars: list | show."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[List, subcommand("list")] | Annotated[Show, subcommand("show")]
    ]

    def run(self) -> None:
        self.command.run()
