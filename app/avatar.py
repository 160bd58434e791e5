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

    def run(self) -> None:
        from PIL import Image

        from render import cameras, identity
        from render.decoder import EXPRESSION_DIM, Decoder
        from render.renderer import create_renderer

        who = identity.load(self.name)
        ahead = np.tile(np.array([0, 0, 1], np.float32), (2, 1))
        _, gaussians = Decoder.load().decode(np.zeros(EXPRESSION_DIM, np.float32), ahead, who)
        renderer = create_renderer()
        renderer.draw(gaussians, cameras.portrait(self.size, self.size, yaw_deg=self.yaw))
        Image.fromarray(renderer.read_rgba()[..., :3]).save(self.picture)
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
