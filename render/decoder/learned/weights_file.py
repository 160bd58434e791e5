"""Reading and writing the prior's weights: safetensors beside a JSON card.

The card states the kind, how the file was made, and the SHA-256 of the tensors, so that a
truncated, altered or wrong file is an error and never a strange face.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors import files
from sensors.types import InputError

FOLDER = Path(__file__).parents[2] / "weights"


def save(
    path: Path, tensors: dict[str, NDArray[Any]], card: dict[str, Any], *, private: bool = False
) -> None:
    """Write `path`.safetensors and `path`.json; `card` must hold "kind". On a full disk, or after
    Ctrl-C, both are the older ones.

    `private`: for their owner alone (0600)."""
    from safetensors.numpy import save as to_bytes

    data = to_bytes({name: np.ascontiguousarray(value) for name, value in tensors.items()})
    path.parent.mkdir(parents=True, exist_ok=True)
    card = {**card, "sha256": hashlib.sha256(data).hexdigest()}
    text = json.dumps(card, indent=2) + "\n"
    with files.replacing(path.with_suffix(".safetensors"), private=private) as draft:
        files.write_bytes(draft, data, private=private)
        files.write_text(path.with_suffix(".json"), text, private=private)


def load(path: Path, kind: str) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read a weights file of the given kind -> tensors, card; raise InputError otherwise."""
    from safetensors import SafetensorError
    from safetensors.numpy import load as from_bytes

    tensor_path, card_path = path.with_suffix(".safetensors"), path.with_suffix(".json")
    ours, both = path.parent == FOLDER, f"{tensor_path.name} and {card_path.name}"
    cure = "restore it from the repository" if ours else f"copy {both} again, or make them anew"
    for part in (tensor_path, card_path):
        if not files.check_regular(part).exists():
            beside = f" beside {tensor_path.name}" if part == card_path else ""
            raise InputError(f"weights: expected {part}{beside}, got no such file; {cure}")
    try:
        card = files.read_json(card_path)
        got_kind, expected_hash = card["kind"], card["sha256"]
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"weights: expected a card with kind and sha256 in {card_path}, got a damaged file; "
            f"{cure}"
        ) from None
    if got_kind != kind:
        raise InputError(
            f"weights: expected kind {kind!r} in {card_path}, got {got_kind!r}; give another file"
        )
    data = files.read_bytes(tensor_path)
    if hashlib.sha256(data).hexdigest() != expected_hash:
        raise InputError(
            f"weights: expected the contents that {card_path.name} states, got a truncated or "
            f"altered {tensor_path}; {cure}"
        )
    try:
        return from_bytes(data), card
    except (SafetensorError, KeyError) as error:  # KeyError: a type that numpy lacks
        raise InputError(
            f"weights: expected safetensors, got {error} in {tensor_path}; {cure}"
        ) from None
