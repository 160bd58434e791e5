"""Weights on disk: tensors in safetensors, everything else in a JSON card beside them.

The card holds the kind of the tensors, the config that rebuilds the model, and a hash of the
tensors, so that a wrong, truncated or altered file is an error before anything runs. Matrices may
be stored as int8 with a scale for each row, just as the live path multiplies them. Needs no torch.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from encoder.nn.onnx_graph import MIN_INT8_INPUTS
from encoder.types import Weights
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from torch import Tensor

FORMAT = 1
SCALE = ".int8_scale"  # suffix to a matrix's name
MAX_ROUNDING = 0.02  # mean rounding error, as a share of the column's norm; usual is below 0.01
STAGES = {  # kind of a checkpoint -> the stage of `livedrive train` that makes it
    "audio": "audio",
    "centred": "audio",
    "diffusion": "diffusion",
    "student": "distill",
    "eyes": "eyes",
    "emotion": "emotion",
    "peer": "peers",
}
NAMED = {"student_eyes": "multimodal", "regression": "regression"}  # files of another stage
Config = TypeVar("Config")


def arrays(tensors: Mapping[str, Tensor | NDArray[Any]]) -> Weights:
    """Torch tensors or arrays, as arrays by the same names."""
    return {
        name: tensor if isinstance(tensor, np.ndarray) else tensor.detach().cpu().numpy()
        for name, tensor in tensors.items()
    }


def tensors_sha256(tensors: Weights) -> str:
    """Hash over sorted names, types, shapes and bytes: independent of the file's layout."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        array = tensors[name]
        digest.update(f"{name} {array.dtype} {array.shape}\n".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def quantised(tensors: Mapping[str, Tensor | NDArray[Any]]) -> Weights:
    """Matrices [rows, ...] as int8, each with a float32 scale [rows], as the int8 path uses them.

    Small matrices, and those that int8 would change by more than MAX_ROUNDING, become float16.
    """
    result: Weights = {}
    for name, array in arrays(tensors).items():
        if not np.issubdtype(array.dtype, np.floating) or array.ndim < 2:
            result[name] = array
            continue
        rows = array.astype(np.float32).reshape(len(array), -1)
        scale = np.maximum(np.abs(rows).max(1), np.float32(1e-12)) / np.float32(127)
        rounded = np.rint(rows / scale[:, None])
        off = np.linalg.norm(rounded * scale[:, None] - rows, axis=0)
        error = float((off / np.maximum(np.linalg.norm(rows, axis=0), 1e-12)).mean())
        if rows.shape[1] < MIN_INT8_INPUTS or error > MAX_ROUNDING:
            result[name] = array.astype(np.float16)
        else:
            result[name] = rounded.astype(np.int8).reshape(array.shape)
            result[name + SCALE] = scale
    return result


def dequantised(tensors: Weights) -> Weights:
    """The inverse of `quantised` up to rounding: float32, except for integer tensors.

    Raises ValueError where the number of scales does not match the rows.
    """
    result: Weights = {}
    for name, array in tensors.items():
        scale = tensors.get(name + SCALE)
        if scale is not None:
            if scale.shape != (len(array),):
                raise ValueError(f"{name}: {scale.shape} scales for {len(array)} rows")
            array = array * scale.reshape(-1, *[1] * (array.ndim - 1))
        if not name.endswith(SCALE):
            half = array.dtype == np.float16
            result[name] = array.astype(np.float32) if half else array
    return result


def save(
    path: Path | str, tensors: Mapping[str, Tensor | NDArray[Any]], card: Mapping[str, Any]
) -> None:
    """Write `path`.safetensors and `path`.json.

    Raises InputError unless the card has a known "kind" and a "config".
    """
    from safetensors.numpy import save as to_bytes

    if card.get("kind") not in STAGES or "config" not in card:
        raise InputError(
            f"checkpoint card: expected a kind of {', '.join(STAGES)} and a config, "
            f"got {card.get('kind')!r}; set both before saving"
        )
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    weights = {name: np.asarray(array, order="C") for name, array in arrays(tensors).items()}
    card = {"format": FORMAT, **card, "sha256": tensors_sha256(weights)}
    files.write_bytes(path.with_name(path.name + ".safetensors"), to_bytes(weights))
    write_card(path, card)


def write_card(path: Path, card: Mapping[str, Any]) -> None:
    """Write `path`.json, as a whole or not at all."""
    files.write_text(path.with_name(path.name + ".json"), json.dumps(card, indent=1) + "\n")


def load(path: Path | str, *kinds: str) -> tuple[Weights, dict[str, Any]]:
    """Read and verify `path`.safetensors and `path`.json of one of `kinds` -> arrays, card.

    Raises InputError where a file is missing, damaged, or of another kind.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load as from_bytes

    path = Path(path)

    def fail(expected: str, got: object) -> InputError:
        return _error(path, expected, got, kinds[0])

    try:
        card = files.read_json(path.with_name(path.name + ".json"))
        tensors = from_bytes(files.read_bytes(path.with_name(path.name + ".safetensors")))
    except FileNotFoundError as error:
        raise fail("a .safetensors and a .json file", "not both") from error
    except (ValueError, SafetensorError, KeyError) as error:  # KeyError: a type numpy lacks
        raise fail("readable files", error) from error
    if not isinstance(card, dict) or card.get("format") != FORMAT:
        raise fail(f"a card of format {FORMAT}", "another format")
    if card.get("kind") not in kinds:
        raise fail(f"kind {' or '.join(map(repr, kinds))}", repr(card.get("kind")))
    if card.get("sha256") != tensors_sha256(tensors):
        raise fail("the tensors that the card was written for", "others")
    try:
        return dequantised(tensors), card
    except ValueError as error:
        raise fail("a scale for each row of an int8 matrix", error) from error


def check_shapes(
    weights: Weights, shapes: Mapping[str, tuple[int, ...]], path: Path, kind: str
) -> None:
    """Raises InputError unless `weights` have exactly these names and shapes."""
    got = {name: array.shape for name, array in weights.items()}
    if got != shapes:
        odd = sorted(k for k in shapes.keys() | got.keys() if shapes.get(k) != got.get(k))
        others = f"other names or shapes ({', '.join(odd[:3])}{', ...' * (len(odd) > 3)})"
        raise _error(path, "the tensors of its config", others, kind)


def _error(path: Path, expected: str, got: object, kind: str) -> InputError:
    stage = NAMED.get(path.name, STAGES[kind])
    remedy = f"restore the file or run `livedrive train {stage}`"
    return InputError(f"checkpoint {path}: expected {expected}, got {got}; {remedy}")


def config_from(kind: type[Config], values: Mapping[str, Any]) -> Config:
    """Build a config dataclass from a card's JSON; a nested object is a config of the same kind.

    Raises InputError at an unknown key, naming close matches.
    """
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in values:
        if key not in names:
            near = ", ".join(get_close_matches(key, names)) or ", ".join(names)
            raise InputError(
                f"{kind.__name__}: expected known keys, got {key!r}; did you mean {near}?"
            )
    known = {k: config_from(kind, v) if isinstance(v, dict) else v for k, v in values.items()}
    return kind(**{key: _tuples(value) for key, value in known.items()})


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
