"""A checkpoint comes back as it was saved, and every damaged one is one line of InputError."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import torch

from encoder.denoiser.config import PRESETS, DenoiserConfig
from encoder.denoiser.model import Denoiser
from encoder.nn.checkpoint import SCALE, config_from, load, quantised, save
from sensors.types import InputError


def saved(folder: Path) -> tuple[Path, Denoiser]:
    torch.manual_seed(0)
    denoiser = Denoiser(PRESETS["debug"])
    card = {"kind": "student", "config": asdict(denoiser.config), "steps": 3}
    save(folder / "student", denoiser.state_dict(), card)
    return folder / "student", denoiser


def test_round_trip(tmp_path: Path) -> None:
    path, denoiser = saved(tmp_path)
    tensors, card = load(path, "student")
    assert card["steps"] == 3 and config_from(DenoiserConfig, card["config"]) == PRESETS["debug"]
    for name, tensor in denoiser.state_dict().items():
        np.testing.assert_array_equal(tensors[name], tensor.numpy())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["student.json", "student.safetensors"]


def truncate(path: Path) -> None:
    file = path.with_suffix(".safetensors")
    file.write_bytes(file.read_bytes()[:-100])


def alter(path: Path) -> None:
    file = path.with_suffix(".safetensors")
    data = bytearray(file.read_bytes())
    data[-5] ^= 1
    file.write_bytes(bytes(data))


def remove(path: Path) -> None:
    path.with_suffix(".json").unlink()


def not_json(path: Path) -> None:
    path.with_suffix(".json").write_bytes(b"\xff{")


def other_format(path: Path) -> None:
    path.with_suffix(".json").write_text("[]")


@pytest.mark.parametrize("damage", [truncate, alter, remove, not_json, other_format])
def test_damage_is_an_input_error(tmp_path: Path, damage: Callable[[Path], None]) -> None:
    path, _ = saved(tmp_path)
    damage(path)
    with pytest.raises(InputError, match="expected .* got .*livedrive train"):
        load(path, "student")


def test_wrong_kind(tmp_path: Path) -> None:
    path, _ = saved(tmp_path)
    with pytest.raises(InputError, match="expected kind 'audio', got 'student'"):
        load(path, "audio")
    with pytest.raises(InputError, match="kind"):
        save(path, {}, {"kind": "other", "config": {}})


def test_unknown_config_key_names_the_close_one(tmp_path: Path) -> None:
    path, _ = saved(tmp_path)
    card = json.loads(path.with_suffix(".json").read_text())
    card["config"]["windw"] = card["config"].pop("window")
    with pytest.raises(InputError, match="'windw'; did you mean window"):
        config_from(DenoiserConfig, card["config"])


def matrices() -> dict[str, np.ndarray]:
    even = np.random.default_rng(0).standard_normal((8, 64, 3), dtype=np.float32)
    uneven = even.reshape(8, -1).copy()
    uneven[:, -1] *= 100
    return {"even": even, "uneven": uneven, "short": even[:, :8, 0], "vector": even[:, 0, 0]}


def test_int8_matrices_come_back_nearly_and_are_not_rounded_twice(tmp_path: Path) -> None:
    tensors, card = matrices(), {"kind": "student", "config": {}}
    stored = quantised(tensors)
    kinds = {name: array.dtype for name, array in stored.items()}
    assert kinds["even"] == np.int8 and kinds["vector"] == np.float32
    assert kinds["uneven"] == kinds["short"] == np.float16
    save(tmp_path / "student", stored, card)
    read, _ = load(tmp_path / "student", "student")
    assert read.keys() == tensors.keys()
    for name, array in tensors.items():
        assert read[name].dtype == np.float32
        assert np.linalg.norm(read[name] - array) < 0.01 * np.linalg.norm(array), name
    again = quantised(read)
    assert all(np.array_equal(again[name], stored[name]) for name in stored)


@pytest.mark.parametrize("scale", [np.ones(7, np.float32), np.ones((8, 2), np.float32)])
def test_int8_without_a_scale_for_each_row_is_an_input_error(tmp_path: Path, scale) -> None:
    stored = quantised(matrices()) | {"even" + SCALE: scale}
    save(tmp_path / "student", stored, {"kind": "student", "config": {}})
    with pytest.raises(InputError, match="scale for each row"):
        load(tmp_path / "student", "student")
