"""Files of heads and weights that somebody else made: PLY, OBJ, npz, safetensors, avatars."""

import hashlib
import io
import json
import struct
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from app.bench.fuzz.fuzzer import Fuzzer
from sensors.types import InputError

PLACES = 40


def ply(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from render.avatars import ply as file_format

    fields = file_format.FIELDS
    words = ["ply", "format binary_little_endian 1.0", f"element vertex {PLACES}"]
    words += [*(f"property float {name}" for name in fields), "end_header", ""]
    header = "\n".join(words).encode()
    rows = np.linspace(-1, 1, PLACES * len(fields), dtype=np.float32).tobytes()
    path = folder / "head.ply"

    def feed() -> None:
        header_too = fuzzer.pick(4) > 0
        path.write_bytes(
            fuzzer.mutate(header) + rows if header_too else fuzzer.mutate(header + rows)
        )
        with suppress(InputError):
            file_format.load(path)

    return feed


def _faces() -> np.ndarray:
    return np.array([[k, k + 1, k + 2] for k in range(PLACES - 2)], np.int32)


def _places() -> np.ndarray:  # [PLACES, 3] a head's height
    k = np.arange(PLACES)
    return np.stack([np.cos(k), k * 300 / PLACES, np.sin(k)], 1)


def obj(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    from render.avatars import scan

    text = "".join(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in _places()).encode()
    path, faces = folder / "scan.obj", _faces()

    def feed() -> None:
        path.write_bytes(fuzzer.mutate(text))
        with suppress(InputError):
            scan.read_geometry(path, faces)

    return feed


def npz(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Whole archives, and archives that hold a damaged array."""
    from render.avatars import scan

    inner, path, faces = io.BytesIO(), folder / "scan.npz", _faces()
    np.save(inner, _places().astype(np.float32))

    def archive(array: bytes) -> bytes:
        made = io.BytesIO()
        with zipfile.ZipFile(made, "w") as file:
            file.writestr("vertices.npy", array)
        return made.getvalue()

    whole = archive(inner.getvalue())

    def feed() -> None:
        deep = fuzzer.pick(2)
        path.write_bytes(archive(fuzzer.mutate(inner.getvalue())) if deep else fuzzer.mutate(whole))
        with suppress(InputError):
            scan.read_geometry(path, faces)

    return feed


def safetensors(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Headers of both kinds of weights; the cards' checksums are right, as an attacker's are."""
    from safetensors import SafetensorError
    from safetensors.numpy import load as from_bytes
    from safetensors.numpy import save as to_bytes

    from encoder.nn import checkpoint
    from render.decoder.learned import weights_file

    tensors = {"a": np.ones((8, 4), np.int8), "a.int8_scale": np.ones(8, np.float32)}
    data = to_bytes(tensors | {"b": np.ones(3, np.float16)})
    (size,) = struct.unpack_from("<Q", data)
    header, body = data[8 : 8 + size], data[8 + size :]
    path = folder / "weights"

    def feed() -> None:
        changed = fuzzer.mutate(header)
        length = fuzzer.pick(2**40) if fuzzer.pick(8) == 0 else len(changed)
        made = struct.pack("<Q", length) + changed + body
        path.with_suffix(".safetensors").write_bytes(made)
        card: dict[str, Any] = {"format": 1, "kind": "eyes", "config": {}}
        if fuzzer.pick(2):
            path.with_suffix(".json").write_text(
                json.dumps(card | {"sha256": hashlib.sha256(made).hexdigest()})
            )
            with suppress(InputError):
                weights_file.load(path, "eyes")
            return
        with suppress(SafetensorError, KeyError, ValueError):
            card["sha256"] = checkpoint.tensors_sha256(from_bytes(made))
        path.with_suffix(".json").write_text(json.dumps(card))
        with suppress(InputError):
            checkpoint.load(path, "eyes")

    return feed


def avatar(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Shipped avatars with one tensor damaged, checked and loaded."""
    from render.decoder import identity
    from render.decoder.learned import avatar_files, weights_file

    name = avatar_files.shipped()[0]
    tensors, card = weights_file.load(
        weights_file.FOLDER / f"{avatar_files.PREFIX}{name}", identity.KIND
    )
    names, path = sorted(tensors), folder / "avatar"

    def feed() -> None:
        odd = names[fuzzer.pick(len(names))]
        weights_file.save(path, tensors | {odd: fuzzer.array(tensors[odd])}, card)
        with suppress(InputError):
            identity.load(f"{path}.safetensors")

    return feed


def scan(fuzzer: Fuzzer, folder: Path) -> Callable[[], None]:
    """Scans of another topology in each format; the reader is trimesh's."""
    from render.avatars import surface_scan

    try:
        from trimesh import creation
    except ImportError:
        return lambda: None  # nothing reads scans without the extra
    makes: Any = creation  # its types are partial
    ball = makes.icosphere(subdivisions=3, radius=100)
    kinds = [kind[1:] for kind in surface_scan.KINDS]
    made: dict[str, Any] = {kind: ball.export(file_type=kind) for kind in kinds}
    whole: dict[str, bytes] = {
        kind: data if isinstance(data, bytes) else data.encode() for kind, data in made.items()
    }

    def feed() -> None:
        kind = kinds[fuzzer.pick(len(kinds))]
        path, data = folder / f"scan.{kind}", whole[kind]
        head = 1600 if fuzzer.pick(2) else len(data)  # headers matter most
        path.write_bytes(fuzzer.mutate(data[:head]) + data[head:])
        with suppress(InputError):
            surface_scan.load_mesh(path)

    return feed
