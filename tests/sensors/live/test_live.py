"""LiveSource and the assembler under live conditions: any camera rate, age limits, lost sensors."""

import numpy as np
import pytest
from material import image

from sensors.assemble import EYE_TOLERANCE_NS, Assembler
from sensors.cameras.views import Views
from sensors.clock import ManualClock
from sensors.live.source import LiveSource
from sensors.types import (
    FPS,
    NS,
    SAMPLE_RATE,
    AudioPacket,
    EyePacket,
    Packet,
    SensorFrame,
    SourceInfo,
)

BLOCK = 480
PICTURE = image(0)


class Voice:
    """A microphone on a manual clock, 10 ms late, with a time in which it gives nothing."""

    info = SourceInfo("voice", devices={"audio": "voice"})
    exhausted, dropped = False, 0

    def __init__(self, clock: ManualClock, dead: tuple[float, float] = (0, 0)) -> None:
        self.clock, self.dead, self.sent = clock, dead, 0

    def open(self) -> None:
        self.start_ns = self.clock.now_ns()

    def poll(self) -> list[Packet]:
        packets: list[Packet] = []
        due = (self.clock.now_ns() - self.start_ns - NS // 100) * SAMPLE_RATE // NS // BLOCK
        for k in range(self.sent, due):
            t_ns = self.start_ns + k * BLOCK * NS // SAMPLE_RATE
            if not self.dead[0] <= (t_ns - self.start_ns) / NS < self.dead[1]:
                packets.append(AudioPacket(t_ns, k * BLOCK, np.full(BLOCK, 0.5, np.float32)))
        self.sent = max(self.sent, due)
        return packets

    def close(self) -> None:
        pass


class Eye:
    """A camera on a manual clock."""

    def __init__(
        self, clock: ManualClock, eye: int, rate: float, jitter: float = 0.0, until: float = 1e9
    ) -> None:
        self.clock, self.rate, self.jitter, self.until = clock, rate, jitter, until
        self.views, self.devices, self.dropped = Views(eyes=(eye,)), {"eye": "drawn"}, 0
        self.rng, self.sent = np.random.default_rng(eye), 0

    def open(self) -> None:
        self.start_ns = self.clock.now_ns()

    def poll(self) -> list[EyePacket]:
        packets: list[EyePacket] = []
        while True:
            t_ns = self.start_ns + int(self.sent * NS / self.rate)
            arrival_ns = t_ns + 8_000_000 + int(self.rng.uniform(0, self.jitter) * NS)
            if arrival_ns > self.clock.now_ns() or self.sent / self.rate > self.until:
                return packets[-4:]
            packets.append(EyePacket(t_ns, self.views.eyes[0], self.sent, PICTURE))
            self.sent += 1

    def close(self) -> None:
        pass


def frames(source: LiveSource, clock: ManualClock, step_ns: int = 3_000_000) -> list[SensorFrame]:
    assembler, out = Assembler(), []
    source.open()
    while not source.exhausted:
        clock.advance_ns(step_ns)
        for packet in source.poll():
            assembler.push(packet)
        out += assembler.ready()
    source.close()
    return out


@pytest.mark.parametrize(
    ("rate", "jitter"), [(15, 0), (30, 0.01), (60, 0.005), (120, 0), (37, 0.02)]
)
def test_any_camera_rate_gives_fresh_eyes_at_30_fps(rate: float, jitter: float) -> None:
    clock = ManualClock(NS)
    eyes = [Eye(clock, 0, rate, jitter), Eye(clock, 1, rate, jitter)]
    source = LiveSource(Voice(clock), eyes, clock, seconds=3)  # type: ignore[arg-type]
    got = frames(source, clock)[5:]
    assert len(got) >= 84
    assert all(f.eyes_valid.all() and not f.audio_gap for f in got)
    worst = NS / rate + 8e6 + jitter * NS + 10e6
    assert max(int(f.eyes_age_ns.max()) for f in got) <= worst
    assert min(int(f.eyes_age_ns.min()) for f in got) >= 0
    assert [f.index for f in got] == list(range(5, 5 + len(got)))


def test_an_eye_that_stops_is_held_and_then_invalid_and_the_other_stays() -> None:
    clock = ManualClock()
    eyes = [Eye(clock, 0, 30, until=1.0), Eye(clock, 1, 30)]
    source = LiveSource(Voice(clock), eyes, clock, seconds=3)  # type: ignore[arg-type]
    got = frames(source, clock)
    late = [f for f in got if f.t_ns > 1.2 * NS]
    assert len(late) > 40
    assert all(not f.eyes_valid[0] and f.eyes_valid[1] for f in late)
    assert all(f.eyes_valid[0] == (f.eyes_age_ns[0] <= EYE_TOLERANCE_NS) for f in got[3:])


@pytest.mark.parametrize("mic", [True, False])
@pytest.mark.parametrize("cameras", [True, False])
def test_any_sensor_may_be_missing(mic: bool, cameras: bool) -> None:
    clock = ManualClock()
    eyes = [Eye(clock, 0, 30), Eye(clock, 1, 30)] if cameras else []
    source = LiveSource(Voice(clock) if mic else None, eyes, clock, seconds=2)  # type: ignore[arg-type]
    got = frames(source, clock)
    assert len(got) == pytest.approx(2 * FPS, abs=1)
    assert all(f.audio_gap != mic for f in got[3:])
    assert all((f.eyes is not None) == cameras for f in got[3:])


def test_a_microphone_that_is_away_for_a_second_costs_a_second_and_no_frame() -> None:
    clock = ManualClock()
    voice = Voice(clock, dead=(1.0, 2.0))
    source = LiveSource(voice, [], clock, seconds=4)  # type: ignore[arg-type]
    got = frames(source, clock)
    steps = np.diff([f.t_ns for f in got])
    assert np.abs(steps - NS / FPS).max() < 3_000_000
    gaps = [f.index for f in got[2:] if f.audio_gap]
    assert 28 <= len(gaps) <= 36
    assert all(f.audio.any() for f in got if f.index > 64)


def test_a_stopped_process_catches_up_without_losing_count() -> None:
    clock = ManualClock()
    source = LiveSource(Voice(clock), [], clock)  # type: ignore[arg-type]
    assembler = Assembler()
    source.open()
    out: list[SensorFrame] = []
    for step in [10_000_000] * 50 + [3 * NS] + [10_000_000] * 50:
        clock.advance_ns(step)
        for packet in source.poll():
            assembler.push(packet)
        out += assembler.ready()
    source.close()
    assert [f.index for f in out] == list(range(len(out)))
    assert out[-1].t_ns == pytest.approx(len(out) * NS / FPS, abs=NS // 100)


def test_poll_before_open_and_after_close_is_an_error() -> None:
    clock = ManualClock()
    source = LiveSource(None, [], clock)
    with pytest.raises(RuntimeError):
        source.poll()
    source.open()
    source.stop()
    assert source.exhausted
    assert source.poll() == []
    source.close()
    source.close()
    with pytest.raises(RuntimeError):
        source.poll()
