"""Free text for an emotion: a CLIP text model finds the known labels nearest to it.

The model lies in a local folder (transformers' format, e.g. openai/clip-vit-base-patch32); nothing
is downloaded. The shipped embeddings are not CLIP's, so the text is not an input of the zero
convolutions, as in the paper (section 5.1), but becomes a mixture of the two nearest labels.
Results are kept in a small file, so that the model is loaded only for new words.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from encoder.emotion.control import MAX_PARTS, NEUTRAL
from sensors import files
from sensors.types import InputError

Embed = Callable[[Sequence[str]], NDArray[np.float32]]  # texts -> unit rows [n, 512]
SENTENCE = "a photo of a face that looks {}"
SHARPNESS = 100.0  # CLIP's scale of similarities


def clip_embed(folder: Path) -> Embed:
    """The text encoder of the CLIP model in `folder`.

    Raises InputError where there is no such model, or no transformers package.
    """
    if not (folder / "config.json").is_file():
        raise InputError(
            f"--clip {folder}: expected a folder with a CLIP model (config.json, weights, "
            "vocab.json, merges.txt), got none; fetch one, e.g. openai/clip-vit-base-patch32"
        )
    try:
        import torch

        # Untyped: to infer what transformers returns takes pyright half a minute.
        transformers: Any = import_module("transformers")
        text_model, tokens_of = transformers.CLIPTextModelWithProjection, transformers.CLIPTokenizer
    except ImportError as error:
        raise InputError(
            f"--clip: expected transformers, got {error}; run: pip install livedrive[text]"
        ) from error
    try:
        tokenizer = tokens_of.from_pretrained(str(folder), local_files_only=True)
        model = text_model.from_pretrained(str(folder), local_files_only=True)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(
            f"--clip {folder}: expected a CLIP model, got: {str(error).splitlines()[0]}; "
            "fetch one, e.g. openai/clip-vit-base-patch32"
        ) from error

    def embed(texts: Sequence[str]) -> NDArray[np.float32]:
        tokens = tokenizer(list(texts), padding=True, truncation=True, return_tensors="pt")
        with torch.inference_mode():
            rows = model(**tokens).text_embeds.float().numpy()
        return rows / np.linalg.norm(rows, axis=1, keepdims=True)

    return embed


def understood(
    words: str, labels: Sequence[str], embed: Callable[[], Embed] | None, cache: Path
) -> str:
    """`words` in terms of the labels: `proud:0.8` -> `happy:0.52+excited:0.28`.

    Known words, and unknown ones where there is no model, are returned unchanged.
    """
    parts = [part.strip() for part in words.split("+")]
    if len(parts) != 1:
        return words
    text, colon, number = parts[0].partition(":")
    text = " ".join(text.split()).lower()
    if not text or text in (NEUTRAL, *labels):
        return words
    known: dict[str, dict[str, float]] = _read(cache)
    if text not in known or not set(known[text]) <= set(labels):
        if embed is None:
            return words
        known[text] = nearest_labels(text, labels, embed())
        cache.parent.mkdir(parents=True, exist_ok=True)
        files.write_text(cache, json.dumps(known, indent=1) + "\n")
    try:
        intensity = float(number) if colon else 1.0
    except ValueError:
        return words
    return "+".join(f"{label}:{intensity * share:.3f}" for label, share in known[text].items())


def nearest_labels(text: str, labels: Sequence[str], embed: Embed) -> dict[str, float]:
    """The MAX_PARTS labels nearest to a text, with shares that add up to at most 1."""
    rows = embed([SENTENCE.format(word) for word in (text, *labels)])
    likeness = SHARPNESS * (rows[1:] @ rows[0])
    best = np.argsort(-likeness)[:MAX_PARTS]
    share = np.exp(likeness[best] - likeness[best[0]])
    share = np.floor(1000 * share / share.sum()) / 1000  # rounded down: the sum stays below 1
    return {str(labels[i]): round(float(s), 3) for i, s in zip(best, share, strict=True)}


def _read(cache: Path) -> dict[str, dict[str, float]]:
    try:
        known = files.read_json(cache)
    except (FileNotFoundError, ValueError):
        return {}  # a cache: lost entries are computed again
    return known if isinstance(known, dict) else {}
