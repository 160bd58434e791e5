"""Avatar files from anywhere: a wrong one is a line, never a wild read of the compiled loops."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file
from safetensors.numpy import save as to_bytes

from render.decoder import identity, prior_file
from render.decoder.learned import avatar_files, weights_file
from sensors.types import InputError


def write(folder: Path, tensors: dict[str, np.ndarray]) -> str:
    """An avatar file whose checksum is right, whatever is in it."""
    data = to_bytes({name: np.ascontiguousarray(value) for name, value in tensors.items()})
    (folder / "avatar_evil.safetensors").write_bytes(data)
    card = {"kind": identity.KIND, "sha256": hashlib.sha256(data).hexdigest()}
    (folder / "avatar_evil.json").write_text(json.dumps(card))
    return str(folder / "avatar_evil.safetensors")


def shipped(name: str) -> dict[str, np.ndarray]:
    return load_file(weights_file.FOLDER / f"avatar_{name}.safetensors")


def test_a_copy_of_a_shipped_avatar_loads_from_its_file(tmp_path: Path) -> None:
    who = identity.load(write(tmp_path, shipped("hugo")))
    assert who.name == "evil" and len(who.beard) == len(identity.load("hugo").beard)


def test_a_lost_card_is_told_with_what_helps(tmp_path: Path) -> None:
    """Red before: `run: livedrive doctor`, which knows nothing of the user's files."""
    path = write(tmp_path, shipped("hugo"))
    (tmp_path / "avatar_evil.json").write_text("{}")
    with pytest.raises(InputError, match=r"a damaged file; copy avatar_evil.safetensors and"):
        identity.load(path)
    (tmp_path / "avatar_evil.json").unlink()
    words = r"evil.json beside avatar_evil.safetensors, got no such file; copy avatar_evil"
    with pytest.raises(InputError, match=words):
        identity.load(path)


def test_an_avatar_beside_a_decoder_of_its_own_is_checked_against_that(tmp_path: Path) -> None:
    """Red before: `eval ab` refused the weights of a version with other light networks."""
    tensors = shipped("hugo")
    tensors["bias3"] = tensors["bias3"][:, :5]
    path = write(tmp_path, tensors)
    with pytest.raises(InputError, match="bias3"):
        identity.load("evil", tmp_path)
    prior, card = weights_file.load(weights_file.FOLDER / "prior", prior_file.KIND)
    last = prior["light_up_weight3"]
    weights_file.save(tmp_path / "prior", prior | {"light_up_weight3": last[:5]}, card)
    assert identity.load("evil", tmp_path).biases[3].shape[1] == 5
    with pytest.raises(InputError, match="bias3"):
        identity.load(path)


def test_an_avatar_without_colours_of_thinner_heads_has_the_means(tmp_path: Path) -> None:
    tensors = shipped("hugo")
    assert set(identity.load("hugo").detail) == {"16k", "32k"}
    plain = {k: v for k, v in tensors.items() if not k.startswith("detail_")}
    assert identity.load(write(tmp_path, plain)).detail == {}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("geometry", lambda t: t[:100]),
        ("geometry", lambda t: t.astype(np.float32)),
        ("albedo", lambda t: t[:-1]),
        ("eye_centers", lambda t: np.full_like(t, np.nan)),
        ("bias0", lambda t: t[:3]),
        ("hair_quats", lambda t: t[: len(t) // 2]),
        ("hair_means", lambda t: np.full_like(t, np.inf)),
        ("beard_corners", lambda t: np.full_like(t, 65_535)),  # red before: segmentation fault
        ("beard_shares", lambda t: t[:7]),
        ("shut", lambda t: None),
        ("detail_32k", lambda t: t[:-1]),
        ("detail_16k", lambda t: None),
        ("more", lambda t: np.zeros(3, np.float32)),
    ],
)
def test_a_wrong_tensor_is_told(tmp_path: Path, name: str, change) -> None:
    tensors = shipped("kofi")
    value = change(tensors.get(name))
    tensors.pop(name, None)
    if value is not None:
        tensors[name] = value
    with pytest.raises(InputError, match="avatar create"):
        identity.load(write(tmp_path, tensors))


def test_people_of_the_user_are_found_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    avatar_files.user_folder().mkdir(parents=True)
    write(avatar_files.user_folder(), shipped("ada"))
    assert "evil" in avatar_files.names() and "evil" not in avatar_files.shipped()
    assert identity.load("evil").name == "evil"
