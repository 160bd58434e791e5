"""Checks avatar files from anywhere: the compiled loops of the decoder trust sizes and indices.

What a file must hold is what the shipped avatars hold: the same names, dtypes and shapes, but for
the number of Gaussians of hair and beard, and maps as the light decoder beside them wants them.
"""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render.decoder.learned import weights_file
from sensors.types import InputError

Form = tuple[str, tuple[int, ...]]  # dtype as safetensors names it, shape
OWN = ("hair_", "beard_")  # their first dimension is a person's own
OPTIONAL = ("beard_", "detail_", "wrinkles")  # all tensors with this prefix, or none
MAP = "bias"  # maps of the light decoder, coarse to fine
MAX_OWN = 200_000  # Gaussians of hair or beard
FAR_MM = 2000.0  # from the middle of the head


def check(tensors: dict[str, NDArray[Any]], path: Path, weights: Path) -> None:
    """Raise InputError unless the decoder in the folder `weights` can use these tensors of an
    avatar file at `path`."""

    def fail(expected: str, got: object) -> InputError:
        return InputError(
            f"avatar {path}: expected {expected}, got {got}; "
            "make it again with livedrive avatar create"
        )

    shipped = forms(weights_file.FOLDER)
    known = {n: f for n, f in shipped.items() if not n.startswith(MAP)} | maps(weights)
    lacks = [p for p in OPTIONAL if not any(name.startswith(p) for name in tensors)]
    needed = {n: f for n, f in known.items() if not n.startswith(tuple(lacks))}
    if tensors.keys() != needed.keys():
        odd = ", ".join(sorted(tensors.keys() ^ needed.keys())[:3])
        raise fail("the tensors of the shipped avatars", f"others ({odd})")
    counts: dict[str, int] = {}
    for name, (dtype, shape) in needed.items():
        found = tensors[name]
        own = next((prefix for prefix in OWN if name.startswith(prefix)), None)
        wanted = (counts.setdefault(own, len(found)), *shape[1:]) if own and found.ndim else shape
        if found.dtype != dtype or found.shape != wanted:
            raise fail(f"{name} {dtype} {wanted}", f"{found.dtype} {found.shape}")
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            raise fail(f"finite numbers in {name}", "NaN or infinity")
    if max(counts.values(), default=0) > MAX_OWN:
        raise fail(f"at most {MAX_OWN} Gaussians of hair or beard", max(counts.values()))
    places = tensors["hair_means"]
    if places.size and np.abs(places.astype(np.float32)).max() > FAR_MM:
        raise fail(f"hair within {FAR_MM:.0f} mm", "some farther away")
    if "beard_" not in lacks and tensors["beard_corners"].size:
        last, vertices = int(tensors["beard_corners"].max()), len(tensors["geometry"])
        if last >= vertices:
            raise fail(f"corners of the beard below {vertices}", last)


@cache
def forms(folder: Path) -> dict[str, Form]:
    """What the avatars of a folder hold: name of a tensor -> numpy dtype and shape."""
    from safetensors import safe_open

    names = {"U8": "uint8", "U16": "uint16", "I8": "int8", "I16": "int16", "I32": "int32"}
    names |= {"F16": "float16", "F32": "float32"}
    found: dict[str, Form] = {}
    for path in sorted(folder.glob("avatar_*.safetensors")):
        with safe_open(path, "numpy") as file:
            for name in file.keys():  # noqa: SIM118  # it is no dict
                part = file.get_slice(name)
                found[name] = (names[part.get_dtype()], tuple(part.get_shape()))
    return found


@cache
def maps(weights: Path) -> dict[str, Form]:
    """What a folder's light decoder adds at each of its levels."""
    from safetensors import safe_open

    with safe_open(weights / "prior.safetensors", "numpy") as file:
        h, w = file.get_tensor("light_base").tolist()
        levels = sum(name.startswith("light_up_weight") for name in file.keys())  # noqa: SIM118
        depths = [file.get_slice(f"light_up_weight{i}").get_shape()[0] for i in range(levels)]
    return {f"{MAP}{i}": ("float16", (h * w << 2 * i, c)) for i, c in enumerate(depths)}
