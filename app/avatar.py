"""`livedrive avatar`: who can be driven, their pictures, and new people from a scan."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional, subcommand

from render.errors import InputError
from render.types import Density

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from render.identity import Identity
    from render.types import Gaussians

NAME = "a-z, 0-9, - and _, at most 32"
Pose = Literal["neutral", "smile", "jaw open", "blink", "gaze", "profile"]


@dataclass(kw_only=True)
class List:
    """Name the avatars."""

    def run(self) -> None:
        from render import identity

        for name in identity.names():
            print(name)


@dataclass(kw_only=True)
class Show:
    """Draw one avatar: neutral, smile, jaw open, blink, gaze, profile."""

    name: Positional[str]
    """An avatar, "all" for a sheet of everyone, or a static head: FILE.ply."""
    picture: Path
    """PNG to write."""
    size: int = 512
    """Width and height of each view, in pixels."""
    traverse: bool = False
    """Instead: draws from the prior, and its widest dimensions from -2 to 2 deviations."""
    background: str = "grey"
    """Behind the head: grey, white, green, transparent or #rrggbb."""
    gaussians: Density = "32k"
    """On the head, without its hair."""
    stereo: bool = False
    """Both eyes of someone before the head, side by side, the left eye's picture on the left."""

    def run(self) -> None:
        from PIL import Image

        from app.background import flat, straight_alpha
        from render import cameras, identity, ply, sheet
        from render.decoder import Decoder
        from render.renderer import create_renderer
        from render.stereo import draw_pair, side_by_side

        if not 64 <= self.size <= 2048:
            raise InputError(f"--size: expected 64..2048, got {self.size}; try --size 512")
        behind, transparent = flat(self.background), self.background == "transparent"

        def shoot(cloud: "Gaussians", yaw_deg: float) -> "NDArray[np.uint8]":
            size = self.size
            camera = cameras.portrait(size, size, yaw_deg=yaw_deg, background=behind)
            if self.stereo:
                picture = draw_pair(renderer, cloud, side_by_side(camera))
            else:
                renderer.draw(cloud, camera)
                picture = renderer.read_rgba()
            return straight_alpha(picture) if transparent else picture[..., :3].copy()

        if self.name.endswith(".ply"):
            cloud = ply.load(Path(self.name))
            renderer = create_renderer()
            views = [shoot(cloud, yaw) for yaw in (0.0, 35.0, 65.0)]
        else:
            names = identity.names() if self.name == "all" else [self.name]
            people = [identity.load(name) for name in names]
            decoder, renderer = Decoder.load(gaussians=self.gaussians), create_renderer()
            make = sheet.traversals if self.traverse else sheet.avatar
            views = [view for who in people for view in make(decoder, who, shoot)]
        columns = 3 if self.name != "all" else len(sheet.POSES)
        columns = 5 if self.traverse else columns
        Image.fromarray(sheet.grid(views, columns)).save(self.picture)
        renderer.close()
        print(f"wrote {self.picture.resolve()}")


@dataclass(kw_only=True)
class Create:
    """Make an avatar of a person from their mean geometry and mean texture."""

    name: Positional[str]
    geometry: Path
    """npz with `vertices` [26719, 3], or OBJ, in the topology of the face data; mm, cm or m."""
    texture: Path
    """Skin atlas: face in the left half, back of the head in the right; 2:1, opaque."""
    eye: str = "brown"
    """Colour of the eyes: blue, brown, brownlight, green or grey."""
    hair: str | None = None
    """Avatar whose hair is worn; bald without."""
    beard: str | None = None
    """Avatar whose beard is worn; shaven without."""
    out: Path | None = None
    """Folder to write to; default: beside the shipped avatars."""

    def run(self) -> None:
        from dataclasses import replace

        from render import avatar, identity, scan, weights_file
        from render.wig import transfer

        if not self.name.replace("-", "").replace("_", "").isalnum() or len(self.name) > 32:
            raise InputError(f"name: expected {NAME}, got {self.name!r}; choose another")
        if self.name == "all" or not self.name.isascii() or self.name != self.name.lower():
            raise InputError(f"name: expected {NAME}, got {self.name!r}; choose another")
        lender = identity.load(self.hair) if self.hair else None
        maker = avatar.Maker()
        geometry = scan.read_geometry(self.geometry, maker.faces)
        skin = scan.read_texture(self.texture)
        who = maker.identity(self.name, geometry, skin, self.eye)
        if lender:
            who = replace(who, hair=transfer(lender, who))
        if self.beard:
            who = replace(who, beard=identity.load(self.beard).beard)
        folder = self.out or weights_file.FOLDER
        worn = {"eye": self.eye, "hair": self.hair, "beard": self.beard}
        files = {"geometry": self.geometry.name, "texture": self.texture.name}
        card = {"command": "livedrive avatar create", **files, **worn}
        identity.save(who, folder, card)
        print(f"wrote {(folder / f'{identity.PREFIX}{self.name}.safetensors').resolve()}")


@dataclass(kw_only=True)
class Export:
    """Write one posed head as PLY, for any viewer of Gaussian splats."""

    name: Positional[str]
    ply: Positional[Path]
    pose: Pose = "neutral"

    def run(self) -> None:
        from render import identity, ply, sheet
        from render.decoder import Decoder

        who: Identity = identity.load(self.name)
        decoder: Decoder = Decoder.load()
        cloud = sheet.posed(decoder, who, self.pose)
        ply.save(self.ply, cloud)
        print(f"wrote {self.ply.resolve()}, {len(cloud)} Gaussians")


@dataclass(kw_only=True)
class Avatar:
    """Avatars: list | show | create | export."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[List, subcommand("list")]
        | Annotated[Show, subcommand("show")]
        | Annotated[Create, subcommand("create")]
        | Annotated[Export, subcommand("export")]
    ]

    def run(self) -> None:
        self.command.run()
