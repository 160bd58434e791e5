"""Which avatars there are, and where their files lie; `render/decoder/identity.py` reads them."""

from pathlib import Path

from render.decoder.learned.weights_file import FOLDER
from sensors import folders
from sensors.types import InputError

PREFIX = "avatar_"


def user_folder() -> Path:
    """The folder to which `avatar create` writes."""
    return folders.data() / "avatars"


def shipped() -> list[str]:
    """Names of the shipped avatars, sorted."""
    return _names(FOLDER)


def names(folder: Path | None = None) -> list[str]:
    """The identities that can be loaded by name, sorted; default: the shipped and the user's."""
    if folder is not None:
        return _names(folder)
    return sorted({*shipped(), *_names(user_folder())})


def _names(folder: Path) -> list[str]:
    return sorted(path.stem.removeprefix(PREFIX) for path in folder.glob(f"{PREFIX}*.safetensors"))


def label(name: str) -> str:
    """What people are shown of a name, which may be a file: no folder of this machine."""
    if not name.endswith(".safetensors"):
        return name
    short = Path(name).stem.removeprefix(PREFIX)
    return f"{short} (a file)" if short in names() else short


def path_of(name: str, folder: Path | None = None) -> Path:
    """The file of an identity, by its name or FILE.safetensors; InputError naming those that
    exist."""
    if name.endswith(".safetensors"):
        return Path(name)
    if name in names(folder):
        folder = folder or (FOLDER if name in shipped() else user_folder())
        return folder / f"{PREFIX}{name}.safetensors"
    raise InputError(
        f"avatar: expected one of {', '.join(names(folder)) or '(none)'} or a .safetensors "
        f"file, got {name!r}; run: livedrive avatar list"
    )
