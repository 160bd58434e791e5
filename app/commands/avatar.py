"""`livedrive avatar`: who can be driven, their pictures, and new people from a scan."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, subcommand

from app.avatars.pictures import Light, Pose, Sheet
from app.terminal.arguments import File, Name
from render.types import Density


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
    """PNG or JPEG to write."""
    size: int = 512
    """Width and height of each view, in pixels."""
    sheet: Sheet = "poses"
    """Which pictures: one portrait, four lights, or six poses, views, words, eyes or moods."""
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
        from app.avatars.pictures import PictureSettings, save_picture

        settings = PictureSettings(
            size=self.size,
            sheet=self.sheet,
            light=self.light,
            traverse=self.traverse,
            background=self.background,
            gaussians=self.gaussians,
            stereo=self.stereo,
        )
        save_picture(self.name, self.picture, settings)
        print(f"wrote {self.picture.resolve()}")


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
        from app.avatars.pictures import save_turn

        save_turn(self.name, self.video, self.size, self.seconds, self.light, self.gaussians)
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
    hair: Name = None
    """Avatar whose hair is worn; bald without."""
    beard: Name = None
    """Avatar whose beard is worn; shaven without."""
    out: File = None
    """Folder to write to; default: your avatars, which --avatar NAME finds."""
    replace: bool = False
    """Replace an avatar of yours that has this name."""

    def run(self) -> None:
        from app.avatars.create import AvatarParts, create
        from render.decoder import identity

        parts = AvatarParts(
            geometry=self.geometry,
            texture=self.texture,
            eye=self.eye,
            hair=self.hair,
            beard=self.beard,
        )
        folder = self.out or identity.user_folder()
        path = create(self.name, parts, folder, replace=self.replace)
        avatar = shlex.quote(str(path)) if self.out else self.name
        print(f"wrote {path}; next: livedrive replay recordings/demo --window --avatar {avatar}")


@dataclass(kw_only=True)
class ExportAvatar:
    """Write one posed head as PLY, for any viewer of Gaussian splats."""

    name: Positional[str]
    ply: Positional[Path]
    pose: Pose = "neutral"

    def run(self) -> None:
        from app.avatars.pictures import posed
        from render.avatars import ply

        cloud = posed(self.name, self.pose)
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
