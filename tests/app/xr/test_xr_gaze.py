"""Where a wearer looks: from the runtime to the driver's condition, recorded on the way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driver_material import driver, sensor_frame, sound

from app.xr.headset import xr_head
from app.xr.link import XrMemory
from sensors.assemble import Assembler
from sensors.clock import ManualClock
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import NS, AudioPacket, HeadPacket, HeadPose, InputError

ASIDE = (0.28, 0.0, 0.96)  # to the subject's left


def poses(gaze: tuple[float, float, float]) -> list[HeadPacket]:
    """What becomes of a pose with this gaze, in the axes of OpenXR."""
    memory, clock = XrMemory(), ManualClock(NS)
    source = xr_head(memory, clock, lambda line: None)
    source.open()
    memory.poses.post(t_ns=NS, position=(0, 1.6, 0), xyzw=(0, 0, 0, 1), tracked=True, gaze=gaze)
    return [packet for packet in source.poll() if isinstance(packet, HeadPacket)]


def test_the_axes_are_the_heads() -> None:
    (packet,) = poses((-0.28, 0.0, -0.96))  # to the left and ahead
    assert packet.gaze == pytest.approx(ASIDE)
    (untracked,) = poses((np.nan, np.nan, np.nan))
    assert untracked.gaze is None
    assert poses((0.0, 0.0, 0.0)) == []  # no direction: refused


def test_it_is_recorded_and_fades_with_its_pose(tmp_path: Path) -> None:
    packet = HeadPacket(NS, HeadPose(), gaze=ASIDE)
    with RecordingWriter(tmp_path / "s", created="now") as writer:
        writer.append(packet)
        writer.append(replace(packet, t_ns=NS + 1, gaze=None))
    with Recording(tmp_path / "s") as recording:
        again = [recording.packet(entry) for entry in recording.entries]
    assert again == [packet, replace(packet, t_ns=NS + 1, gaze=None)]

    assembler = Assembler()
    assembler.push(packet)
    for index in range(8):
        silence = np.zeros(1600, np.float32)
        t_ns = NS + index * NS // 30
        assembler.push(AudioPacket(t_ns, 1600 * index, silence))
    gazes = [frame.gaze for frame in assembler.ready()]
    assert gazes[:4] == [ASIDE] * 4 and gazes[-1] is None


def test_a_bad_direction_in_a_timeline_is_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "s", created="now") as writer:
        writer.append(HeadPacket(NS, HeadPose(), gaze=ASIDE))
    timeline = tmp_path / "s" / "timeline.jsonl"
    timeline.write_text(timeline.read_text().replace("0.28", "9e9"))
    with pytest.raises(InputError, match="direction"):
        Recording(tmp_path / "s")


def test_it_is_the_drivers_condition_while_it_is_tracked() -> None:
    d, audio = driver("onnx"), sound(12)
    codes, gazes = [], []
    for aim in (None, ASIDE):
        state = d.init_state(5)
        for index, samples in enumerate(audio):
            frame = replace(sensor_frame(index, samples), gaze=aim if index < 8 else None)
            driven, state = d.step(frame, state)
            codes.append(driven.expression)
            gazes.append(driven.gaze)
    free, aimed = np.array(gazes[:12]), np.array(gazes[12:])
    np.testing.assert_allclose(aimed[:8], np.broadcast_to(np.float32(ASIDE), (8, 2, 3)))
    assert np.abs(aimed[8] - aimed[7]).max() < 0.3  # the walk goes on from near there
    assert np.abs(free[:8] - aimed[:8]).max() > 0.1
    assert np.abs(np.array(codes[:8]) - codes[12:20]).max() > 1e-3
