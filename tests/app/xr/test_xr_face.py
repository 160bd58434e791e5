"""What a headset's own face tracking says: asked as OpenXR wants it, and recorded with its pose."""

import ctypes
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.xr.headset import xr_head
from app.xr.link import XrMemory
from app.xr.loop import XrLoop
from app.xr.runtimes import face
from app.xr.runtimes.standin import StandInRuntime
from sensors.clock import ManualClock
from sensors.head.headset import reading
from sensors.session import files
from sensors.session.recording import Recording, RecordingWriter
from sensors.types import FACE_DIM, NS, HeadPacket, HeadPose, InputError

SMILE = tuple(round(k / FACE_DIM, 4) for k in range(FACE_DIM))


class FaceCalls:
    """The two calls of the extension, as a runtime answers them."""

    def __init__(self) -> None:
        import xr

        self.result, self.is_valid, self.weights = 0, 1, SMILE
        self.asked: list[Any] = []
        self._answer = xr.PFN_xrGetFaceExpressionWeights2FB(self._get)  # kept: C holds its address

    def create_face_tracker2_fb(self, session: Any, info: Any) -> Any:
        import xr

        self.asked.append((session, info.face_expression_set, list(info.requested_data_sources)))
        return xr.FaceTracker2FB()

    def get_instance_proc_addr(self, instance: Any, name: str) -> Any:
        import xr

        assert name == "xrGetFaceExpressionWeights2FB"
        return ctypes.cast(self._answer, xr.PFN_xrVoidFunction)

    def _get(self, tracker: Any, info: Any, found: Any) -> int:
        self.asked.append(info.contents.time)
        out = found.contents
        assert (out.weight_count, out.confidence_count) == (FACE_DIM, 2)
        out.weights[:] = self.weights
        out.is_valid = self.is_valid
        return self.result


@pytest.mark.slow
def test_the_extension_is_asked_as_it_wants_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    import xr

    calls = FaceCalls()
    shown = SimpleNamespace(
        **(vars(xr) | {n: getattr(calls, n) for n in dir(calls) if n[0] != "_"})
    )
    monkeypatch.setattr(face, "library", lambda: shown)
    tracked = face.Face("instance")
    tracked.attach("session")
    assert tracked.weights(7) == pytest.approx(SMILE)
    cameras = xr.FaceTrackingDataSource2FB.VISUAL.value
    assert calls.asked == [("session", xr.FaceExpressionSet2FB.DEFAULT, [cameras]), 7]
    calls.weights = (1.5, -0.5, *SMILE[2:])
    assert tracked.weights(8) == pytest.approx((1.0, 0.0, *SMILE[2:]))
    calls.is_valid = 0
    assert tracked.weights(9) is None
    calls.is_valid, calls.result = 1, -1
    assert tracked.weights(10) is None


def test_it_comes_with_the_pose_and_is_recorded(tmp_path: Path) -> None:
    memory, clock = XrMemory(), ManualClock(NS)
    runtime, source = StandInRuntime(clock), xr_head(memory, clock, lambda line: None)
    loop = XrLoop(runtime, memory, lambda _: None, clock, lambda: memory.status["poses"] < count)  # type: ignore[arg-type]
    source.open()
    count = 2
    loop.run()
    runtime.face, count = SMILE, 4
    loop.run()
    packets = [packet for packet in source.poll() if isinstance(packet, HeadPacket)]
    assert [packet.face is None for packet in packets] == [True, True, False, False]
    assert packets[-1].face == SMILE
    with RecordingWriter(tmp_path / "s", created="now") as writer:
        for packet in packets:
            writer.append(packet)
    with Recording(tmp_path / "s") as recording:
        assert [recording.packet(entry) for entry in recording.entries] == packets
    assert files.info(tmp_path / "s")["head_faces"] == 2


@pytest.mark.parametrize("bad", [SMILE[1:], (np.nan, *SMILE[1:]), (2.0, *SMILE[1:])])
def test_what_is_no_face_is_refused(tmp_path: Path, bad: tuple[float, ...]) -> None:
    from sensors.head.gate import ReadingGate

    told = list[str]()
    gate = ReadingGate("xr", told.append)
    assert gate(reading((0, 0, 0), (0, 0, 0, 1), face=bad), NS) is None and gate.counts.bad == 1
    with RecordingWriter(tmp_path / "s", created="now") as writer:
        writer.append(HeadPacket(NS, HeadPose(), face=bad))
    with pytest.raises(InputError, match="70 weights from 0 to 1"):
        Recording(tmp_path / "s")
