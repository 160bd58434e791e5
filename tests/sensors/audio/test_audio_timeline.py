"""AudioTimeline: unbroken sound whatever the microphone does, never played twice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.assemble import Assembler
from sensors.audio.timeline import PATIENCE_NS, AudioTimeline
from sensors.types import NS, SAMPLE_RATE, SAMPLES_PER_FRAME, AudioPacket

BLOCK = 480
BLOCK_NS = NS // 100
START = 5 * NS


def block(k: int, *, counter: int | None = None, t_ns: int | None = None) -> AudioPacket:
    """Block k of the microphone: its samples are k + 1, all alike."""
    first = k * BLOCK if counter is None else counter
    time = START + k * BLOCK_NS if t_ns is None else t_ns
    return AudioPacket(time, first, np.full(BLOCK, k + 1, np.float32))


def check(sent: list[AudioPacket]) -> None:
    for a, b in zip(sent, sent[1:], strict=False):
        assert b.first_sample >= a.first_sample + len(a.samples)
        assert b.t_ns > a.t_ns


def test_without_a_microphone_the_clock_feeds_silence_marked_as_gap() -> None:
    timeline, assembler, sent = AudioTimeline(START, 0), Assembler(), []
    for k in range(1, 101):
        sent += timeline.fill(START + k * BLOCK_NS)
    for packet in sent:
        assembler.push(packet)
    frames = assembler.ready()
    check(sent)
    assert len(frames) == 30
    assert all(f.audio_gap and not f.audio.any() for f in frames)
    times = [f.t_ns for f in frames]
    assert times[-1] - times[0] == pytest.approx(29 * NS / 30, abs=100)


def test_sound_passes_untouched_and_a_patient_silence_waits() -> None:
    timeline, sent = AudioTimeline(START), []
    for k in range(50):
        sent += timeline.push(block(k))
        sent += timeline.fill(START + k * BLOCK_NS + PATIENCE_NS)  # late, but not too late
    assert [p.first_sample for p in sent] == [k * BLOCK for k in range(50)]
    assert [float(p.samples[0]) for p in sent] == [k + 1 for k in range(50)]
    assert not any(p.gap for p in sent)
    assert timeline.silence == 0


def test_a_lost_microphone_becomes_silence_and_comes_back_in_its_place() -> None:
    timeline, sent = AudioTimeline(START), []
    for k in range(20):
        sent += timeline.push(block(k))
    for k in range(20, 60):
        sent += timeline.fill(START + k * BLOCK_NS)
    late = block(57)  # recorded before the silence ended: that part is not played twice
    sent += timeline.push(late)
    for k in range(58, 80):
        sent += timeline.push(block(k))
    check(sent)
    assembler = Assembler()
    for packet in sent:
        assembler.push(packet)
    heard = np.concatenate([f.audio for f in assembler.ready()])
    expected = np.repeat(np.arange(80) + 1, BLOCK).astype(np.float32)
    expected[20 * BLOCK : 59 * BLOCK] = 0  # what came after the clock had gone on is lost
    np.testing.assert_array_equal(heard[: 20 * BLOCK], expected[: 20 * BLOCK])
    np.testing.assert_array_equal(heard[60 * BLOCK :], expected[60 * BLOCK : len(heard)])
    assert not heard[20 * BLOCK : 56 * BLOCK].any()


def test_what_comes_back_too_late_is_cut_to_the_sample() -> None:
    timeline = AudioTimeline(START)
    (silence,) = timeline.fill(START + 10 * BLOCK_NS + PATIENCE_NS)
    end = silence.first_sample + len(silence.samples)
    end_ns = START + end * NS // SAMPLE_RATE
    ramp = np.arange(BLOCK, dtype=np.float32)
    assert timeline.push(AudioPacket(end_ns - BLOCK_NS, 0, ramp)) == []
    (cut,) = timeline.push(AudioPacket(end_ns - 100 * NS // SAMPLE_RATE, BLOCK, ramp))
    assert cut.first_sample == end
    assert cut.samples[0] == pytest.approx(100, abs=1)
    assert abs(cut.t_ns - end_ns) <= NS // SAMPLE_RATE
    (whole,) = timeline.push(AudioPacket(cut.t_ns + 1, 2 * BLOCK, ramp))
    assert whole.first_sample == end + len(cut.samples)


def test_a_microphone_that_starts_late_or_counts_on_is_placed_by_its_time() -> None:
    timeline = AudioTimeline(START)
    first = timeline.push(block(3, counter=77_000))
    assert [p.first_sample for p in first] == [3 * BLOCK]
    assert first[0].gap
    later_ns = START + 4 * BLOCK_NS + NS // 10
    lost = timeline.push(block(4, counter=77_000 + BLOCK + 4800, t_ns=later_ns))  # 100 ms are lost
    assert [p.first_sample for p in lost] == [4 * BLOCK + 4800]


def test_the_count_stays_with_the_clock_when_a_loss_was_none() -> None:
    """A stall that looks like a loss of 60 ms, then the truth: the count may not run ahead."""
    timeline, sent, ahead = AudioTimeline(START), [], 0
    for k in range(100):
        ahead += 2880 if k == 40 else 0
        late_ns = 60_000_000 if 40 <= k < 50 else 0
        packet = block(k, counter=k * BLOCK + ahead, t_ns=START + k * BLOCK_NS + late_ns)
        sent += timeline.push(packet)
    check(sent)
    last = sent[-1]
    assert last.first_sample == pytest.approx(99 * BLOCK, abs=600)
    assert last.t_ns == pytest.approx(START + 99 * BLOCK_NS, abs=12_000_000)


def test_slow_drift_of_the_device_is_followed_and_noise_of_the_times_is_not() -> None:
    timeline, rng, sent = AudioTimeline(START), np.random.default_rng(0), []
    for k in range(6000):
        t_ns = START + int(k * BLOCK_NS * (1 + 100e-6)) + int(rng.uniform(0, 3e6))
        sent += timeline.push(block(k, t_ns=t_ns))
    assert timeline.position - sent[0].first_sample == 6000 * BLOCK
    assert not any(p.gap for p in sent[1:])
    steps = np.diff([p.t_ns for p in sent[1000:]])
    assert np.abs(steps - BLOCK_NS).max() <= BLOCK_NS * 1.1e-3
    assert sent[-1].t_ns == pytest.approx(START + 5999 * BLOCK_NS * (1 + 100e-6), abs=3_000_000)


def test_a_suspended_machine_costs_little_memory() -> None:
    timeline = AudioTimeline(START, 0)
    sent = timeline.fill(START + 3600 * NS)
    assert sum(len(p.samples) for p in sent) <= SAMPLE_RATE
    assert timeline.position == 3600 * SAMPLE_RATE


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 30), st.booleans(), st.integers(0, 90)), min_size=1, max_size=60
    )
)
def test_time_and_sample_count_never_part(steps: list[tuple[int, bool, int]]) -> None:
    timeline, sent, k = AudioTimeline(START), [], 0
    for advance, heard, late_ms in steps:
        k += advance + 1
        if heard:
            sent += timeline.push(block(k))
        sent += timeline.fill(START + k * BLOCK_NS + late_ms * 1_000_000)
    check(sent)
    for packet in sent:
        counted_ns = packet.first_sample * NS // SAMPLE_RATE
        assert abs(packet.t_ns - START - counted_ns) < 2 * PATIENCE_NS
    assert timeline.position >= (k - 1) * BLOCK - SAMPLES_PER_FRAME * 6
