"""Microphone through PortAudio and a PulseAudio server of our own: exact, dated, and back again."""

import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from source_contract import check_source
from waiting import wait_until

from sensors.audio import portaudio
from sensors.audio.microphone import Microphone, followed
from sensors.clock import MonotonicClock
from sensors.live.source import LiveSource
from sensors.standins.pulse import PulseServer
from sensors.types import NS, SAMPLE_RATE, AudioPacket, InputError

NAME = "pulse:mic"
# A machine that stalls looks like lost sound for a moment; the losses tested here are longer.
SLACK_NS = 250_000_000


@pytest.fixture(scope="module")
def server() -> Iterator[PulseServer]:
    assert shutil.which("pulseaudio"), "run: make setup"
    folder = Path(tempfile.mkdtemp(prefix="pulse"))  # pytest's own paths are too long for a socket
    server = PulseServer(folder)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in server.environment.items():
            patch.setenv(name, value)
        patch.delenv("PULSE_SOURCE", raising=False)
        server.start()
        yield server
        server.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def running(server: PulseServer) -> Iterator[Microphone]:
    """A microphone that has already given sound."""
    microphone = Microphone(NAME, MonotonicClock())
    microphone.open()
    wait_until(lambda: bool(microphone.poll()), "the first sound")
    yield microphone
    microphone.close()


def listen(microphone: Microphone, seconds: float) -> list[AudioPacket]:
    packets: list[AudioPacket] = []
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        packets += [p for p in microphone.poll() if isinstance(p, AudioPacket)]
        time.sleep(0.005)
    return packets


def test_a_library_that_could_not_start_once_is_started_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Red before: it was not, and no microphone came back."""
    sounddevice, tries = portaudio.library(), 0
    start = sounddevice._initialize  # noqa: SLF001

    def initialize() -> None:
        nonlocal tries
        tries += 1
        if tries == 1:
            raise sounddevice.PortAudioError("not now")
        start()

    monkeypatch.setattr(sounddevice, "_initialize", initialize)
    for reason in ("not now", "no such"):
        with pytest.raises(portaudio.DeviceError, match=reason):
            portaudio.InputStream("no such microphone", MonotonicClock(), None, 1)


@pytest.mark.slow
def test_what_is_played_arrives_bit_for_bit(server: PulseServer, running: Microphone) -> None:
    """On a machine that stalls the player itself may run dry, so it may play up to six times."""
    rng = np.random.default_rng(1)
    played = rng.integers(-30_000, 30_000, SAMPLE_RATE // 2).astype(np.int16)
    played[0] = 1
    expected = played.astype(np.float32) / 32768
    for _ in range(6):
        player = server.play(played)
        packets: list[AudioPacket] = []
        while player.poll() is None:
            packets += listen(running, 0.1)
        packets += listen(running, 0.6)
        heard = np.concatenate([p.samples for p in packets])
        start = int(np.flatnonzero(heard)[0])
        if np.array_equal(heard[start : start + len(expected)], expected):
            assert running.level > 0.01
            return
    np.testing.assert_array_equal(heard[start : start + len(expected)], expected)


@pytest.mark.slow
def test_times_and_counters_agree(running: Microphone) -> None:
    packets = listen(running, 1.5)
    first, last = packets[0], packets[-1]
    counted = (last.first_sample - first.first_sample) * NS / SAMPLE_RATE
    assert last.t_ns - first.t_ns == pytest.approx(counted, abs=SLACK_NS)
    for a, b in zip(packets, packets[1:], strict=False):
        assert b.first_sample >= a.first_sample + len(a.samples)
    now_ns = MonotonicClock().now_ns()
    assert last.t_ns < now_ns


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "channels"), [(16_000, 1), (44_100, 2)])
def test_other_rates_and_stereo_become_48_khz_mono(
    server: PulseServer, rate: int, channels: int
) -> None:
    microphone = Microphone(NAME, MonotonicClock(), rate=rate, channels=channels)
    microphone.open()
    wait_until(lambda: bool(microphone.poll()), "the first sound")
    t = np.arange(2 * SAMPLE_RATE) / SAMPLE_RATE
    tone = (10_000 * np.sin(2 * np.pi * 440 * t)).astype(np.int16)
    server.play(tone)
    packets = listen(microphone, 2.0)
    microphone.close()
    heard = np.concatenate([p.samples for p in packets])
    span_ns = packets[-1].t_ns - packets[0].t_ns
    counted = packets[-1].first_sample - packets[0].first_sample
    assert span_ns == pytest.approx(counted * NS / SAMPLE_RATE, abs=SLACK_NS)
    loud = heard[np.flatnonzero(np.abs(heard) > 0.2)[0] :][: SAMPLE_RATE // 2]
    assert len(loud) == SAMPLE_RATE // 2
    peak = int(np.argmax(np.abs(np.fft.rfft(loud * np.hanning(len(loud))))))
    assert peak * 2 == pytest.approx(440, abs=4)
    # not the largest: on a machine that stalls the player may run dry, and its tone jumps there
    assert np.quantile(np.abs(loud), 0.99) == pytest.approx(10_000 / 32768, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["unplug", "kill", "stall"])
def test_a_microphone_that_goes_comes_back_with_its_count(
    server: PulseServer, running: Microphone, fault: str
) -> None:
    before = listen(running, 0.5)[-1]
    if fault == "stall":
        server.stall()
        time.sleep(0.7)
        server.go_on()
    elif fault == "unplug":
        server.unplug()
        wait_until(lambda: running.reopened > 0 and not running.poll(), "the loss")
        server.plug()
    else:
        server.kill()
        wait_until(lambda: running.reopened > 0 and not running.poll(), "the loss")
        server.start()
    packets: list[AudioPacket] = []
    wait_until(
        lambda: bool(packets.extend(listen(running, 0.2)) or len(packets) > 60), "it is back"
    )
    after = packets[-1]
    counted_ns = (after.first_sample - before.first_sample) * NS / SAMPLE_RATE
    assert after.t_ns - before.t_ns == pytest.approx(counted_ns, abs=SLACK_NS)
    assert running.problem == ""


@pytest.mark.slow
def test_a_loss_without_a_flag_is_seen_by_the_clock(
    server: PulseServer, running: Microphone, monkeypatch: pytest.MonkeyPatch
) -> None:
    listen(running, 0.5)
    stream = running._stream
    assert stream is not None
    write = stream.ring.write
    skipped = [0]

    def lossy(samples: np.ndarray, arrival_ns: int, overflow: bool) -> None:
        if skipped[0] < 40:
            skipped[0] += 1  # 400 ms never reach the counter
        else:
            write(samples, arrival_ns, overflow)

    monkeypatch.setattr(stream.ring, "write", lossy)
    wait_until(lambda: bool(running.poll()) and running.losses > 0, "the loss")
    assert running.dropped == pytest.approx(40 * 480, abs=1500)


def test_names(server: PulseServer) -> None:
    names = [m.name for m in portaudio.microphones()]
    assert NAME in names
    assert portaudio.find_name(NAME) == NAME
    assert portaudio.find_name("e:MIC") == NAME  # red before: the part itself was opened, in vain
    with pytest.raises(InputError, match="livedrive devices"):
        portaudio.find_name("no such microphone")


@pytest.mark.slow
def test_the_live_source_keeps_the_contract_of_sources(server: PulseServer) -> None:
    clock = MonotonicClock()
    source = LiveSource(Microphone(NAME, clock), [], clock, seconds=0.5)
    packets = check_source(source, lambda: time.sleep(0.003), live=True)
    assert sum(len(p.samples) for p in packets if isinstance(p, AudioPacket)) >= SAMPLE_RATE // 3


@pytest.mark.slow
def test_closing_never_hangs_even_when_the_server_does(server: PulseServer) -> None:
    microphone = Microphone(NAME, MonotonicClock())
    microphone.open()
    wait_until(lambda: bool(microphone.poll()), "the first sound")
    server.stall()
    try:
        started = time.monotonic()
        microphone.close()
        assert time.monotonic() - started < 20
    finally:
        server.go_on()


def test_no_microphone_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: "expected one of none here, got no 'nosuch'"."""
    monkeypatch.setattr(portaudio, "microphones", list)
    with pytest.raises(InputError, match="--mic nosuch: expected a microphone, got none here"):
        portaudio.find_name("nosuch")


def test_a_sample_that_is_no_number_leaves_the_level() -> None:
    """Red before: from one of them on a recording had none, and on a terminal ended."""
    sound = np.full(480, 0.1, np.float32)
    sound[7:10] = np.nan, np.inf, -np.inf
    level = 0.0
    for _ in range(1000):
        level = followed(level, sound)
    assert 0.09 < level < 0.1
