"""Weights on disk: tensors in safetensors, everything else in a JSON card beside them.

The card says what the tensors are (kind), the config that rebuilds the model, and a hash of the
tensors, so that a wrong, cut or altered file is an error before anything runs. Matrices may lie
there as int8 with a scale a row, just as the live path multiplies them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from encoder.onnx_graph import MIN_INT8_INPUTS
from sensors.types import InputError

if TYPE_CHECKING:
    from torch import Tensor

FORMAT = 1
SCALE = ".int8_scale"  # of the matrix whose name stands before it
MAX_ROUNDING = 0.02  # of a column's norm, in the mean; values of even size lose less than 0.01
KINDS = ("audio", "centred", "heads", "diffusion", "student", "eyes", "emotion")
Config = TypeVar("Config")


def tensors_sha256(tensors: Mapping[str, Tensor]) -> str:
    """Hash over sorted names, types, shapes and bytes: independent of the file's layout."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        array = tensors[name].detach().cpu().contiguous().numpy()
        digest.update(f"{name} {array.dtype} {array.shape}\n".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def quantised(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Matrices [rows, ...] as int8 and a scale [rows] beside them, each as the int8 path has it.

    Small ones, and those that int8 would change by more than MAX_ROUNDING, stay float16.
    """
    import torch

    result: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        if not tensor.is_floating_point() or tensor.ndim < 2:
            result[name] = tensor
            continue
        rows = tensor.float().flatten(1)
        scale = rows.abs().amax(1).clamp(min=1e-12) / 127
        rounded = (rows / scale[:, None]).round()
        error = (rounded * scale[:, None] - rows).norm(dim=0) / rows.norm(dim=0).clamp(min=1e-12)
        if rows.shape[1] < MIN_INT8_INPUTS or float(error.mean()) > MAX_ROUNDING:
            result[name] = tensor.half()
        else:
            result[name] = rounded.to(torch.int8).reshape(tensor.shape)
            result[name + SCALE] = scale
    return result


def dequantised(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The inverse of `quantised`, up to its rounding; other tensors stay as they are."""
    result: dict[str, Tensor] = {}
    for name, tensor in tensors.items():
        scale = tensors.get(name + SCALE)
        if scale is not None:
            tensor = tensor * scale.reshape(-1, *[1] * (tensor.ndim - 1))
        if not name.endswith(SCALE):
            result[name] = tensor
    return result


def save(path: Path | str, tensors: Mapping[str, Tensor], card: Mapping[str, Any]) -> None:
    """Write `path`.safetensors and `path`.json; the card needs "kind" and "config"."""
    from safetensors.torch import save_file

    if card.get("kind") not in KINDS or "config" not in card:
        raise InputError(
            f"checkpoint card: expected kind in {KINDS} and a config, got {card.get('kind')!r}; "
            "set both before saving"
        )
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    tensors = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    card = {"format": FORMAT, **card, "sha256": tensors_sha256(tensors)}
    partial = path.with_name(path.name + ".partial")
    save_file(tensors, partial)
    partial.replace(path.with_name(path.name + ".safetensors"))
    write_card(path, card)


def write_card(path: Path, card: Mapping[str, Any]) -> None:
    """`path`.json as a whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(card, indent=1) + "\n")
    partial.replace(path.with_name(path.name + ".json"))


def load(path: Path | str, *kinds: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read and verify `path`.safetensors + `path`.json of one of `kinds` -> tensors, card."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    path = Path(path)
    stage = "diffusion" if {"diffusion", "student"} & {*kinds} else "audio"
    stage = next((kind for kind in ("eyes", "emotion") if kind in kinds), stage)

    def fail(expected: str, got: object) -> InputError:
        remedy = f"restore the file or run `livedrive train {stage}`"
        return InputError(f"checkpoint {path}: expected {expected}, got {got}; {remedy}")

    try:
        card = json.loads(path.with_name(path.name + ".json").read_text())
        tensors = load_file(path.with_name(path.name + ".safetensors"))
    except FileNotFoundError as error:
        raise fail("a .safetensors and a .json file", "not both") from error
    except (json.JSONDecodeError, UnicodeDecodeError, SafetensorError) as error:
        raise fail("readable files", error) from error
    if not isinstance(card, dict) or card.get("format") != FORMAT:
        raise fail(f"a card of format {FORMAT}", "another")
    if card.get("kind") not in kinds:
        raise fail(f"kind {' or '.join(map(repr, kinds))}", repr(card.get("kind")))
    if card.get("sha256") != tensors_sha256(tensors):
        raise fail("the tensors that the card was written for", "others")
    try:
        return dequantised(tensors), card
    except RuntimeError as error:
        raise fail("a scale for each row of an int8 matrix", error) from error


def config_from(kind: type[Config], values: Mapping[str, Any]) -> Config:
    """Build a config dataclass from a card's JSON; an unknown key is an error naming close ones."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for key in values:
        if key not in names:
            near = ", ".join(get_close_matches(key, names)) or ", ".join(names)
            raise InputError(
                f"{kind.__name__}: expected known keys, got {key!r}; did you mean {near}?"
            )
    return kind(**{key: _tuples(value) for key, value in values.items()})


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
