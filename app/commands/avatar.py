"""`livedrive avatar`: who can be driven, their pictures, and new people from a scan."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional, subcommand

from render.types import Density
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from render.avatars.sheet import Picture, Shoot
    from render.decoder.decoder import Decoder
    from render.decoder.identity import Identity
    from render.types import Gaussians

NAME = "a-z, 0-9, - and _, at most 32"
Light = Literal["studio", "soft", "evening", "rim"]
Sheet = Literal["poses", "views", "speech", "eyes", "moods", "lights"]
Pose = Literal["neutral", "smile", "jaw open", "blink", "gaze", "profile"]


@dataclass(kw_only=True)
class ListAvatars:
    """Name the avatars."""

    def run(self) -> None:
        from render.decoder import identity

        for name in identity.names():
            print(name)


@dataclass(kw_only=True)
class ShowAvatar:
    """Draw one avatar: neutral, smile, jaw open, blink, gaze, profile."""

    name: Positional[str]
    """An avatar, "all" for a sheet of everyone, or a static head: FILE.ply."""
    picture: Path
    """PNG to write."""
    size: int = 512
    """Width and height of each view, in pixels."""
    sheet: Sheet = "poses"
    """Which pictures: of poses, views, speech, eyes, moods or lights; six, or four lights."""
    light: Light = "studio"
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

        from app.drive.background import flat, straight_alpha
        from render import cameras
        from render.avatars import ply, sheet
        from render.decoder import identity
        from render.decoder.decoder import Decoder
        from render.splats.renderer import create_renderer
        from render.splats.stereo import draw_pair, side_by_side

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
            renderer = create_renderer()
            decoder = Decoder.load(gaussians=self.gaussians, light=self.light)
            views = [view for who in people for view in self._views(decoder, who, shoot)]
        columns = 3 if self.name != "all" else len(sheet.POSES)
        columns = columns if self.sheet != "lights" else 4
        columns = 5 if self.traverse else columns
        Image.fromarray(sheet.grid(views, columns)).save(files.create(self.picture))
        renderer.close()
        print(f"wrote {self.picture.resolve()}")

    def _views(self, decoder: "Decoder", who: "Identity", shoot: "Shoot") -> "list[Picture]":
        from render.avatars import sheet

        if self.traverse:
            return sheet.traversals(decoder, who, shoot)
        if self.sheet == "lights":
            return sheet.lights(who, shoot, self.gaussians)
        return sheet.avatar(decoder, who, shoot, sheet.SHEETS[self.sheet])


@dataclass(kw_only=True)
class TurnAvatar:
    """Film an avatar from all sides, once around."""

    name: Positional[str]
    video: Positional[Path]
    """.mp4, .mkv or .mov to write."""
    size: int = 512
    """Width and height in pixels; even."""
    seconds: float = 6.0
    light: Light = "studio"
    gaussians: Density = "65k"
    """On the head, without its hair."""

    def run(self) -> None:
        from app.sinks.video import film
        from render.avatars import sheet
        from render.decoder import identity
        from render.decoder.decoder import Decoder
        from render.splats.renderer import create_renderer

        if not 64 <= self.size <= 2048 or self.size % 2:
            raise InputError(f"--size: expected even, 64..2048, got {self.size}; try --size 512")
        if not 0.1 <= self.seconds <= 120:
            raise InputError(f"--seconds: expected 0.1..120, got {self.seconds:g}; try 6")
        decoder = Decoder.load(gaussians=self.gaussians, light=self.light)
        cloud = sheet.posed(decoder, identity.load(self.name), "neutral")
        renderer = create_renderer()
        film(self.video, sheet.around(cloud, renderer, self.size, max(round(self.seconds * 30), 1)))
        renderer.close()
        print(f"wrote {self.video.resolve()}")


@dataclass(kw_only=True)
class CreateAvatar:
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
    """Folder to write to; default: your avatars, which --avatar NAME finds."""
    replace: bool = False
    """Replace an avatar of yours that has this name."""

    def run(self) -> None:
        from dataclasses import replace as with_parts

        from render.avatars import maker as avatar
        from render.avatars import scan
        from render.avatars.hair_transfer import transfer
        from render.decoder import identity

        if not self.name.replace("-", "").replace("_", "").isalnum() or len(self.name) > 32:
            raise InputError(f"name: expected {NAME}, got {self.name!r}; choose another")
        if self.name == "all" or not self.name.isascii() or self.name != self.name.lower():
            raise InputError(f"name: expected {NAME}, got {self.name!r}; choose another")
        if self.name in identity.shipped():
            raise InputError(f"name: expected a new one, got that of a shipped avatar, {self.name}")
        folder = self.out or identity.user_folder()
        if self.name in identity.names(folder) and not self.replace:
            raise InputError(
                f"name: expected a new one, got that of an avatar in {folder}; "
                "choose another, or add --replace"
            )
        lender = identity.load(self.hair) if self.hair else None
        maker = avatar.Maker()
        geometry = scan.read_geometry(self.geometry, maker.faces)
        skin = scan.read_texture(self.texture)
        who = maker.identity(self.name, geometry, skin, self.eye)
        if lender:
            who = with_parts(who, hair=transfer(lender, who))
        if self.beard:
            who = with_parts(who, beard=identity.load(self.beard).beard)
        worn = {"eye": self.eye, "hair": self.hair, "beard": self.beard}
        files = {"geometry": self.geometry.name, "texture": self.texture.name}
        card = {"command": "livedrive avatar create", **files, **worn}
        identity.save(who, folder, card)
        path = (folder / f"{identity.PREFIX}{self.name}.safetensors").resolve()
        avatar = shlex.quote(str(path)) if self.out else self.name
        print(f"wrote {path}; next: livedrive replay recordings/demo --window --avatar {avatar}")


@dataclass(kw_only=True)
class ExportAvatar:
    """Write one posed head as PLY, for any viewer of Gaussian splats."""

    name: Positional[str]
    ply: Positional[Path]
    pose: Pose = "neutral"

    def run(self) -> None:
        from render.avatars import ply, sheet
        from render.decoder import identity
        from render.decoder.decoder import Decoder

        who: Identity = identity.load(self.name)
        decoder: Decoder = Decoder.load()
        cloud = sheet.posed(decoder, who, self.pose)
        ply.save(self.ply, cloud)
        print(f"wrote {self.ply.resolve()}, {len(cloud)} Gaussians")


@dataclass(kw_only=True)
class Avatar:
    """Avatars: list | show | turn | create | export."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[ListAvatars, subcommand("list")]
        | Annotated[ShowAvatar, subcommand("show")]
        | Annotated[TurnAvatar, subcommand("turn")]
        | Annotated[CreateAvatar, subcommand("create")]
        | Annotated[ExportAvatar, subcommand("export")]
    ]

    def run(self) -> None:
        self.command.run()
