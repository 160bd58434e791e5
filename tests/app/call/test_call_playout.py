"""Voice and face off one clock: simulated lines, exact, in no time."""

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from app.call.media.face import FaceCounts, FaceTrack, due_by, end_of, note
from app.call.media.opus import LOOK_AHEAD, PACKET
from app.call.media.timeline import Timeline
from app.call.media.voice import PULL, VoiceTrack
from app.call.wire.packet import Tick
from sensors.types import NS, SAMPLE_RATE

RATE = 48_000 // PACKET  # packets a second
MS, S = 1_000_000, 1_000_000_000
AHEAD = np.array([[0, 0, 1], [0, 0, 1]], np.float32)
TURN = 24_000  # samples are their own position within half a second: sound tells when it was said


class Ramp:
    """Stands in for Opus: decodes to the position at which each sample was said."""

    def __init__(self) -> None:
        self._last = 0

    def decode(self, payload: bytes) -> np.ndarray:
        self._last = int.from_bytes(payload[:8], "little")
        return self._sound()

    def recover(self, following: bytes) -> np.ndarray:
        self._last = int.from_bytes(following[:8], "little") - 1
        return self._sound()

    def conceal(self) -> np.ndarray:
        self._last += 1
        return self._sound()

    def close(self) -> None: ...

    def _sound(self) -> np.ndarray:
        position = self._last * PACKET + np.arange(PACKET) - LOOK_AHEAD
        return (position % TURN / TURN).astype(np.float32)


def tick(index: int) -> Tick:
    code = np.zeros(256, np.float32)
    code[0] = index
    return Tick(index, code, AHEAD)


@dataclass
class Heard:
    delay_ms: list[float] = field(default_factory=list)  # from said to heard
    lips_ms: list[float] = field(default_factory=list)  # of the face against the sound
    off: list[float] = field(
        default_factory=list
    )  # samples between the sound and what it should be
    presence: list[float] = field(default_factory=list)
    voice: VoiceTrack | None = None
    face: FaceCounts | None = None


def call(
    seconds: float,
    delay_ms: Callable[[float], float | None] = lambda t: 1.0,  # None: lost
    drift: float = 0.0,  # the sender's clocks run so much faster
    card: float = 0.0,  # and our sound card
    muted: range = range(0),  # packets
    tick_ms: float = 5.0,  # from the end of a tick's sound to its code
) -> Heard:
    """Play a line; what is heard and shown, every 10 ms."""
    events: list[tuple[int, int, Callable[[int], None]]] = []
    timeline, face, counts, out = Timeline(), FaceTrack(), FaceCounts(), Heard()
    come = set[int]()
    voice = VoiceTrack(timeline, Ramp())
    start = 1000 * S  # clocks of two machines have nothing in common

    def send(at_s: float, act: Callable[[int], None]) -> None:
        late = delay_ms(at_s)
        if late is not None:
            heapq.heappush(events, (start + int((at_s + late / 1e3) * S), len(events), act))

    for k in range(int(seconds * RATE)):
        if k not in muted or k - muted.start < 3:  # the first three say so and are empty
            payload = b"" if k in muted else k.to_bytes(8, "little")
            send((k + 1) / RATE / (1 + drift), lambda now, k=k, p=payload: voice.push(k, p, now))

    def take(newest: int, now: int) -> None:
        known = [
            i
            for i in (newest, newest - 1, newest - 2)
            if i >= 0 and face.push(tick(i), end_of(i, 0), now)
        ]
        come.update(known)
        note(timeline, known, 0, now)

    for i in range(int(seconds * 30)):
        send((i + 1) / 30 / (1 + drift) + tick_ms / 1e3, lambda now, i=i: take(i, now))
    for n in range(int(seconds * 100)):
        now = start + int(n * 10 * MS / (1 + card))
        while events and events[0][0] <= now:
            at_ns, _, act = heapq.heappop(events)
            act(at_ns)
        sound = voice.pull(PULL, now)
        media = timeline.media_at(now)
        shown = face.pose(media, now) if timeline.started else None
        if timeline.started:
            counts.count(due_by(media, 0), come)
        if shown and n > 200:
            out.presence.append(shown.presence)
            said, seen = media - LOOK_AHEAD, (shown.tick.expression[0] + 1) * 1600
            out.delay_ms.append((now - start) / MS - said / 48 / (1 + drift))
            out.lips_ms.append((said - seen) / 48)
            out.off.append((float(sound[0]) * TURN - said) % TURN)
    out.voice, out.face = voice, counts
    return out


def test_a_clean_line_loses_nothing_and_waits_little() -> None:
    heard = call(10)
    assert heard.voice and heard.face
    assert heard.voice.counts.concealed == heard.voice.counts.recovered == heard.face.held == 0
    assert heard.face.due > 250
    assert np.median(heard.delay_ms) < 40
    assert np.ptp(heard.delay_ms) < 4
    assert np.median(np.minimum(heard.off, TURN - np.array(heard.off))) < 6  # samples
    assert np.abs(heard.lips_ms).max() < 5
    assert abs(np.median(heard.lips_ms)) < 1.5


def lossy(
    base: float, jitter: float, loss: float, seed: int = 1
) -> Callable[[float], float | None]:
    rng = np.random.default_rng(seed)
    return lambda t: None if rng.random() < loss else base + rng.uniform(-jitter, jitter)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "most_ms", "concealed", "held"),
    [((20, 5, 0.01), 75, 0.005, 0.005), ((40, 20, 0.05), 130, 0.01, 0.01)],
)
def test_lossy_lines(line: tuple, most_ms: float, concealed: float, held: float) -> None:
    heard = call(40, lossy(*line))
    assert heard.voice and heard.face
    counts = heard.voice.counts
    assert counts.recovered > 0
    assert counts.concealed <= concealed * counts.played
    assert heard.face.held <= held * heard.face.due
    assert np.median(heard.delay_ms) <= most_ms
    assert np.percentile(np.abs(heard.lips_ms), 99) <= 20
    assert abs(np.median(heard.lips_ms)) < 2


@pytest.mark.slow
@pytest.mark.parametrize("drift", [150e-6, -150e-6])
@pytest.mark.parametrize("card", [0.0, 200e-6])
def test_drift_of_both_sound_cards_is_played_away(drift: float, card: float) -> None:
    heard = call(30, drift=drift, card=card)
    assert heard.voice and heard.voice.counts.concealed == heard.voice.counts.jumps == 0
    assert np.ptp(heard.delay_ms) < 3.5  # over 30 s the clocks part by 4 to 10 ms
    assert np.abs(heard.lips_ms).max() < 5


@pytest.mark.slow
def test_the_delay_grows_with_the_line_and_comes_back() -> None:
    heard = call(60, lambda t: 60.0 if 20 < t < 30 else 2.0)
    delay = np.array(heard.delay_ms)
    thirds = [np.median(delay[a : a + 100]) for a in (500, 2500, len(delay) - 200)]
    assert thirds[0] < 45 and 90 < thirds[1] < 110 and thirds[2] < 45
    assert np.percentile(np.abs(heard.lips_ms), 99) <= 20
    assert heard.voice and heard.voice.counts.jumps == 0


@pytest.mark.slow
def test_an_outage_fades_out_and_comes_back_by_itself() -> None:
    heard = call(30, lambda t: None if 10 < t < 16 else 2.0)
    presence = np.array(heard.presence)
    assert presence.min() == 0 and presence[0] == presence[-1] == 1
    assert np.abs(heard.lips_ms[-100:]).max() < 5
    assert heard.voice and heard.voice.counts.concealed <= 60  # then the partner is away, not late


def test_a_partner_that_stood_still_is_played_later_from_then_on() -> None:
    """A stalled machine: what comes after it is half a second later, for good."""
    heard = call(20, lambda t: 2.0 if t < 10 else 502.0)
    assert np.percentile(heard.delay_ms[-500:], 99) < 560
    assert heard.voice and heard.voice.counts.concealed < 1.5 * RATE
    assert heard.face and heard.face.held < 60


def test_mute_is_not_loss() -> None:
    heard = call(20, muted=range(5 * RATE, 13 * RATE))
    assert heard.voice and heard.voice.counts.concealed == 0
    assert heard.face and heard.face.held == 0


def test_a_late_tick_holds_and_then_eases_to_rest() -> None:
    face = FaceTrack()
    code = np.full(256, 3, np.float32)
    for i in range(3):
        face.push(Tick(i, code, AHEAD), end_of(i, 0), 0)
    poses = {}
    for now_ms in range(0, 1500, 10):
        shown = face.pose(end_of(2, 0) + now_ms * 48, now_ms * MS)
        assert shown
        poses[now_ms] = shown.tick.expression[0]
    assert poses[0] == poses[200] == 3
    assert 0 < poses[450] < 3 and poses[800] == 0
    values = np.array(list(poses.values()))
    assert np.abs(np.diff(values)).max() < 0.2  # no jump
    face.push(Tick(40, code, AHEAD), end_of(40, 0), 1400 * MS)
    back = [face.pose(end_of(40, 0), (1500 + n) * MS) for n in range(0, 120, 10)]
    assert back[0] and back[-1] and back[0].tick.expression[0] < 1.5
    assert back[-1].tick.expression[0] == 3


def test_floods_and_nonsense_stay_bounded() -> None:
    timeline = Timeline()
    voice, face = VoiceTrack(timeline, Ramp()), FaceTrack()
    rng = np.random.default_rng(0)
    for n in range(20_000):
        number = int(rng.integers(0, 2**32))
        voice.push(number, bytes(50), n * 1000)
        voice.push(n, bytes(5000), n * 1000)  # far too long
        face.push(tick(number), end_of(number, 0), n * 1000)
    assert len(voice._packets) < 3000 and len(voice._known) < 3000
    assert len(face._ticks) <= 30
    assert np.isfinite(voice.pull(PULL, 10 * S)).all()


def test_a_muted_voice_holds_no_face_back() -> None:
    """Red before: the face kept the delay of the voice before the mute, for ever."""
    timeline, now_ns = Timeline(), 0

    def delay_ms(voice_ms: float | None, face_ms: float, seconds: int) -> float:
        nonlocal now_ns
        for _ in range(100 * seconds):
            now_ns += NS // 100
            media = now_ns * SAMPLE_RATE / NS
            for stream, late_ms in (("voice", voice_ms), ("face", face_ms)):
                if late_ms is not None:
                    timeline.arrived(stream, media - late_ms * SAMPLE_RATE / 1e3, now_ns)
            target = timeline.target(now_ns)
        assert target is not None
        return 1e3 * (now_ns / NS - target / SAMPLE_RATE)

    assert delay_ms(150, 150, 10) > 150
    assert delay_ms(None, 20, 15) < 30
    assert delay_ms(20, 20, 10) < 30
