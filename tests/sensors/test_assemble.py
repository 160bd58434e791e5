"""The Assembler: chunking, gaps, drift, eyes matched backward in time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.assemble import MAX_FILL, Assembler
from sensors.types import (
    EYE_SIZE,
    NS,
    SAMPLE_RATE,
    SAMPLES_PER_FRAME,
    AudioPacket,
    EyePacket,
    InputError,
    Packet,
    SensorFrame,
)

START_NS = 1_234_567_891
SOUND = np.random.default_rng(0).uniform(-1, 1, 10 * SAMPLES_PER_FRAME + 77).astype(np.float32)


def time_at(sample: int) -> int:
    return START_NS + sample * NS // SAMPLE_RATE


def eye(t_ns: int, index: int, counter: int) -> EyePacket:
    return EyePacket(t_ns, index, counter, np.full((EYE_SIZE, EYE_SIZE), counter, np.uint8))


def audio(first: int, last: int, *, gap: bool = False, shift_ns: int = 0) -> AudioPacket:
    return AudioPacket(time_at(first) + shift_ns, first, SOUND[first:last], gap)


def assemble(packets: list[Packet], assembler: Assembler | None = None) -> list[SensorFrame]:
    assembler = assembler or Assembler()
    for packet in packets:
        assembler.push(packet)
    return assembler.ready()


def in_arrival_order(cuts: list[int], pictures: list[EyePacket]) -> list[Packet]:
    """Sound arrives when its last sample exists; pictures of the same instant come first."""
    edges = [0, *sorted(cuts), len(SOUND)]
    sounds = [audio(a, b) for a, b in zip(edges, edges[1:], strict=False)]
    arrivals = [(time_at(b), 1, k) for k, b in enumerate(edges[1:])]
    arrivals += [(p.t_ns, 0, k) for k, p in enumerate(pictures)]
    return [pictures[k] if kind == 0 else sounds[k] for _, kind, k in sorted(arrivals)]


def same(a: SensorFrame, b: SensorFrame) -> bool:
    eyes = a.eyes is b.eyes is None or (
        a.eyes is not None and b.eyes is not None and np.array_equal(a.eyes, b.eyes)
    )
    return bool(
        eyes
        and (a.index, a.t_ns, a.audio_gap) == (b.index, b.t_ns, b.audio_gap)
        and np.array_equal(a.audio, b.audio)
        and np.array_equal(a.eyes_valid, b.eyes_valid)
        and np.array_equal(a.eyes_age_ns, b.eyes_age_ns)
    )


PICTURES = sorted(
    [eye(START_NS + 5_000_000 + k * 11_111_111, 0, k) for k in range(25)]
    + [eye(time_at(k * SAMPLES_PER_FRAME), 1, k) for k in range(4)],
    key=lambda p: p.t_ns,
)
WHOLE = assemble(in_arrival_order([], PICTURES))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, len(SOUND)), max_size=40))
def test_any_chunking_gives_the_same_frames(cuts: list[int]) -> None:
    frames = assemble(in_arrival_order(cuts, PICTURES))
    assert len(frames) == len(WHOLE) == 10
    assert all(same(a, b) for a, b in zip(frames, WHOLE, strict=True))


def test_frames_carry_exact_sound_and_end_time() -> None:
    assembler = Assembler()
    frames = assemble(in_arrival_order([480 * k for k in range(33)], []), assembler)
    assert np.array_equal(np.concatenate([f.audio for f in frames]), SOUND[: 10 * 1600])
    assert [f.t_ns for f in frames] == [time_at(1600 * (k + 1)) for k in range(10)]
    assert assembler.partial_samples == 77
    assert all(f.eyes is None and not f.eyes_valid.any() for f in frames)
    assert all((f.eyes_age_ns == -1).all() for f in frames)


def test_only_pictures_of_the_past_are_seen() -> None:
    for frame in WHOLE:
        past = [p for p in PICTURES if p.eye == 0 and p.t_ns <= frame.t_ns]
        assert frame.eyes is not None
        assert frame.eyes[0, 0, 0] == past[-1].counter
        assert frame.eyes_age_ns[0] == frame.t_ns - past[-1].t_ns


def test_a_picture_at_the_frame_end_is_seen_and_one_later_is_not() -> None:
    end_ns = time_at(SAMPLES_PER_FRAME)
    pictures = [eye(end_ns, 0, 7), eye(end_ns + 1, 1, 8)]
    [frame] = assemble([*pictures, audio(0, 1600)])
    assert frame.eyes is not None
    assert frame.eyes[0, 0, 0] == 7
    assert frame.eyes_valid.tolist() == [True, False]
    assert frame.eyes_age_ns.tolist() == [0, -1]


def test_a_stalled_eye_is_held_then_invalid() -> None:
    frames = assemble(in_arrival_order([], [eye(time_at(1600), 0, 9)]))
    assert all(f.eyes is not None and f.eyes[0, 0, 0] == 9 for f in frames)
    assert [bool(f.eyes_valid[0]) for f in frames] == [True] * 4 + [False] * 6


def test_lost_sound_becomes_marked_silence_and_time_goes_on() -> None:
    assembler = Assembler()
    frames = assemble([audio(0, 2000), audio(5000, 8000)], assembler)
    assert [f.audio_gap for f in frames] == [False, True, True, True, False]
    assert assembler.lost_samples == 3000
    assert not frames[2].audio.any()
    assert np.array_equal(frames[4].audio, SOUND[6400:8000])
    assert [f.t_ns for f in frames] == [time_at(1600 * (k + 1)) for k in range(5)]


def test_a_packet_marked_gap_marks_its_frames() -> None:
    frames = assemble([audio(0, 1600), audio(1600, 3300, gap=True), audio(3300, 6400)])
    assert [f.audio_gap for f in frames] == [False, True, True, False]


def test_a_huge_gap_is_shortened_but_the_time_is_right() -> None:
    hour = 3600 * SAMPLE_RATE
    late = AudioPacket(time_at(hour), hour, SOUND[:1600])
    assembler = Assembler()
    frames = assemble([audio(0, 1600), late], assembler)
    assert len(frames) == 2 + MAX_FILL // SAMPLES_PER_FRAME
    assert frames[-1].t_ns == time_at(hour + 1600)
    assert assembler.lost_samples == hour - 1600


def test_drifting_clocks_are_followed_and_jitter_is_not() -> None:
    jittery = [audio(0, 1600), audio(1600, 3200, shift_ns=900_000), audio(3200, 4800)]
    assert [f.t_ns for f in assemble(jittery)] == [time_at(1600 * k) for k in (1, 2, 3)]
    drifted = assemble([audio(0, 1600), audio(1600, 3200, shift_ns=3_000_000)])
    assert drifted[1].t_ns == time_at(3200) + 3_000_000
    back = assemble([audio(0, 1600), audio(1600, 3200, shift_ns=-50_000_000)])
    assert back[1].t_ns > back[0].t_ns


def test_skipped_pictures_are_counted() -> None:
    assembler = Assembler()
    assemble([eye(0, 0, 0), eye(1, 0, 3), eye(2, 1, 9), eye(3, 1, 10)], assembler)
    assert assembler.lost_pictures == 2


def test_pictures_without_sound_stay_bounded() -> None:
    packets: list[Packet] = [eye(START_NS + k, 0, k % 256) for k in range(300)]
    [frame] = assemble([*packets, audio(0, 1600)])
    assert frame.eyes is not None
    assert frame.eyes[0, 0, 0] == 299 % 256


def test_nan_in_later_sound_changes_nothing_before() -> None:
    poison = AudioPacket(time_at(8000), 8000, np.full(8000, np.nan, np.float32))
    frames = assemble([audio(0, 8000), poison])
    assert all(np.isfinite(f.audio).all() for f in frames[:5])
    assert not frames[5].audio.any() and frames[5].audio_gap


@pytest.mark.parametrize(
    "packet",
    [
        EyePacket(0, 0, 0, np.zeros((200, 400), np.uint8)),
        EyePacket(0, 0, 0, np.zeros((400, 400), np.float32)),  # type: ignore[arg-type]
        EyePacket(0, 2, 0, np.zeros((400, 400), np.uint8)),
        AudioPacket(0, 0, np.zeros((10, 2), np.float32)),
        AudioPacket(0, 0, np.zeros(10, np.int16)),  # type: ignore[arg-type]
    ],
)
def test_bad_packets_are_input_errors(packet: Packet) -> None:
    with pytest.raises(InputError, match="expected"):
        Assembler().push(packet)


def test_a_counter_that_goes_back_is_an_input_error() -> None:
    with pytest.raises(InputError, match="goes back"):
        assemble([audio(1600, 3200), audio(0, 1600)])


@pytest.mark.parametrize("junk", [np.nan, -np.inf, 1e30])
def test_what_is_no_sound_is_silence(junk: float) -> None:
    """Red before: one such sample left a head without a shape for good, and ended a video."""
    samples = np.full(1600, 0.5, np.float32)
    samples[7] = junk
    packets = [AudioPacket(0, 0, samples), AudioPacket(NS // 30, 1600, SOUND[:1600])]
    first, second = assemble([*packets])
    assert first.audio[7] == 0 and (np.delete(first.audio, 7) == 0.5).all()
    assert first.audio_gap and not second.audio_gap
    assert np.array_equal(second.audio, SOUND[:1600])
