"""A new avatar from a person's mean geometry and mean texture, a scan, or photographs."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from render.avatars.maker import Maker
    from render.types import Floats

NAME = "a-z, 0-9, - and _, at most 32"


@dataclass(frozen=True, kw_only=True)
class AvatarParts:
    geometry: Path | None  # npz with `vertices` [26719, 3], or OBJ; or a scan of any topology
    photos: tuple[Path, ...]  # instead: one to five of the person
    texture: Path | None  # skin atlas, 2:1; None: the colours of the scan
    landmarks: Path | None  # JSON of places in the scan, see app/avatars/register.py
    eye: str | None  # eye colour; None: as photographed, or brown
    hair: str | None  # avatar whose hair is worn, in the photographed colour
    beard: str | None  # avatar whose beard is worn


def create(name: str, parts: AvatarParts, folder: Path, *, replace: bool) -> Path:
    """Write the avatar into `folder`; -> its weights. `replace`: one of that name may be there.

    Raises InputError where the name is taken or not one, or a file is not what it should be."""
    from app.avatars import photos
    from render.avatars.hair_transfer import worn
    from render.avatars.maker import Maker
    from render.avatars.photos import brows, dress, person
    from render.avatars.photos.colors import eyes
    from render.decoder import identity
    from render.decoder.learned import avatar_files

    _check(name, folder, replace)
    _check_given(parts)
    lender = identity.load(parts.hair) if parts.hair is not None else None
    bearded = identity.load(parts.beard) if parts.beard is not None else None
    maker = Maker()
    if bearded and not len(dress.beard_of(maker, bearded)[0]):
        raise InputError(
            f"--beard: expected somebody who has one, got {parts.beard}; look at all of them with "
            "livedrive avatar show all --picture all.png"
        )
    if parts.eye is not None:
        maker.check_eye(parts.eye)
    if parts.photos:
        head = photos.head(maker, parts.photos)
        eye, color = parts.eye or head.eye, head.beard
        who = person.avatar(maker, name, head, lender, eye)
    else:
        eye, color = parts.eye or eyes.USUAL, None
        who = brows.grown(maker, maker.identity(name, *_scanned(maker, parts), eye))
        if lender:
            who = worn(maker, who, lender)
    if bearded:
        who = dress.bearded(maker, who, bearded, color)
    given = {key: _named(value) for key, value in asdict(parts).items()} | {"eye": eye}
    card = {"command": "livedrive avatar create", **given}
    identity.save(who, folder, card, private=True)
    return (folder / f"{avatar_files.PREFIX}{name}.safetensors").resolve()


def _check_given(parts: AvatarParts) -> None:
    if (parts.geometry is None) == (not parts.photos):
        got = "both" if parts.photos else "neither"
        raise InputError(f"expected a scan with --geometry, or --photos, got {got}; give one")
    if parts.photos and (parts.texture or parts.landmarks):
        raise InputError(
            "expected --texture and --landmarks with --geometry, got --photos; leave them out"
        )


def _scanned(maker: "Maker", parts: AvatarParts) -> "tuple[Floats, Floats]":
    """Geometry [V, 3] mm and skin atlas [1024, 2048, 3]."""
    from app.avatars import register
    from render.avatars import scan

    assert parts.geometry
    skin = scan.read_texture(parts.texture) if parts.texture else None
    if not scan.is_registered(parts.geometry, maker.faces):
        return register.head(maker, parts.geometry, parts.landmarks, skin)
    if skin is None:
        raise InputError(
            f"{parts.geometry}: expected the skin of a head in the topology of the face data, "
            "got no --texture; give its atlas"
        )
    return scan.read_geometry(parts.geometry, maker.faces), skin


def _named(value: Any) -> Any:
    """Of files the names: a card tells nothing of the folders of its owner."""
    if isinstance(value, tuple):
        return [_named(one) for one in cast("tuple[Any, ...]", value)]
    return value.name if isinstance(value, Path) else value


def _check(name: str, folder: Path, replace: bool) -> None:
    from render.decoder.learned import avatar_files

    if not name.replace("-", "").replace("_", "").isalnum() or len(name) > 32:
        raise InputError(f"name: expected {NAME}, got {name!r}; choose another")
    if name == "all" or not name.isascii() or name != name.lower():
        raise InputError(f"name: expected {NAME}, got {name!r}; choose another")
    if name in avatar_files.shipped():
        raise InputError(
            f"name: expected a new one, got that of a shipped avatar, {name}; choose another"
        )
    if name in avatar_files.names(folder) and not replace:
        raise InputError(
            f"name: expected a new one, got that of an avatar in {folder}; "
            "choose another, or add --replace"
        )
    files.check_folder(folder, "--out", "choose another")
