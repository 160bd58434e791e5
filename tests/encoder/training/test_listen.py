"""A chain that learns to hear phones: the fit, who counts in it, and what is kept of the chain."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from training_material import FACE, pack_of_tones

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.denoiser.config import PRESETS, ZeroConvConfig
from encoder.denoiser.model import Denoiser
from encoder.denoiser.zero_conv import ZeroConvs
from encoder.emotion.labels import LABELS
from encoder.inference import load_networks, load_student
from encoder.nn import checkpoint
from encoder.training.stages import listen
from sensors.types import InputError

pytestmark = pytest.mark.slow
PATHS = {name: Path() for name in ("pack", "phones", "old", "pair", "output")}


def noise(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


def test_a_student_that_listens_shows_shares_of_its_own_mouth_and_of_the_fit() -> None:
    torch.manual_seed(0)
    student = Denoiser(PRESETS["debug"])
    student.expression_std.uniform_(0.5, 2)
    student.expression_mean.normal_()
    matrix, offset = noise(14, 256).numpy(), noise(256).numpy()
    config = listen.preset("debug", **PATHS, share=0.4, gain=1.5)
    sizes, weights = listen.listening(
        student.config, checkpoint.arrays(student.state_dict()), FACE, matrix, offset, config
    )
    assert sizes.direct_dim == 7 and sizes.audio_dim == student.config.audio_dim + 7
    anew = Denoiser(sizes)
    anew.load_state_dict({name: torch.tensor(array) for name, array in weights.items()})
    old, heard = noise(2, 9, student.config.audio_dim), 3 * noise(2, 9, 7)
    x, gaze, tau = noise(2, 9, 256), noise(2, 9, 6), torch.tensor([200])
    with torch.no_grad():
        blocks = student.unstandardise(student(x, tau, old, gaze))
        shown = anew.unstandardise(anew(x, tau, torch.cat([old, heard], -1), gaze))
    fitted = torch.cat([heard, heard.sigmoid()], -1) @ torch.tensor(matrix) + torch.tensor(offset)
    wanted = FACE.mouth(1.5 * (0.4 * blocks + 0.6 * fitted)) + blocks - FACE.mouth(blocks)
    torch.testing.assert_close(shown, wanted, atol=1e-3, rtol=1e-3)


def test_the_fit_finds_a_map_and_hears_nobody_who_is_left_out() -> None:
    rng = np.random.default_rng(0)
    sound = rng.standard_normal((4000, 5)).astype(np.float16)
    rig = (sound @ rng.uniform(0, 0.1, (5, 53)) + 0.5).astype(np.float16)
    voice = np.repeat(["anna", "ben", ""], [1900, 1900, 200])
    rig[voice == "ben"] = 0.3
    heard = listen.ListenFrames(sound, rig, voice)
    config = listen.preset("debug", **PATHS, without=("ben",), rules=0.0)
    matrix, offset = listen.fit(heard, FACE, config)
    x = np.concatenate([sound, 1 / (1 + np.exp(-sound.astype(np.float32)))], 1)
    truth = FACE.mouth(torch.from_numpy(FACE.rig_to_code(rig.astype(np.float32)))).numpy()
    off = (x @ matrix + offset - truth)[voice == "anna"]
    assert np.abs(off).max() < 0.05 * np.abs(truth).max()
    with pytest.raises(InputError, match="--leave-out: expected one of anna, ben, got 'carl'"):
        listen.fit(heard, FACE, replace(config, without=("carl",)))


def test_a_talker_counts_as_the_root_of_how_much_there_is() -> None:
    names = ("anna", "ben", "carl", listen.RULES, listen.REST)
    voice = np.repeat(names, [400, 100, 50, 30, 20])
    config = listen.preset("debug", **PATHS, without=("carl",), rules=0.1, rest=0.2)
    weight = listen.frame_weights(voice, config)
    shares = [weight[voice == name].sum() for name in names]
    np.testing.assert_allclose(shares, np.array([2, 1, 0, 0.3, 0.6]) / 3.9, rtol=1e-6)


def save(path: Path, module: torch.nn.Module, kind: str, **facts: Any) -> str:
    config = asdict(module.config)  # type: ignore[arg-type]
    tensors = facts.pop("tensors", module.state_dict())
    checkpoint.save(path, tensors, {"kind": kind, "config": config, "steps": 1, "seed": 0, **facts})
    return str(checkpoint.load(path, kind)[1]["sha256"])


@pytest.fixture
def config(tmp_path: Path) -> listen.ListenConfig:
    """An old chain, a phonetic encoder and a pack."""
    torch.manual_seed(0)
    old, out = tmp_path / "old", tmp_path / "out"
    save(old / "audio", AudioEncoder(AUDIO["debug"]), "audio")
    sizes = replace(PRESETS["debug"], audio_dim=AUDIO["debug"].frame_width)
    sha256 = save(old / "student", Denoiser(sizes), "student")
    seer = Denoiser(replace(sizes, condition="eyes", condition_dim=160))
    own = {k: v for k, v in seer.state_dict().items() if k.startswith(("input", "null_cond"))}
    save(old / "student_eyes", seer, "student", tensors=own, audio_model={"sha256": sha256})
    zero = ZeroConvs(ZeroConvConfig(labels=LABELS, places=sizes.places))
    save(old / "emotion", zero, "emotion", student_sha256=sha256)
    pack = pack_of_tones(tmp_path / "pack")
    phones = replace(AUDIO["phonetic-debug"], past_ticks=2)
    save(tmp_path / "phones" / "audio", AudioEncoder(phones), "audio")
    paths = {"pack": pack, "phones": tmp_path / "phones" / "audio", "old": old, "output": out}
    return listen.preset("debug", **paths, pair=out / "audio", share=0.5, gain=2.0)


def test_the_whole_chain_hears_phones_and_keeps_its_blocks(config: listen.ListenConfig) -> None:
    listen.run(config, FACE)
    networks, _ = load_networks(config.output)
    assert networks.audio_config.second is not None
    assert networks.config.audio_dim == networks.audio_config.frame_width
    assert networks.config.contact == 0 and networks.denoiser["direct.move.weight"].any()
    _, before, _ = load_student(config.old, "gaze")
    eyes, seeing, _ = load_student(config.output, "eyes")
    assert eyes.condition == "eyes" and eyes.direct_dim == networks.config.direct_dim
    for name, tensor in before.items():
        if name != "null_audio":  # share * gain is 1
            np.testing.assert_allclose(networks.denoiser[name], tensor, atol=0.02)
        if not name.startswith(("input", "null_cond")):
            np.testing.assert_array_equal(networks.denoiser[name], seeing[name])
    now = checkpoint.load(config.output / "student", "student")[1]["sha256"]
    assert checkpoint.load(config.output / "emotion", "emotion")[1]["student_sha256"] == now
    with pytest.raises(InputError, match="expected a chain that hears no phones yet"):
        listen.run(replace(config, old=config.output), FACE)


def test_who_is_left_out_gets_a_student_and_nothing_else(config, tmp_path) -> None:
    listen.run(config, FACE)
    listen.run(replace(config, without=("tone",), output=tmp_path / "left"), FACE)
    assert [path.name for path in (tmp_path / "left").glob("*.json")] == ["student.json"]
