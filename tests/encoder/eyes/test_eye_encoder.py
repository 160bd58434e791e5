"""The eye encoder: ONNX = PyTorch, mirrored faces, finite on any picture."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from eye_material import encoder, net, pair

from encoder.eyes.conjugate import USUAL_VERGENCE, conjugate, joined
from encoder.eyes.encoder import (
    EyeEncoder,
    load_eye_encoder,
    new_encoder_state,
)
from encoder.eyes.format import GAZE_UNIT, MEASURES, normalised, pixels, unit
from encoder.nn.checkpoint import save
from sensors.types import InputError


@pytest.mark.parametrize("preset", ["debug", "default"])
def test_onnx_equals_torch(preset: str) -> None:
    made, reading = net(preset), encoder(preset)(pair())
    with torch.no_grad():
        x = torch.from_numpy(normalised(pixels(pair()))[0])
        out, measures = made(x), made.meter(x)
    assert np.abs(reading.features - out.features.numpy()).max() < 1e-5
    expected = unit(out.gaze.numpy() * np.float32([[1, 1], [-1, 1]]))
    assert np.abs(reading.gaze - expected).max() < 1e-5
    assert np.abs(reading.side - torch.sigmoid(out.valid).numpy()).max() < 1e-5
    assert np.abs(reading.told_lids - out.lid.clamp(0, 1).numpy()).max() < 1e-5
    assert np.abs(reading.score - torch.sigmoid(measures[:, 0]).numpy()).max() < 1e-5
    assert np.abs(reading.pupils - (0.5 + 0.5 * measures[:, 5:7].numpy())).max() < 1e-5
    assert np.array_equal(reading.lids, reading.told_lids)  # nothing is strange
    doubt = 0.03 + 0.5 * torch.nn.functional.softplus(measures[:, 4] + 0.5)
    assert np.abs(reading.doubt - np.degrees(GAZE_UNIT * doubt.numpy())).max() < 1e-3
    with torch.no_grad():
        both = made.together(out.features[None], out.gaze[None])[0].numpy()
    expected = unit(both * np.float32([[1, 1], [-1, 1]]))
    assert np.abs(reading.together - expected).max() < 1e-5
    assert np.abs(reading.together - reading.gaze).max() > 1e-3
    relative = made.relative.detach().numpy()
    xy = reading.features @ relative[:-1] + relative[-1]
    assert np.abs(reading.relative - unit(xy * np.float32([[1, 1], [-1, 1]]))).max() < 1e-5
    assert np.abs(reading.relative[:, :2]).min() > 1e-3
    assert reading.features.shape == (2, 80) and reading.features.std() > 0.01


def test_a_mirrored_face_looks_the_other_way() -> None:
    """Shared weights: swapping and mirroring the eyes swaps features and mirrors gaze."""
    eyes = pair(1)
    reading, other = encoder()(eyes), encoder()(eyes[::-1, :, ::-1])
    assert np.abs(reading.features - other.features[::-1]).max() < 1e-5
    mirrored = other.gaze[::-1] * np.array([-1, 1, 1], np.float32)
    assert np.abs(reading.gaze - mirrored).max() < 1e-5
    assert np.abs(reading.gaze[0] - reading.gaze[1]).max() > 1e-4


def test_eyes_move_together() -> None:
    """Of two noisy eyes one direction; an eye that is not seen follows the other."""
    both, blind = np.ones(2, np.float32), np.float32([1, 0])
    noisy = np.float32([[0.3, 0.1], [0.1, -0.1]])  # crossed outwards, one up, one down
    gaze = conjugate(noisy, both)
    assert gaze[0, 1] == gaze[1, 1] == pytest.approx(0) and 0 < gaze[1, 0] - gaze[0, 0] < 0.1
    assert gaze.mean(0)[0] == pytest.approx(0.2)
    alone = conjugate(noisy, blind)
    assert np.abs(alone[0] - noisy[0]).max() < 0.01
    assert alone[1, 0] - alone[0, 0] == pytest.approx(USUAL_VERGENCE)  # how far is not seen
    true = np.float32([[0.168, 0.05], [0.232, 0.05]])
    assert np.abs(conjugate(true, both) - true).max() < 1e-3
    shut = joined(unit(noisy), np.float32([1, 0]), both)
    assert np.abs(shut - unit(alone)).max() < 1e-6


def test_both_pictures_tell_while_both_show_an_eye() -> None:
    reading = encoder()(pair())
    reading = reading._replace(lids=np.ones(2, np.float32), score=np.ones(2, np.float32))
    assert np.array_equal(reading.told(), reading.together)
    shut = reading._replace(lids=np.float32([1, 0]))
    for alone in (shut.told(), reading.told(np.array([True, False]))):
        assert np.array_equal(alone, reading.gaze)


def test_finite_on_any_picture() -> None:
    encode = encoder()
    noise = np.random.default_rng(0).integers(0, 256, (2, 400, 400), dtype=np.uint8)
    for eyes in (noise, 0 * noise, 0 * noise + 255, noise // 250):
        reading = encode(eyes.astype(np.uint8))
        assert all(np.isfinite(array).all() for array in reading)
        assert np.abs(reading.features).max() <= 1
        assert (reading.score == 0).all() or eyes.std() > 4  # a flat picture is no eye
        assert np.abs(np.linalg.norm(reading.gaze, axis=1) - 1).max() < 1e-6
        assert (reading.gaze[:, 2] > 0.5).all()


def test_no_gaze_is_behind_the_head() -> None:
    far, near = unit(np.float32([[2, 0], [0, -30]])), unit(np.float32([0.1, -0.2]))
    assert np.isfinite(far).all() and (far[:, 2] > 0.5).all() and far[0, 0] > 0.8 > 0 > far[1, 1]
    assert near[:2] == pytest.approx([0.1, -0.2]) and np.linalg.norm(near) == pytest.approx(1)


def test_synthesised_features_are_the_networks() -> None:
    gaze = unit(np.array([[0.1, -0.05], [0.15, -0.05]], np.float32))
    lids = np.array([1.0, 0.3], np.float32)
    made = net()
    rig = torch.zeros(2, 7)
    rig[:, 0] = 1 - torch.from_numpy(lids)
    left_like = torch.tensor([[0.1, -0.05], [-0.15, -0.05]])
    with torch.no_grad():
        expected = made.synthesise(left_like, rig).numpy()
    assert np.abs(encoder().synthesise(gaze, lids) - expected).max() < 1e-5
    assert GAZE_UNIT > 0


def test_loads_what_was_saved(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="livedrive train eyes"):
        load_eye_encoder(tmp_path)
    made = net()
    card = {"kind": "eyes", "config": asdict(made.config)}
    save(tmp_path / "eyes", made.state_dict(), card)
    expected, actual = encoder()(pair()), load_eye_encoder(tmp_path)(pair())
    assert all(np.array_equal(a, b) for a, b in zip(expected, actual, strict=True))
    tensors = made.state_dict()
    del tensors["relative"]
    save(tmp_path / "eyes", tensors, card)
    with pytest.raises(InputError, match="another version"):
        load_eye_encoder(tmp_path)


def test_eyes_that_disagree_go_their_own_ways() -> None:
    """One picture in both places, one of them mirrored: no eye is pulled to the other."""
    lids, score = np.ones(2, np.float32), np.ones(2, np.float32)
    apart = unit(np.float32([[0.35, 0.1], [-0.35, 0.1]]))
    assert np.abs(joined(apart, lids, score) - apart).max() < 1e-6
    near = unit(np.float32([[0.1, 0.1], [0.14, 0.06]]))
    together = joined(near, lids, score)
    assert abs(together[0, 1] - together[1, 1]) < 1e-6
    weak = joined(apart, lids, np.float32([1, 0]))  # what is not seen disagrees with nobody
    assert np.abs(weak[1, :2] - weak[0, :2] - np.float32([USUAL_VERGENCE, 0])).max() < 1e-2


def test_both_pictures_correct_a_little_only() -> None:
    row = encoder()(pair())._replace(lids=np.ones(2, np.float32), score=np.ones(2, np.float32))
    near, far = (row._replace(together=unit(row.gaze[:, :2] + s)) for s in (0.05, 0.4))
    assert np.abs(near.told() - near.together).max() < 1e-3
    assert np.abs(far.told() - far.gaze).max() < 1e-6


def test_strange_pictures_are_read_by_the_meter() -> None:
    made = net()
    with torch.no_grad():
        made.meter.heads.weight.zero_()
        made.meter.heads.bias.copy_(torch.tensor([6.0, 0.6, 1, 0.5, 9, 0, 0, 0]))
    weights = {name: v.numpy() for name, v in made.state_dict().items()}
    strange = EyeEncoder(made.config, weights)(pair())
    assert strange.doubt.min() > 10 and np.abs(strange.lids - 0.6).max() < 1e-6
    expected = unit(GAZE_UNIT * np.float32([[1, 0.5], [-1, 0.5]]))
    assert np.abs(strange.gaze - expected).max() < 1e-5
    assert np.abs(strange.told() - expected).max() < 1e-5
    usual = encoder()(pair())
    assert np.array_equal(strange.features, usual.features)  # they mean what they meant


def test_not_every_tick_asks_both_networks() -> None:
    class Counted:
        def __init__(self, session: Any) -> None:
            self.session, self.asked = session, 0

        def run(self, names: None, inputs: dict[str, np.ndarray]) -> Any:
            self.asked += 1
            return self.session.run(names, inputs)

    for doubt, expected in ((1.0, (40, 10)), (9.0, (20, 40)), (2.8, (40, 40))):
        made = encoder()
        made._session, made._meter = sessions = Counted(made._session), Counted(made._meter)
        state = made.step(pair(), new_encoder_state())[1]
        before = [session.asked for session in sessions]
        for _ in range(40):
            now = np.full(2, doubt, np.float32)
            state = replace(state, doubt=now, usual=now)
            reading, state = made.step(pair(), state)
            assert np.isfinite(reading.features).all()
        asked = [s.asked - b for s, b in zip(sessions, before, strict=True)]
        assert tuple(asked) == expected


def test_a_doubt_that_wanders_with_the_gaze_moves_no_trust() -> None:
    """Red before: an eye looked elsewhere when the other network was trusted a little more."""

    class Wandering:
        asked, drift = 0, -1.1

        def run(self, names: None, inputs: dict[str, np.ndarray]) -> list[np.ndarray]:
            measures = np.zeros((2, len(MEASURES)), np.float32)
            self.asked += 1
            measures[:, :2] = 6, 1
            measures[:, 4] = self.drift + 0.1 * np.sin(self.asked / 20)
            return [measures]

    made = encoder()
    made._meter = meter = Wandering()
    state, trusted = new_encoder_state(), []
    for _ in range(240):
        _, state = made.step(pair(), state)
        trusted.append(state.strange[0])
    assert 0.2 < trusted[0] < 0.8 and np.ptp(trusted) == 0
    meter.drift = 0.5  # other pictures
    for _ in range(240):
        _, state = made.step(pair(), state)
    assert state.strange.min() == 1


def test_features_stand_for_their_own_gaze() -> None:
    row = encoder()(pair())
    assert np.abs(row.as_features(row.gaze) - row.told_gaze).max() < 1e-6
    bare = row._replace(told_gaze=np.zeros((2, 3), np.float32))
    assert np.array_equal(bare.as_features(row.gaze), row.gaze)
