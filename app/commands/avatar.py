"""`livedrive avatar`: who can be driven, their pictures, new people from photographs or a scan."""

from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Annotated

import tyro
from tyro.conf import Positional, subcommand

from app.avatars.pictures import Light, Pose, Sheet
from app.terminal import confirm, outputs
from app.terminal.arguments import File, Name
from render.types import DENSITY, Density
from sensors.types import InputError


@dataclass(kw_only=True)
class ListAvatars:
    """List the avatars' names."""

    def run(self) -> None:
        from render.decoder.learned import avatar_files

        for name in avatar_files.names():
            print(name)


@dataclass(kw_only=True)
class ShowAvatar:
    """Draw pictures of an avatar."""

    name: Positional[str]
    """Name of an avatar, "all" for a sheet of all, or FILE.ply with a static head."""
    picture: Path
    """PNG or JPEG to write."""
    size: int = 512
    """Width and height of each view, in pixels."""
    sheet: Sheet = "poses"
    """What to draw: one portrait, four lights, or six poses, views, sounds, gazes,
    moods or turns of the head."""
    light: Light = "studio"
    """Lighting."""
    traverse: bool = False
    """Instead: random draws from the prior, and its main dimensions from -2 to 2 deviations."""
    background: str = "grey"
    """Background: grey (also as studio), white, green, transparent or #rrggbb."""
    gaussians: Density = DENSITY
    """Gaussians of the head without hair."""
    stereo: bool = False
    """The views of both eyes of an onlooker side by side, the left eye's on the left."""

    def run(self) -> None:
        from app.avatars.pictures import PictureSettings, save_picture

        outputs.check("--picture", self.picture, outputs.PICTURES)
        if self.background == "transparent" and self.picture.suffix.lower() != ".png":
            raise InputError(
                f"--background transparent: expected a PNG to write, got {self.picture.name!r}; "
                f"try {self.picture.stem}.png"
            )
        confirm.overwriting([self.picture])
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
    """Make a video that goes once around an avatar."""

    name: Positional[str]
    """Name of an avatar."""
    video: Positional[Path]
    """.mp4, .mkv or .mov to write."""
    size: int = 512
    """Width and height in pixels, an even number."""
    seconds: float = 6.0
    """Length of the video."""
    light: Light = "studio"
    """Lighting."""
    gaussians: Density = DENSITY
    """Gaussians of the head without hair."""

    def run(self) -> None:
        from app.avatars.pictures import save_turn

        outputs.check("video", self.video, outputs.VIDEOS)
        confirm.overwriting([self.video])
        save_turn(self.name, self.video, self.size, self.seconds, self.light, self.gaussians)
        print(f"wrote {self.video.resolve()}")


@dataclass(kw_only=True)
class CreateAvatar:
    """Make an avatar of a person from photographs, or from a scan.

    Photographs need pip install 'livedrive[photos]'. A scan shows a neutral face, eyes open, lips
    closed; a head of another topology is registered (pip install 'livedrive[register]')."""

    name: Positional[str]
    """Name of the new avatar."""
    photos: tuple[Path, ...] = ()
    """One to five photographs of the face, in colour, at least 256 pixels: the front, then both
    sides at about 35 degrees. Even light, no glasses, a calm face if possible; hair off the face
    and its temples, where it would leave blotches."""
    geometry: File = None
    """Instead: scan as GLB, OBJ, PLY or STL; or, in the topology of the face data, npz with
    `vertices` [26719, 3] or OBJ; mm, cm or m."""
    texture: File = None
    """Skin atlas: face in the left half, back of the head in the right; 2:1, opaque. Default:
    the colours of the scan, where it has another topology."""
    landmarks: File = None
    """JSON {"nose_tip": [x, y, z], ...} in the coordinates of such a scan: three or more of
    nose_tip, chin, mouth_left, mouth_right, left_eye_inner, left_eye_outer, right_eye_inner,
    right_eye_outer; left is the subject's. Default: the face is found."""
    eye: Name = None
    """Colour of the eyes: blue, brown, brownlight, green or grey. Default: as the photographs show;
    brown without."""
    hair: Name = None
    """Avatar to take the hair from, in the colour that photographs show, on a scan in its own;
    default: bald."""
    beard: Name = None
    """Avatar to take the beard from, in the colour that photographs show; default: shaven, or as
    painted on the skin."""
    out: File = None
    """Folder to write to; default: that of your avatars, where --avatar NAME looks."""
    replace: bool = False
    """Replace an avatar of yours with this name."""

    def run(self) -> None:
        from app.avatars.create import AvatarParts, create
        from render.decoder.learned import avatar_files

        parts = AvatarParts(
            geometry=self.geometry,
            photos=self.photos,
            texture=self.texture,
            landmarks=self.landmarks,
            eye=self.eye,
            hair=self.hair,
            beard=self.beard,
        )
        folder = self.out or avatar_files.user_folder()
        path = create(self.name, parts, folder, replace=self.replace)
        avatar, demo = str(path) if self.out else self.name, "recordings/demo --window"
        print(f"wrote {path}; next: livedrive replay {demo} --avatar {quote(avatar)}")


@dataclass(kw_only=True)
class ExportAvatar:
    """Write one posed head as PLY, for any viewer of Gaussian splats."""

    name: Positional[str]
    """Name of an avatar."""
    ply: Positional[Path]
    """File to write."""
    pose: Pose = "neutral"
    """Expression."""

    def run(self) -> None:
        from app.avatars.pictures import posed
        from render.avatars import ply

        outputs.check("ply", self.ply, (".ply",))
        confirm.overwriting([self.ply])
        cloud = posed(self.name, self.pose)
        ply.save(self.ply, cloud)
        print(f"wrote {self.ply.resolve()}, {len(cloud)} Gaussians")


# Every command with subcommands has such a union: type checkers and tyro need it written out.
@dataclass(kw_only=True)
class Avatar:
    """List, draw and make avatars: list | show | turn | create | export."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[ListAvatars, subcommand("list")]
        | Annotated[ShowAvatar, subcommand("show")]
        | Annotated[TurnAvatar, subcommand("turn")]
        | Annotated[CreateAvatar, subcommand("create")]
        | Annotated[ExportAvatar, subcommand("export")]
    ]

    def run(self) -> None:
        if not isinstance(self.command, ListAvatars):
            from app.compose.live import tell
            from app.terminal import compiling

            compiling.announce(tell)
        self.command.run()
