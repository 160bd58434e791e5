"""ReplaySource: the Source contract, fast == real time, bit for bit twice, bounded memory."""

import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import soundfile
from material import frames, packets, same_packet
from source_contract import check_source, drain

from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session import eye_video, recording
from sensors.session.files import create
from sensors.session.recording import Recording, RecordingWriter
from sensors.session.replay import MAX_POLL_SAMPLES, ReplaySource
from sensors.session.timeline import end_ns
from sensors.types import NS, SAMPLE_RATE, AudioPacket, SensorFrame


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "s"
    with RecordingWriter(path, created="") as writer:
        for packet in packets(0.7):
            writer.append(packet)
    return path


def digest(frame: SensorFrame) -> tuple[object, ...]:
    eyes = None if frame.eyes is None else frame.eyes.tobytes()
    arrays = (frame.audio.tobytes(), frame.eyes_valid.tobytes(), frame.eyes_age_ns.tobytes())
    return (frame.index, frame.t_ns, frame.audio_gap, eyes, *arrays)


def run(source: ReplaySource, clock: ManualClock, step_ns: int) -> list[tuple[object, ...]]:
    assembler = Assembler()
    source.open()
    result: list[tuple[object, ...]] = []
    while not source.exhausted:
        for packet in source.poll():
            assembler.push(packet)
        result += [digest(frame) for frame in assembler.ready()]
        clock.advance_ns(step_ns)
    source.close()
    return result


def test_source_contract(folder: Path) -> None:
    clock = ManualClock()
    fast = check_source(ReplaySource(Recording(folder), clock))
    slow = check_source(
        ReplaySource(Recording(folder), clock, realtime=True), lambda: clock.advance_ns(7_000_001)
    )
    assert all(same_packet(a, b) for a, b in zip(fast, slow, strict=True))
    assert all(same_packet(a, b) for a, b in zip(fast, packets(0.7), strict=True))


def test_at_the_pace_of_the_clock_pictures_are_decoded_when_they_are_nearly_due(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And at once where they are asked for before."""
    monkeypatch.setattr(recording, "PACED_REST_S", 60.0)
    for paced in (False, True):
        opened = Recording(folder)
        if paced:
            opened.pace()
        left, *others = opened.eyes[0].entries
        start = time.monotonic()
        assert opened.packet(left) and all(opened.packet(one) for one in others[:2])
        ahead = opened.eyes[0]._video._ahead
        assert ahead is not None
        if paced:
            time.sleep(0.05)
            assert not ahead.done()
        else:
            ahead.result(10)
        opened.close()
        assert time.monotonic() - start < 30


@pytest.mark.parametrize("codec", ["ffv1", "x264"])
def test_a_jump_decodes_from_the_last_key_frame(
    codec: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: a jump back of a frame decoded all of the session before it, within a tick."""
    count = 320
    writer = eye_video.EyeVideoWriter(tmp_path / "eye.mkv", codec)
    for k in range(count):
        writer.append(np.full((400, 400), k % 200, np.uint8), k * NS // 30)
    writer.close()
    reader = eye_video.EyeVideoReader(tmp_path / "eye.mkv")
    decoded = list[int]()
    plain = eye_video.gray
    monkeypatch.setattr(eye_video, "gray", lambda frame: decoded.append(0) or plain(frame))
    levels = [
        int(image[200, 200]) for k in range(count) if (image := reader.picture(k)) is not None
    ]
    for number in (318, 310, 309, 12, 11, 319, 0, 290):
        decoded.clear()
        image = reader.picture(number)
        assert image is not None and int(image[200, 200]) == levels[number]
        group = 30 if codec == "ffv1" else 250
        assert len(decoded) <= group + 3
    assert len(levels) == count and reader.picture(count) is None
    reader.close()


@pytest.mark.slow
def test_fast_and_real_time_give_the_same_frames(folder: Path) -> None:
    live = Assembler()  # what the live run saw while it recorded
    for packet in packets(0.7):
        live.push(packet)
    expected = [digest(frame) for frame in live.ready()]
    assert len(expected) == 21
    for realtime, step_ns in ((False, 0), (True, 1_000_003), (True, 33_333_333), (True, 5 * NS)):
        clock = ManualClock(77)
        source = ReplaySource(Recording(folder), clock, realtime)
        assert run(source, clock, step_ns) == expected
    assert [digest(frame) for frame in frames(folder)] == expected


def test_real_time_never_gives_a_packet_early_or_late(folder: Path) -> None:
    clock, recording = ManualClock(1000), Recording(folder)
    source = ReplaySource(recording, clock, realtime=True)
    source.open()
    first_ns = min(e.t_ns for e in recording.entries)
    given = 0
    while not source.exhausted:
        given += len(source.poll())
        now_ns = clock.now_ns() - 1000 + first_ns
        assert all(end_ns(e) <= now_ns for e in recording.entries[:given])
        assert source.exhausted or end_ns(recording.entries[given]) > now_ns
        clock.advance_ns(5_000_000)


@pytest.mark.slow
def test_a_video_cut_short_is_held_and_counted(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "s", created="") as writer:
        for packet in packets(0.7):
            writer.append(packet)
    video = tmp_path / "s" / "eye_right.mkv"
    data = video.read_bytes()
    video.write_bytes(data[: len(data) // 4])
    source = ReplaySource(Recording(tmp_path / "s"), ManualClock())
    check_source(source)
    source.open()
    drain(source)
    assert 28 <= source.dropped <= 34
    got = frames(tmp_path / "s")
    assert len(got) == 21
    assert bool(got[2].eyes_valid[1])
    assert not got[-1].eyes_valid[1]
    assert got[-1].eyes_valid[0]
    assert got[-1].eyes is not None
    assert got[-1].eyes[1].any()  # held, not blanked


def test_a_damaged_picture_costs_only_itself(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "s", created="") as writer:
        for packet in packets(0.5):
            writer.append(packet)
    with Recording(tmp_path / "s") as recording:
        whole = [recording.packet(entry) for entry in recording.eyes[0].entries]
    video = tmp_path / "s" / "eye_left.mkv"
    data = bytearray(video.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 64] = bytes(64)
    video.write_bytes(data)
    with Recording(tmp_path / "s") as recording:
        hurt = [recording.packet(entry) for entry in recording.eyes[0].entries]
    same = [
        a is not None and b is not None and same_packet(a, b)
        for a, b in zip(whole, hurt, strict=True)
    ]
    assert same.count(False) == 1
    assert len(hurt) == len(whole)


@pytest.mark.slow
def test_two_minutes_of_sound_are_streamed(tmp_path: Path) -> None:
    seconds = 120
    path = tmp_path / "long.wav"
    with soundfile.SoundFile(path, "w", 16_000, 1, "PCM_16") as file:
        rng = np.random.default_rng(0)
        for _ in range(seconds):
            file.write(rng.uniform(-0.5, 0.5, 16_000).astype(np.float32))
    tracemalloc.start()
    create(tmp_path / "s", path, audio_format="pcm16")
    source = ReplaySource(Recording(tmp_path / "s"), ManualClock())
    source.open()
    samples, frames_seen, assembler = 0, 0, Assembler()
    while not source.exhausted:
        for packet in source.poll():
            assembler.push(packet)
            samples += len(packet.samples) if isinstance(packet, AudioPacket) else 0
        frames_seen += len(assembler.ready())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert samples == seconds * SAMPLE_RATE
    assert frames_seen == seconds * 30
    assert peak < 5e6  # the sound alone is 23 MB


def test_a_poll_after_a_stall_is_bounded(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "s", created="") as writer:
        for k in range(300):
            samples = np.zeros(1600, np.float32)
            writer.append(AudioPacket(k * 1600 * NS // SAMPLE_RATE, k * 1600, samples))
    clock = ManualClock()
    source = ReplaySource(Recording(tmp_path / "s"), clock, realtime=True)
    source.open()
    clock.advance_ns(3600 * NS)
    polls = [sum(len(p.samples) for p in source.poll()) for _ in range(11)]  # type: ignore[union-attr]
    assert polls == [MAX_POLL_SAMPLES] * 10 + [0]


def test_a_session_without_packets_is_exhausted_at_once(tmp_path: Path) -> None:
    RecordingWriter(tmp_path / "s", created="").close()
    source = ReplaySource(Recording(tmp_path / "s"), ManualClock())
    assert check_source(source) == []
    assert source.info.duration_ns == 0
