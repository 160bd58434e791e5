"""A chain that learns to hear phones: what is trained, who counts in it, what stays."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from training_material import FACE, chain_that_hears_no_phones, spoken

from encoder.audio.config import PRESETS as AUDIO
from encoder.audio.encoder import AudioEncoder
from encoder.capture.speech.phones import PHONE_INDEX
from encoder.denoiser.config import MOUTH, PRESETS
from encoder.denoiser.contact import Contact
from encoder.denoiser.direct import Direct
from encoder.denoiser.model import Denoiser
from encoder.inference import WEIGHTS, load_networks, load_student
from encoder.nn import checkpoint
from encoder.training import loop
from encoder.training.mouth import Mouth
from encoder.training.stages import chain, listen
from encoder.training.stages.listener import Batch, Listener
from encoder.training.streams.pieces import SpokenPieces
from encoder.training.streams.spoken import REST, RULES
from sensors.types import InputError

pytestmark = pytest.mark.slow


def noise(*shape: int) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(0))


def settings(folder: Path, **more: Any) -> listen.ListenConfig:
    names = ("pack", "phones", "old", "pair", "output")
    given = dict.fromkeys(names, folder) | {"run": loop.RunSettings(state=folder / "state")}
    return listen.preset("debug", **{**given, **more})


def untrained() -> tuple[Denoiser, SpokenPieces]:
    torch.manual_seed(0)
    student = Denoiser(PRESETS["debug"])
    student.expression_std.uniform_(0.5, 2)
    student.expression_mean.normal_()
    frames = spoken({"anna": 90, RULES: 60, REST: 50})
    pieces = SpokenPieces(frames, Mouth.of(FACE), batch=4, length=20, rules=0.3, rest=0.3)
    return student.eval().requires_grad_(False), pieces


@torch.no_grad()
def test_a_student_that_listens_shows_shares_of_its_own_mouth_and_of_what_it_hears(
    tmp_path: Path,
) -> None:
    student, pieces = untrained()
    config = settings(tmp_path, shares=(0.4, 0.3, 0.2), gain=1.5, gate=(2.0, -0.5))
    listener = listen.new_listener(pieces, student, config)
    for tensor in (*listener.direct.parameters(), *listener.contact.parameters()):
        torch.nn.init.normal_(tensor, std=0.2)
    heard, x0 = 3 * noise(2, 9, 7), noise(2, 9, 256)
    seen = (torch.cat([heard, heard.sigmoid()], -1) - listener.scale[0]) / listener.scale[1]
    mouth, codes = listener.mouth, student.unstandardise(x0)
    said = listener.lines.beside(listener.direct.said(seen), seen)
    own = codes @ torch.tensor(mouth.read)
    kept = mouth.spans(own @ listener.share)
    torch.testing.assert_close(kept, torch.tensor([0.4, 0.3]) * mouth.spans(own), atol=0.02, rtol=0)
    mixed = (own @ listener.share + said - said @ listener.share) @ listener.mix
    voice = (2 * listener.direct.voiced(seen[..., :7]) - 0.5).sigmoid()
    wanted = codes - FACE.mouth(codes) + mouth.codes(voice * mixed)
    head, told = listener.contact, noise(3, 7)
    moved = head.moved_mm(head.gap_mm(student.standardise(wanted)), seen[..., :7])
    listen.finish(listener, config, told)
    shown, sure = listener.direct(x0, heard)
    torch.testing.assert_close(sure, voice)
    torch.testing.assert_close(student.unstandardise(shown), wanted, atol=1e-3, rtol=1e-3)
    after = head.moved_mm(head.gap_mm(shown), heard)
    torch.testing.assert_close(after, moved, atol=1e-3, rtol=1e-3)
    assert torch.equal(head.closures, told)


@torch.no_grad()
def test_without_a_voice_the_mouth_rests_and_all_else_stays(tmp_path: Path) -> None:
    student, pieces = untrained()
    config = settings(tmp_path)
    listener = listen.new_listener(pieces, student, config)
    listen.finish(listener, config, torch.zeros(3, 7))
    listener.direct.voice.bias.fill_(-50)
    before = student.unstandardise(noise(2, 9, 256))
    shown, voice = listener.direct(student.standardise(before), noise(2, 9, 7))
    torch.nn.init.constant_(listener.contact.move.bias, 1.0)
    after = student.unstandardise(listener.contact(shown, noise(2, 9, 7), voice))
    torch.testing.assert_close(FACE.mouth(after), torch.zeros_like(after), atol=1e-4, rtol=0)
    rest = [codes - FACE.mouth(codes) for codes in (before, after)]
    torch.testing.assert_close(rest[0], rest[1], atol=1e-4, rtol=0)


def test_training_lowers_the_error_of_the_mouth_and_tells_voices(tmp_path: Path) -> None:
    student, pieces = untrained()
    sizes = {"batch": 8, "frames": 20, "hidden": 16, "drop": 0.0}
    steps = {"steps": 150, "rate": 1e-2, "voice_steps": 150, "voice_rate": 1e-2}
    config = settings(tmp_path, **sizes, **steps)
    heard = torch.from_numpy(pieces.frames.heard.astype(np.float32))
    pieces.truth = (heard @ noise(7, MOUTH)).numpy() * (pieces.frames.voice != REST)[:, None]
    pieces.frames.heard[pieces.frames.voice == REST] += 3
    listener = listen.new_listener(pieces, student, config)
    batch = pieces.draw(np.random.default_rng(1))
    before = errors(listener, batch, config)
    listen.train(listener, pieces, pieces, config)
    after = errors(listener, batch, config)
    assert after["shape"] < 0.5 * before["shape"] and after["voice"] < 0.5 * before["voice"]


def errors(
    listener: Listener, batch: Batch, config: listen.ListenConfig
) -> dict[str, torch.Tensor]:
    parts = (listener.mouth_losses, listener.voice_losses, listener.contact_losses)
    return {name: value for losses in parts for name, value in losses(batch, config).items()}


def test_each_part_learns_alone_and_together_they_are_all(tmp_path: Path) -> None:
    student, pieces = untrained()
    config = settings(tmp_path)
    listener = listen.new_listener(pieces, student, config)
    for tensor in (*listener.direct.parameters(), *listener.contact.parameters()):
        torch.nn.init.normal_(tensor, std=0.2)
    everything = [*listener.direct.parameters(), *listener.contact.parameters()]
    learned = []
    for name, modules in listener.parts.items():
        own = {id(p) for module in modules.values() for p in module.parameters()}
        for parameter in everything:
            parameter.grad = None
        losses = getattr(listener, f"{name}_losses")
        losses(pieces.draw(np.random.default_rng(0)), config)["total"].backward()
        assert {id(p) for p in everything if p.grad is not None and p.grad.any()} == own
        learned += list(own)
    assert sorted(learned) == sorted(id(p) for p in everything)


def test_the_contact_head_learns_behind_a_path_that_nothing_disturbs(tmp_path: Path) -> None:
    student, pieces = untrained()
    config = settings(tmp_path)
    listener = listen.new_listener(pieces, student, config)
    torch.nn.init.normal_(listener.direct.move.weight)
    torch.nn.init.normal_(listener.direct.voice.weight)
    batch = pieces.draw(np.random.default_rng(0))
    for losses, steady in (
        (listener.mouth_losses, False),
        (listener.voice_losses, False),
        (listener.contact_losses, True),
    ):
        one, other = (losses(batch, config)["total"] for _ in range(2))
        assert bool(one == other) is steady


def test_a_new_head_takes_its_reach_along() -> None:
    sizes = PRESETS["debug"]
    old = chain.OldChain(
        Path(), sizes, {"null_audio": np.zeros(512)}, {}, AudioEncoder(AUDIO["debug"])
    )
    found, _ = chain.listening(old, Direct(7, 256, 5), Contact(256, 7, 8, 2.5))
    assert (found.contact, found.reach_mm) == (8, 2.5)


@torch.no_grad()
def test_moves_of_the_contact_head_cost_more_where_no_closure_is_asked(tmp_path: Path) -> None:
    student, pieces = untrained()
    config = settings(tmp_path)
    listener = listen.new_listener(pieces, student, config)
    torch.nn.init.constant_(listener.contact.move.bias, 0.1)
    heard, own, truth, phones, voiced, there = pieces.draw(np.random.default_rng(0))
    for phone, least in (("b", "idle"), ("aa", "effort")):
        said = torch.full_like(phones, PHONE_INDEX[phone])
        found = listener.contact_losses((heard, own, truth, said, voiced, there), config)
        assert found[least] == 0 < found["idle"] + found["effort"]


@pytest.fixture
def config(tmp_path: Path) -> listen.ListenConfig:
    """An old chain, a phonetic encoder and a pack."""
    return settings(tmp_path, **chain_that_hears_no_phones(tmp_path))


def test_the_whole_chain_hears_phones_and_keeps_its_blocks(config: listen.ListenConfig) -> None:
    listen.run(config, FACE)
    networks, _ = load_networks(config.output)
    assert networks.audio_config.second is not None
    assert networks.config.audio_dim == networks.audio_config.frame_width
    assert networks.config.contact == config.contact and networks.config.direct == config.hidden
    assert networks.denoiser["direct.move.weight"].any()
    told = networks.denoiser["contact.closures"].reshape(3, -1, 74)  # 4 newest features, past ticks
    assert np.isclose(told.sum((1, 2)), 1).all() and not told[:, 4:].any()
    assert [list(np.flatnonzero(row)) for row in told[:, 0]] == [[28], [8], [23]]  # p, b, m
    _, before, _ = load_student(config.old, "gaze")
    eyes, seeing, _ = load_student(config.output, "eyes")
    assert eyes.condition == "eyes" and eyes.direct_dim == networks.config.direct_dim
    for name, tensor in before.items():
        if name != "null_audio":
            np.testing.assert_allclose(networks.denoiser[name], tensor, atol=0.02)
        if not name.startswith(("input", "null_cond")):
            np.testing.assert_array_equal(networks.denoiser[name], seeing[name])
    now = checkpoint.load(config.output / "student", "student")[1]["sha256"]
    assert checkpoint.load(config.output / "emotion", "emotion")[1]["student_sha256"] == now


def test_a_chain_that_listens_learns_to_anew_from_the_same_blocks(config, tmp_path) -> None:
    listen.run(config, FACE)
    first = load_student(config.output, "gaze")
    heard = (config.pack / "spoken.npz").stat().st_mtime_ns
    again = replace(config, old=config.output, output=tmp_path / "2", pair=tmp_path / "2" / "audio")
    listen.run(again, FACE)
    assert (config.pack / "spoken.npz").stat().st_mtime_ns == heard
    second = load_student(again.output, "gaze")
    assert first[0] == second[0] and first[2]["blocks"] == second[2]["blocks"]
    for name, tensor in first[1].items():
        np.testing.assert_allclose(tensor, second[1][name], rtol=1e-3, atol=1e-4)
    assert load_networks(again.output, "eyes")[0].config.condition == "eyes"


def test_who_is_left_out_gets_a_student_and_nothing_else(config, tmp_path) -> None:
    listen.run(config, FACE)
    listen.run(replace(config, without=("tone",), output=tmp_path / "left"), FACE)
    assert [path.name for path in (tmp_path / "left").glob("*.json")] == ["student.json"]


def test_nobody_is_left_out_before_the_whole_chain_is_there(config) -> None:
    with pytest.raises(InputError, match="audio: expected a .safetensors"):
        listen.run(replace(config, without=("tone",)), FACE)
    assert not list(config.run.state.parent.glob("*state*"))  # nothing was trained for nothing


def test_blocks_say_nothing_where_one_whom_they_know_is_left_out(config, monkeypatch) -> None:
    listen.run(config, FACE)
    for known in ("anna", "tone"):
        monkeypatch.setattr(chain.OldChain, "knows", lambda _, talkers, name=known: name in talkers)
        listen.run(replace(config, without=("tone",)), FACE)
        share = load_student(config.output, "gaze")[1]["direct.share"]
        assert share.any() == (known == "anna")


def test_whom_the_shipped_blocks_know() -> None:
    shipped = chain.OldChain.load(WEIGHTS)
    assert not shipped.knows(("grid-s4", "grid-s30", "grid-s33"))
    assert shipped.knows(("grid-s4", "grid-s2"))


def counted(monkeypatch: pytest.MonkeyPatch, stop: str = "") -> list[str]:
    """Whose losses are asked for, from now on; those of `stop` break the run at the second step."""
    asked: list[str] = []
    for name in ("mouth", "voice", "contact"):
        losses = getattr(Listener, f"{name}_losses")

        def watched(self, batch, config, name=name, losses=losses):
            asked.append(name)
            if name == stop and asked.count(name) == 2:
                raise KeyboardInterrupt
            return losses(self, batch, config)

        monkeypatch.setattr(Listener, f"{name}_losses", watched)
    return asked


def test_a_run_that_is_cut_short_goes_on_where_it_was(config, tmp_path, monkeypatch) -> None:
    listen.run(config, FACE)
    wanted = load_student(config.output, "gaze")
    names = {"state", "state_voice", "state_contact"}
    assert {path.stem for path in tmp_path.glob("state*.safetensors")} == names
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        counted(patch, stop="voice")
        listen.run(config, FACE)
    states = {path.stem for path in tmp_path.glob("state*.safetensors")}
    assert states == {"state", "state_voice"}  # none of the run before
    asked = counted(monkeypatch)
    listen.run(replace(config, run=replace(config.run, resume=True)), FACE)
    assert asked == ["voice", "contact", "contact"]
    for name, tensor in load_student(config.output, "gaze")[1].items():
        np.testing.assert_allclose(tensor, wanted[1][name], rtol=1e-3, atol=1e-4)


def test_a_mouth_that_goes_on_gets_a_voice_and_a_head_of_its_own(config, monkeypatch) -> None:
    """Red before: the finished ones of the shorter run were kept."""
    listen.run(config, FACE)
    asked = counted(monkeypatch)
    further = replace(config, steps=config.steps + 1, run=replace(config.run, resume=True))
    listen.run(further, FACE)
    assert asked == ["mouth"] + ["voice"] * config.voice_steps + ["contact"] * config.contact_steps


def test_a_damaged_mouth_is_told_before_what_follows_it_is_gone(config, tmp_path) -> None:
    """Red before: the states of voice and head were deleted first."""
    listen.run(config, FACE)
    config.run.file.write_bytes(b"no state")
    with pytest.raises(InputError, match="run the stage without --resume"):
        listen.run(replace(config, run=replace(config.run, resume=True)), FACE)
    names = {"state", "state_voice", "state_contact"}
    assert {path.stem for path in tmp_path.glob("state*.safetensors")} == names


def test_the_card_tells_of_all_parts(config) -> None:
    listen.run(config, FACE)
    card = load_student(config.output, "gaze")[2]["listen"]
    mouth = {"shape", "velocity", "span", "tongue", "loose", "tucked", "total"}
    assert set(card["metrics"]) == mouth | {"voice", "miss", "false", "effort", "idle"}
    assert set(card["curve"]) == mouth | {"step"}
    assert card["metrics"]["total"] == pytest.approx(card["curve"]["total"][-1], rel=1e-3)
