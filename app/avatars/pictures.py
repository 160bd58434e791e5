"""Pictures and films of avatars, drawn without a session."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from render.types import DENSITY, Density
from sensors import files
from sensors.types import FPS, InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from render.avatars.sheet import Picture, Shoot
    from render.decoder.decoder import Decoder
    from render.decoder.identity import Identity
    from render.types import Gaussians, Renderer

Light = Literal["studio", "soft", "evening", "rim"]
Sheet = Literal["portrait", "poses", "views", "speech", "eyes", "moods", "heads", "lights"]
Pose = Literal["neutral", "smile", "jaw open", "blink", "gaze"]


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    size: int  # px, width and height of each view
    sheet: Sheet
    light: Light
    traverse: bool  # draws from the prior instead of the sheet
    background: str
    gaussians: Density
    stereo: bool  # both eyes of a viewer side by side


def save_picture(name: str, path: Path, settings: PictureSettings) -> None:
    """Write a PNG sheet of an avatar, of "all", or of a static head FILE.ply.

    Raises InputError where the size is out of range or there is no such avatar."""
    from PIL import Image

    from render.avatars import ply, sheet
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.renderer import create_renderer

    if not 64 <= settings.size <= 2048:
        raise InputError(f"--size: expected 64..2048, got {settings.size}; try --size 512")
    _check(name, settings)
    if name.lower().endswith(".ply"):
        cloud = ply.load(Path(name))
        renderer = create_renderer()
        shoot = _camera(renderer, settings)
        views = [shoot(cloud, yaw) for yaw in (0.0, 35.0, 65.0)]
    else:
        people = everybody() if name == "all" else [identity.load(name)]
        renderer = create_renderer()
        shoot = _camera(renderer, settings)
        decoder = Decoder.load(gaussians=settings.gaussians, light=settings.light)
        views = [view for who in people for view in _views(decoder, who, shoot, settings)]
    columns = 3 if name != "all" else len(sheet.POSES)
    columns = columns if settings.sheet != "lights" else 4
    columns = 5 if settings.traverse else columns
    with files.replacing(path) as draft:
        Image.fromarray(sheet.grid(views, columns)).save(draft)
    renderer.close()


def everybody() -> "list[Identity]":
    """All but those whose files are damaged, which are told."""
    from render.decoder import identity
    from render.decoder.learned import avatar_files

    people = list["Identity"]()
    for name in avatar_files.names():
        try:
            people.append(identity.load(name))
        except InputError as error:
            print(f"livedrive: {name} is left out: {error}", file=sys.stderr)
    return people


def _check(name: str, settings: PictureSettings) -> None:
    """InputError where an option would say nothing: it is not one of what is drawn."""
    is_ply, sheet = name.lower().endswith(".ply"), settings.sheet != "poses"
    for option, given, other in (
        ("--sheet", is_ply and sheet, f"the static head {name}"),
        ("--light", is_ply and settings.light != "studio", f"the static head {name}"),
        ("--gaussians", is_ply and settings.gaussians != DENSITY, f"the static head {name}"),
        ("--traverse", is_ply and settings.traverse, f"the static head {name}"),
        ("--sheet", settings.traverse and sheet, "--traverse, which draws instead of it"),
        (
            "--light",
            settings.sheet == "lights" and settings.light != "studio",
            "--sheet lights, which draws them all",
        ),
    ):
        if given:
            raise InputError(
                f"{option}: expected an avatar whose sheet is drawn, got {other}; leave {option} "
                "out"
            )


def save_turn(
    name: str,
    path: Path,  # .mp4, .mkv or .mov
    size: int,  # px, even
    seconds: float,
    light: Light,
    gaussians: Density,
) -> None:
    """Film an avatar once around. Raises InputError where a number is out of range."""
    from app.sinks.video import film
    from render.avatars import sheet
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.renderer import create_renderer

    if not 64 <= size <= 2048 or size % 2:
        raise InputError(f"--size: expected even, 64..2048, got {size}; try --size 512")
    if not 0.1 <= seconds <= 120:
        raise InputError(f"--seconds: expected 0.1..120, got {seconds:g}; try 6")
    decoder = Decoder.load(gaussians=gaussians, light=light)
    cloud = sheet.posed(decoder, identity.load(name), "neutral")
    renderer = create_renderer()
    film(path, sheet.around(cloud, renderer, size, max(round(seconds * FPS), 1)))
    renderer.close()


def posed(name: str, pose: Pose) -> "Gaussians":
    from render.avatars import sheet
    from render.decoder import identity
    from render.decoder.decoder import Decoder

    who = identity.load(name)
    return sheet.posed(Decoder.load(gaussians=DENSITY), who, pose)


def _camera(renderer: "Renderer", settings: PictureSettings) -> "Shoot":
    """cloud, yaw in degrees -> picture [H, W, 3 or 4] u8 from there."""
    from app.drive.background import flat, straight_alpha
    from render import cameras
    from render.splats.stereo import draw_pair, side_by_side

    behind, transparent = flat(settings.background), settings.background == "transparent"

    def shoot(cloud: "Gaussians", yaw_deg: float) -> "NDArray[np.uint8]":
        size = settings.size
        camera = cameras.portrait(size, size, yaw_deg=yaw_deg, background=behind)
        if settings.stereo:
            picture = draw_pair(renderer, cloud, side_by_side(camera))
        else:
            renderer.draw(cloud, camera)
            picture = renderer.read_rgba()
        return straight_alpha(picture) if transparent else picture[..., :3].copy()

    return shoot


def _views(
    decoder: "Decoder", who: "Identity", shoot: "Shoot", settings: PictureSettings
) -> "list[Picture]":
    from render.avatars import sheet

    if settings.traverse:
        return sheet.traversals(decoder, who, shoot)
    if settings.sheet == "heads":
        return sheet.turned(decoder, who, shoot)
    if settings.sheet == "lights":
        return sheet.lights(who, shoot, settings.gaussians)
    return sheet.avatar(decoder, who, shoot, sheet.SHEETS[settings.sheet])
