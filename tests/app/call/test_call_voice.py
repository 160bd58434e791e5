"""Opus itself: where its sound lies in time, and what its error correction is worth."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from app.call.core.call import Call
from app.call.core.outgoing import Outgoing
from app.call.media import speed
from app.call.media.opus import LOOK_AHEAD, PACKET, OpusDecoder, OpusEncoder
from app.call.media.timeline import Timeline
from app.call.media.voice import PULL, VoiceTrack
from app.call.trial.material import synthetic_material
from app.call.trial.track import WINDOW, matches
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.packet import Packer, Tick

MATERIAL = synthetic_material(4, 1)
RECORDING = Path(__file__).parents[3] / "recordings" / "demo" / "audio.wav"
SPEECH = soundfile.read(RECORDING, dtype="float32")[0][: 8 * 48_000]
MS = 1_000_000


def packets() -> list[bytes]:
    encoder, sound = OpusEncoder(), SPEECH
    return [encoder.encode(sound[k : k + PACKET]) for k in range(0, len(sound), PACKET)]


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    return float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-12))


def test_32_kilobits_a_second() -> None:
    sizes = [len(p) for p in packets()]
    assert 8 * sum(sizes) / 8 < 36_000


def test_a_lost_packet_is_in_the_next_one() -> None:
    """Recovered sound is much more like the lost one than what is made up."""
    sent, whole = packets(), OpusDecoder()
    true = [whole.decode(p) for p in sent]
    gains = []
    for lost in range(40, 480, 7):
        got = {}
        for how in ("recover", "conceal"):
            decoder = OpusDecoder()
            for p in sent[lost - 30 : lost]:
                decoder.decode(p)
            got[how] = decoder.recover(sent[lost + 1]) if how == "recover" else decoder.conceal()
        if np.abs(true[lost]).max() > 0.05:
            gains.append([likeness(got[how], true[lost]) for how in ("recover", "conceal")])
    recovered, concealed = np.mean(gains, 0)
    assert len(gains) > 20 and 1 - recovered < 0.5 * (1 - concealed)


def test_garbage_is_concealed() -> None:
    decoder, rng = OpusDecoder(), np.random.default_rng(0)
    for size in range(1, 400, 7):
        assert decoder.decode(rng.bytes(size)).shape == (PACKET,)
        assert np.isfinite(decoder.recover(rng.bytes(size))).all()


def test_sound_is_heard_when_the_timeline_says() -> None:
    """From the samples of the microphone to those of the loudspeaker, by the sound alone."""
    timeline = Timeline()
    voice = VoiceTrack(timeline, OpusDecoder())
    sent, heard, media = packets(), [], []
    for n in range(7 * 100):
        now_ns = 10**9 + n * 10 * MS
        voice.push(n, sent[n], now_ns)
        heard.append(voice.pull(PULL, now_ns))
        media.append(timeline.media_at(now_ns))
    for at in (550, 600, 650):
        sound = np.concatenate(heard[at : at + 40])
        begin = int(media[at]) - LOOK_AHEAD - 2000
        said = SPEECH[begin : begin + 4000 + len(sound)].astype(float)
        middles, _ = matches(sound[:WINDOW].astype(float), said)
        assert abs(middles[0] - WINDOW / 2 - 2000) < 48  # 1 ms


@pytest.mark.parametrize("rate", [0.98, 1.0, 1.0003, 1.02])
def test_sound_at_another_speed_is_60_db_clean(rate: float) -> None:
    """All that a voice has, up to 8 kHz; in blocks as in one go."""
    t = np.arange(4000, dtype=np.float64)
    tones = np.array([200.0, 1100, 3700, 8000])[:, None] * 2 * np.pi / 48_000
    sound = (np.sin(tones * t).sum(0) / 4).astype(np.float32)
    got = np.concatenate([speed.between(sound, 20.3 + rate * k, rate, 480) for k in (0, 480, 960)])
    at = 20.3 + rate * np.arange(1440)
    assert np.std(got - np.sin(tones * at).sum(0) / 4) < 1e-3 * np.std(sound)


def sender() -> tuple[Outgoing, list[tuple]]:
    sent: list[tuple] = []
    return Outgoing(Packer(MATERIAL.basis), lambda *packet: sent.append(packet)), sent


def test_voice_and_ticks_count_the_same_samples() -> None:
    outgoing, sent = sender()
    for block in range(60):
        t_ns = 5 * 10**9 + block * 10 * MS
        outgoing.speak(7000 + block * 480, MATERIAL.sound[:480], t_ns, muted=False)
    end_ns = 5 * 10**9 + 1600 * 10**9 // 48_000  # the tick of the first 1600 samples
    outgoing.tick(Tick(0, MATERIAL.expression[0], MATERIAL.gaze[0]), end_ns)
    ticks, offset = Packer(MATERIAL.basis).open(sent[-1][1])
    assert ticks[0].index == 0 and abs(offset) <= 1
    assert [media for stream, _, media, _ in sent if stream == "voice"] == list(
        range(0, 28_800, 480)
    )


def test_counters_only_grow_whatever_the_microphone_does() -> None:
    """Lost sound, a device that begins anew, blocks of odd sizes: never one nonce twice."""
    outgoing, sent = sender()
    rng = np.random.default_rng(2)
    first, t_ns = 100_000, 10**9
    for n in range(400):
        size = int(rng.integers(1, 2000))
        outgoing.speak(first, np.zeros(size, np.float32), t_ns, muted=bool(n % 50 > 40))
        first, t_ns = first + size, t_ns + size * 10**9 // 48_000
        if n % 40 == 39:
            first = int(rng.integers(0, 10**7))
            t_ns += int(rng.integers(0, 3 * 10**9))
    counters = [counter for stream, _, _, counter in sent if stream == "voice"]
    assert all(b > a for a, b in zip(counters, counters[1:], strict=False))


def test_nan_of_our_own_face_is_told_and_not_sent() -> None:
    told: list[str] = []
    hello = Hello(identity=new_identity(), name="Ann", basis=MATERIAL.basis.number)
    call = Call(bytes(16), hello, MATERIAL.basis, told.append, lambda *_: None, lambda: 0)
    for index in range(3):
        call.tick(Tick(index, np.full(256, np.nan, np.float32), MATERIAL.gaze[0]), index)
    assert len(told) <= 3 and "finite" in told[0]


def test_the_origin_follows_the_sound_cards_clock() -> None:
    """Red before: a first packet that came late made every delay too short for good."""
    outgoing = Outgoing(Packer(MATERIAL.basis), lambda *sent: None)
    outgoing.speak(0, MATERIAL.sound[:480], 300 * MS, False)
    outgoing.speak(480, MATERIAL.sound[:480], 310 * MS, False)
    assert outgoing.origin_ns == 300 * MS
    outgoing.speak(960, MATERIAL.sound[:480], 20 * MS + 7, False)  # it had been 300 ms late
    assert outgoing.origin_ns == 7
