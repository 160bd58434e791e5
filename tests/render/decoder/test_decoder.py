"""The decoder and the avatars that ship with the package."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from render.decoder import identity, prior_file
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.decoder.learned import avatar_files, weights_file
from render.decoder.posing import KAPPA_DEG, gaze_rotation
from render.types import AHEAD, FIELDS
from sensors.types import InputError


def pose(decoder: Decoder, **activations: float) -> np.ndarray:
    rig = np.zeros(len(decoder.rig_names), np.float32)
    for name, value in activations.items():
        rig[decoder.rig_names.index(name)] = value
    return decoder.encode(rig)


def gap_mm(decoder: Decoder, who: identity.Identity, vertices: np.ndarray) -> float:
    """Gap of the inner lips at mid-mouth: vertices that touch at rest."""
    upper, lower = (decoder.regions[f"lips_{part}"] for part in ("upper", "lower"))
    distance = np.linalg.norm(who.geometry[upper, None] - who.geometry[lower], axis=-1)
    distance[np.abs(who.geometry[upper, 0]) > 8] = np.inf
    u, v = np.unravel_index(distance.argmin(), distance.shape)
    return float(vertices[upper[u], 1] - vertices[lower[v], 1])


def test_rig_round_trip(decoder: Decoder) -> None:
    rig = np.random.default_rng(0).uniform(0, 1, (20, 53)).astype(np.float32)
    np.testing.assert_allclose(decoder.rig(decoder.encode(rig)), rig, atol=1e-4)


def test_distance_of_codes_is_distance_of_faces(decoder: Decoder) -> None:
    """Two codes as far apart as their faces: jawOpen moves far more than noseSneer_L."""
    jaw = np.linalg.norm(pose(decoder, jawOpen=1.0))
    nose = np.linalg.norm(pose(decoder, noseSneer_L=1.0))
    assert jaw > 4 * nose


def test_vertices_move_as_the_code_says(decoder: Decoder) -> None:
    who, brows = identity.load("ben"), decoder.regions["brows"][::5]
    code = pose(decoder, browInnerUp_L=0.6)
    shown, still = (decoder.vertices(x, AHEAD, who) for x in (code, 0 * code))
    moved = (code @ decoder.moves(brows)).reshape(-1, 3)
    np.testing.assert_allclose(moved, (shown - still)[brows], atol=1e-3)
    assert np.abs(moved).max() > 2


@pytest.mark.parametrize("name", avatar_files.names())
def test_every_avatar_opens_its_mouth_and_turns_its_eyes(decoder: Decoder, name: str) -> None:
    who = identity.load(name)
    rest = decoder.vertices(np.zeros(EXPRESSION_DIM, np.float32), AHEAD, who)
    still = np.setdiff1d(np.arange(len(rest)), np.concatenate(decoder.eyeballs))
    np.testing.assert_allclose(rest[still], who.geometry[still], atol=1e-3)
    opened = decoder.vertices(pose(decoder, jawOpen=0.6), AHEAD, who)
    assert gap_mm(decoder, who, opened) - gap_mm(decoder, who, rest) > 5
    left = np.tile(np.array([np.sin(0.4), 0, np.cos(0.4)], np.float32), (2, 1))
    looking = decoder.vertices(np.zeros(EXPRESSION_DIM, np.float32), left, who)
    for members in decoder.eyeballs:
        front = members[np.argmax(rest[members, 2])]
        assert looking[front, 0] - rest[front, 0] > 3  # towards the subject's left


def test_pupils_point_outward_of_where_one_looks(decoder: Decoder) -> None:
    """By the same angle on both sides; a gaze inward by it has them point ahead."""
    who = identity.load("ada")
    for inward, way in ((0.0, 1.0), (KAPPA_DEG, 0.0)):
        x = np.sin(np.radians(inward))
        look = np.array([[-x, 0, (1 - x * x) ** 0.5], [x, 0, (1 - x * x) ** 0.5]], np.float32)
        posed = decoder.vertices(np.zeros(EXPRESSION_DIM, np.float32), look, who)
        for eye, side in enumerate((1, -1)):
            front = posed[decoder.eyeballs[eye]] - who.eye_centers[eye]
            before = who.geometry[decoder.eyeballs[eye]] - who.eye_centers[eye]
            turned = np.arctan2(front[:, 0], front[:, 2]) - np.arctan2(before[:, 0], before[:, 2])
            degrees = np.degrees(turned[before[:, 2] > 10])
            np.testing.assert_allclose(degrees, side * way * KAPPA_DEG, atol=0.01)


def test_an_eyeball_turns_rigidly() -> None:
    gaze = np.array([0.3, -0.2, 0.9], np.float32)
    gaze /= np.linalg.norm(gaze)
    rotation = gaze_rotation(gaze)
    np.testing.assert_allclose(rotation @ [0, 0, 1], gaze, atol=1e-6)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)


def test_gaussians_are_enough_and_well_formed(decoder: Decoder) -> None:
    who = identity.load("ben")
    mesh, gaussians = decoder.decode(pose(decoder, jawOpen=0.5, mouthSmile_L=1), AHEAD, who)
    gaussians.check()
    assert len(gaussians) >= 16_000
    assert mesh.vertices.shape == (26719, 3)
    for name in FIELDS:
        assert np.isfinite(getattr(gaussians, name)).all()
    assert (np.linalg.norm(gaussians.quats, axis=1) > 1e-6).all()
    assert (gaussians.scales > 0).all()


def test_decoding_is_repeatable(decoder: Decoder) -> None:
    who, code = identity.load("ada"), pose(decoder, jawOpen=0.3)
    first = decoder.decode(code, AHEAD, who)[1]
    second = decoder.decode(code, AHEAD, who)[1]
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    np.testing.assert_array_equal(first.shine.weights, second.shine.weights)


def test_an_unknown_avatar_names_the_others() -> None:
    with pytest.raises(InputError, match=r"expected one of ada, ben, .*, got 'nobody'"):
        identity.load("nobody")


def broken(tmp_path: Path) -> Path:
    for suffix in (".safetensors", ".json"):
        shutil.copy((weights_file.FOLDER / "avatar_ben").with_suffix(suffix), tmp_path)
    return tmp_path / "avatar_ben"


def test_parts_are_computed_once_for_each_file(monkeypatch: pytest.MonkeyPatch) -> None:
    made = list[tuple[str, object]]()

    def compute(tensors: object, card: dict[str, str], gaussians: object) -> dict[str, object]:
        made.append((card["sha256"], gaussians))
        return {"of": made[-1]}

    monkeypatch.setattr(prior_file, "_known", {})
    monkeypatch.setattr(prior_file, "_parts", compute)
    for card, gaussians in (("a", "32k"), ("a", "32k"), ("a", None), ("b", "32k"), ("a", "32k")):
        found = prior_file.parts({}, {"sha256": card}, gaussians)
        assert found.pop("of") == (card, gaussians)  # and what is taken out of it is not missed
    assert made == [("a", "32k"), ("a", None), ("b", "32k")]
    for card in ("c", "d", "e", "a"):
        prior_file.parts({}, {"sha256": card}, "32k")
    assert len(prior_file._known) == prior_file.KNOWN and made[-1] == ("a", "32k")


def test_a_truncated_file_is_an_error(tmp_path: Path) -> None:
    path = broken(tmp_path).with_suffix(".safetensors")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="truncated or altered"):
        identity.load("ben", tmp_path)


def test_an_altered_file_is_an_error(tmp_path: Path) -> None:
    path = broken(tmp_path).with_suffix(".safetensors")
    data = bytearray(path.read_bytes())
    data[-5] ^= 1
    path.write_bytes(data)
    with pytest.raises(InputError, match="truncated or altered"):
        identity.load("ben", tmp_path)


def test_the_wrong_kind_is_an_error(tmp_path: Path) -> None:
    path = broken(tmp_path).with_suffix(".json")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"kind": "prior"}))
    with pytest.raises(InputError, match="expected kind 'identity'"):
        identity.load("ben", tmp_path)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"kind": "identity"}'])
def test_a_damaged_card_is_an_error(tmp_path: Path, text: str) -> None:
    broken(tmp_path).with_suffix(".json").write_text(text)
    with pytest.raises(InputError, match="damaged"):
        identity.load("ben", tmp_path)


def test_reused_memory_holds_the_same_head(decoder):
    """What never moves is written once; nothing of the last face or the last person stays."""
    rng, people = np.random.default_rng(3), [identity.load(name) for name in ("hugo", "ada")]
    for code in (decoder.sample(rng), decoder.sample(rng)):
        for who in people:
            fresh = decoder.decode(code, AHEAD, who)[1]
            reused = decoder.decode(code, AHEAD, who, reuse=True)[1]
            for name in FIELDS:
                np.testing.assert_array_equal(getattr(reused, name), getattr(fresh, name))
    again = decoder.decode(decoder.sample(rng), AHEAD, people[1], reuse=True)[1]
    assert again.means is reused.means and fresh.means is not reused.means


@pytest.mark.parametrize(("length", "says"), [(6, True), (30, False)])
def test_a_free_part_longer_than_any_faces_says_nothing(decoder: Decoder, length, says) -> None:
    """Red before: with an emotion eyes were black, and corners of the mouth dirty."""
    who, coding = identity.load("ben"), decoder.coding
    smile = pose(decoder, mouthSmile_L=0.7, mouthSmile_R=0.7)
    noise = np.random.default_rng(0).standard_normal(len(coding.free)).astype(np.float32)
    normal = coding.normalised(smile)
    normal[-len(noise) :] = length * noise / np.linalg.norm(noise)
    _, plain = decoder.decode(smile, AHEAD, who)
    _, noisy = decoder.decode(coding.code(normal), AHEAD, who)
    off = np.abs(noisy.colors - plain.colors).max()
    assert off > 0.02 if says else off < 1e-3
