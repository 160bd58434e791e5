"""Safe file access in folders that may come from others: sessions, avatars, weights.

A folder that was sent may hold links. Reading or writing through one would reach any file of the
user, so links and whatever is no regular file are refused, and nothing is written under a name
that can be foreseen. Everything that this program writes or repairs goes through here.
"""

import errno
import json
import os
import secrets
import stat
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

NO_LINK = getattr(os, "O_NOFOLLOW", 0)
READING = os.O_RDONLY | NO_LINK | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
UPDATING = os.O_RDWR | NO_LINK | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
CREATING = os.O_WRONLY | os.O_CREAT | os.O_EXCL | NO_LINK | getattr(os, "O_BINARY", 0)
MAX_JSON = 16 << 20  # bytes; an hour of timeline is 20 MB, but is read line by line
NOT_WHOLE = (
    *(zipfile.BadZipFile, EOFError, zlib.error, NotImplementedError),
    *(tokenize.TokenError, SyntaxError, OverflowError, TypeError),  # an array's header
    RuntimeError,  # an encrypted entry
    Warning,  # of numpy: an odd header writes nothing to the user's terminal
)
MAX_ARRAYS = 1 << 29  # bytes that an npz file may unpack to
NUMPY = r"numpy\.|sensors\.files$"  # whom warnings of numpy about an array name as their place
PRIVATE, SHARED = 0o600, 0o666  # before the user's umask


def check_regular(path: Path) -> Path:
    """`path`, where it is a regular file or nothing; InputError at a link, folder, pipe, device."""
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return path
    if not stat.S_ISREG(mode):
        raise _refused(path, mode)
    return path


def open_regular(path: Path, *, update: bool = False) -> Any:
    """A regular file opened for reading, or to be changed in place; bytes.

    Raises InputError for anything else, and for a change of a file that has a second name.
    """
    check_regular(path)
    try:
        descriptor = os.open(path, UPDATING if update else READING)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise _refused(path, stat.S_IFLNK) from None
        raise
    file = os.fdopen(descriptor, "r+b" if update else "rb")
    found = os.fstat(descriptor)
    if not stat.S_ISREG(found.st_mode):
        file.close()
        raise _refused(path, found.st_mode)
    if update and found.st_nlink > 1:
        file.close()
        raise InputError(
            f"{path}: expected a file with one name, got a hard link; copy the folder and use that"
        )
    return file


def read_bytes(path: Path) -> bytes:
    with open_regular(path) as file:
        return file.read()


def read_text(path: Path) -> str:
    """UTF-8."""
    return read_bytes(path).decode("utf-8")


def parse_json(data: bytes) -> Any:
    """The value; ValueError where it is no JSON, or nested or long as only an attack is."""
    if len(data) > MAX_JSON:
        raise ValueError(f"{len(data)} bytes, more than {MAX_JSON}")
    try:
        return json.loads(data)
    except RecursionError:
        raise ValueError("values nested too deeply") from None


def read_json(path: Path) -> Any:
    """The value of a JSON file; ValueError as of `parse_json`."""
    return parse_json(read_bytes(path))


def load_npz(path: Path, max_bytes: int = MAX_ARRAYS) -> dict[str, NDArray[Any]]:
    """All arrays of an npz file; ValueError where it is none, or would unpack to more than that."""
    with open_regular(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                size = sum(entry.file_size for entry in archive.infolist())
            if size > max_bytes:
                raise ValueError(f"arrays of {size} bytes, more than {max_bytes}")
            file.seek(0)
            with warnings.catch_warnings(), np.load(file, allow_pickle=False) as arrays:
                warnings.filterwarnings("error", module=NUMPY)
                found = {name: arrays[name] for name in arrays.files}
        except (*NOT_WHOLE, MemoryError) as error:  # numpy takes what a header claims
            raise ValueError(f"no whole npz file ({error})") from None
    if other := [name for name, array in found.items() if not isinstance(array, np.ndarray)]:
        raise ValueError(f"{other[0]!r} is not an array")
    return found


def check_folder(folder: Path, option: str, cure: str) -> None:
    """Before long work whose result goes there. Raises InputError where nothing can be written
    into `folder`, or where it is none, and none can be made there."""
    try:
        there = next((parent for parent in (folder, *folder.parents) if parent.exists()), folder)
        TemporaryFile(dir=there).close()
    except OSError as error:
        raise InputError(
            f"{option}: expected a folder to write into, got {folder}: {error.strerror}; {cure}"
        ) from None


@contextmanager
def arrays(path: Path, cure: str) -> Generator[Any]:
    """An npz file of our own, however large, whose arrays are read one by one.

    Raises InputError with the cure where it is damaged or lacks an array.
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            yield data
    except InputError:
        raise
    except (zipfile.BadZipFile, EOFError, zlib.error, ValueError, KeyError) as error:
        said = " ".join(str(error).split())
        raise InputError(f"{path}: expected a whole npz file, got {said}; {cure}") from error


def create(path: Path, *, private: bool = False) -> Path:
    """A new empty file in the place of an older one, to be filled as long as it takes.

    `private`: for its owner alone (0600), as voices, eyes and faces are biometric.
    """
    check_regular(path)
    path.unlink(missing_ok=True)
    try:
        os.close(os.open(path, CREATING, PRIVATE if private else SHARED))
    except FileNotFoundError:
        if not path.parent.is_dir():
            raise
        raise InputError(
            f"{path.parent}: expected a folder that takes new files, got one that takes none, as "
            "/proc; choose another"
        ) from None
    return path


@contextmanager
def replacing(path: Path, *, private: bool = False, durable: bool = True) -> Generator[Path]:
    """An empty file to fill, which then takes the place of `path` in one step, or vanishes.

    It lies beside `path` under a random name with the same suffix. Without `durable` a power cut
    may lose it: for files of which many are written while a head is driven.
    """
    if not path.parent.is_dir():
        raise InputError(f"{path}: expected a folder {path.parent}, got none; create it first")
    check_regular(path)
    draft = path.with_name(f".{path.stem[:100]}.{secrets.token_hex(8)}{path.suffix}")
    create(draft, private=private)
    try:
        yield draft
        if durable:
            with open_regular(draft, update=True) as file:
                os.fsync(file.fileno())
        os.replace(draft, path)
    except OSError as error:
        if error.filename not in (None, str(draft), draft):
            raise
        told = error.strerror or str(error)  # of a full disk, which names nothing, or the draft
        raise OSError(error.errno, told, str(path)) from None
    finally:
        draft.unlink(missing_ok=True)


@contextmanager
def all_or_nothing() -> Generator[None]:
    """For work that leaves nothing where it fails: so is told of a full disk."""
    try:
        yield
    except OSError as error:
        error.add_note("nothing is kept; make room, or choose another place")
        raise


def write_bytes(
    path: Path, data: bytes | memoryview, *, private: bool = False, durable: bool = True
) -> None:
    """The whole file or, after a kill or on a full disk, the one that was there."""
    with replacing(path, private=private, durable=durable) as draft:
        draft.write_bytes(data)


def write_all(file: Any, data: bytes) -> None:
    """All of it to an unbuffered file, which may take less at a time."""
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


def write_text(path: Path, text: str, *, private: bool = False, durable: bool = True) -> None:
    """UTF-8, lines end in a line feed on every system."""
    write_bytes(path, text.encode("utf-8"), private=private, durable=durable)


def _refused(path: Path, mode: int) -> InputError:
    kinds = {stat.S_IFLNK: "a link", stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe"}
    kind = kinds.get(stat.S_IFMT(mode), "a device or socket")
    return InputError(
        f"{path}: expected a regular file, got {kind}; copy the file itself there, or give another"
    )
