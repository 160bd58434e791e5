"""What lies behind the head, and the sinks that care: pictures with alpha, the virtual camera."""

from pathlib import Path

import numpy as np
import pytest

from app.commands.options import DriveOptions
from app.drive.background import fill, flat, straight_alpha
from app.drive.sink import FrameResult, RunInfo
from app.sinks.pictures import PictureSink
from app.sinks.virtual_camera import VirtualCameraSink
from encoder.types import DrivenFrame
from render.types import AHEAD
from sensors.types import SAMPLES_PER_FRAME, InputError, SensorFrame


def result(picture: np.ndarray | None, index: int = 0) -> FrameResult:
    sound, ages = np.zeros(SAMPLES_PER_FRAME, np.float32), np.full(2, -1, np.int64)
    frame = SensorFrame(index, 0, sound, None, np.zeros(2, bool), ages, False)
    code = np.zeros(256, np.float32)
    return FrameResult(frame, DrivenFrame(index, 0, code, AHEAD), picture)


def test_names_and_colours() -> None:
    assert fill("#ff8000") == (1.0, pytest.approx(128 / 255), 0.0, 1.0)
    assert fill("studio") == "studio"
    assert flat("transparent") == (0.0, 0.0, 0.0)
    assert flat("studio") == flat("grey") == (0.16, 0.16, 0.16)


@pytest.mark.parametrize("name", ["blau", "#12345", "123456", "#12345g", ""])
def test_no_colour_is_an_input_error(name: str) -> None:
    with pytest.raises(InputError, match="--background green"):
        fill(name)


@pytest.mark.parametrize("wanted", [{"video": Path("x.mp4")}, {"virtual_camera": "auto"}])
def test_transparency_is_refused_where_there_is_no_alpha(wanted: dict[str, Path | str]) -> None:
    with pytest.raises(InputError, match="no alpha"):
        options = DriveOptions(background="transparent", **wanted)  # type: ignore[arg-type]
        options.settings(realtime=False, draw=False, title="")


def test_pictures_keep_their_alpha_and_forget_the_black(tmp_path: Path) -> None:
    from PIL import Image

    over_black = np.array([[[100, 50, 25, 128], [0, 0, 0, 0], [9, 8, 7, 255]]], np.uint8)
    expected = [[199, 100, 50, 128], [0, 0, 0, 0], [9, 8, 7, 255]]
    assert straight_alpha(over_black)[0].tolist() == expected
    sink = PictureSink(tmp_path, 1, transparent=True)
    sink.on_start(RunInfo(3, 1, 1))
    sink.on_frame(result(over_black))
    assert np.asarray(Image.open(tmp_path / "frame_000000.png"))[0].tolist() == expected


class Loopback:
    """A backend as pyvirtualcam wants it, in place of the kernel's device."""

    sent: list[np.ndarray] = []
    closed = 0

    def __init__(self, *, width: int, height: int, fps: float, fourcc: int, device: str | None):
        if device == "/dev/video99":
            raise RuntimeError("'/dev/video99' does not exist")
        self.shape = (height, width, 3)

    def send(self, frame: np.ndarray) -> None:
        Loopback.sent.append(frame.reshape(self.shape).copy())

    def device(self) -> str:
        return "/dev/video10"

    def native_fourcc(self) -> None:
        return None

    def close(self) -> None:
        Loopback.closed += 1


def test_the_virtual_camera_sends_what_was_drawn() -> None:
    import pyvirtualcam

    pyvirtualcam.register_backend("test", Loopback)
    sink = VirtualCameraSink(None, "test")
    sink.on_start(RunInfo(6, 4, None))
    picture = np.arange(96, dtype=np.uint8).reshape(4, 6, 4)
    sink.on_frame(result(picture))
    sink.on_frame(result(None, 1))  # a skipped draw
    sink.close()
    assert len(Loopback.sent) == 1 and Loopback.closed == 1
    np.testing.assert_array_equal(Loopback.sent[0], picture[..., :3])


def test_without_a_loopback_device_one_line_says_what_to_type() -> None:
    import pyvirtualcam

    pyvirtualcam.register_backend("test", Loopback)
    with pytest.raises(InputError, match="modprobe v4l2loopback"):
        VirtualCameraSink("/dev/video99", "test").on_start(RunInfo(6, 4, None))
    with pytest.raises(InputError, match="modprobe v4l2loopback"):  # the library's own word
        VirtualCameraSink("/dev/video98", "v4l2loopback").on_start(RunInfo(6, 4, None))
