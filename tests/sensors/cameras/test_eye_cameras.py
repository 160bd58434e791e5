"""Eye cameras over real HTTP and a real serial line: pictures, failures, and back again."""

import errno
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np
import pytest
from cameras_material import Start, collect, opening
from material import video, wav
from waiting import wait_until

from sensors.cameras.camera import EyeCamera
from sensors.cameras.mjpeg import MjpegLink
from sensors.cameras.spec import cameras
from sensors.cameras.table import SCHEMES, CameraTarget
from sensors.cameras.video import DriverLink, file_pictures
from sensors.cameras.views import Views
from sensors.clock import ManualClock, MonotonicClock
from sensors.live.source import LiveSource
from sensors.picture import CameraLink, CameraLostError, JpegDecoder, Shot
from sensors.session.files import create
from sensors.standins.eye_pictures import film, jpeg
from sensors.standins.mjpeg import FAULTS, MjpegServer
from sensors.standins.serial_camera import SerialCamera
from sensors.types import NS, EyePacket, InputError

FILM = film(12)
FILM_PICTURE = JpegDecoder()(FILM[0])


@pytest.fixture
def server() -> Iterator[MjpegServer]:
    server = MjpegServer(FILM, rate_hz=60, jitter_ms=5)
    yield server
    server.close()


@pytest.fixture
def start() -> Iterator[Start]:
    with opening() as start:
        yield start


def test_pictures_over_http_are_those_that_were_sent(server: MjpegServer, start: Start) -> None:
    packets = collect(start(server.url + "#eye=left"), 40)
    sent = {JpegDecoder()(data).tobytes() for data in FILM}
    assert {p.image.tobytes() for p in packets} <= sent
    assert {p.eye for p in packets} == {0}
    counters = [p.counter for p in packets]
    times = [p.t_ns for p in packets]
    assert counters == sorted(set(counters))
    assert times == sorted(set(times))
    assert MonotonicClock().now_ns() > times[-1]


def test_an_address_of_ipv6_is_a_host_in_brackets() -> None:
    """Red before: Host: ::1:8080, which strict servers refuse."""
    try:
        listener = socket.create_server(("::1", 0), family=socket.AF_INET6)
    except OSError:
        pytest.skip("no IPv6 here")
    with listener:
        port = listener.getsockname()[1]
        link = MjpegLink(f"http://[::1]:{port}/", MonotonicClock())
        with listener.accept()[0] as client:
            request = client.recv(4096)
        link.close()
    assert f"\r\nHost: [::1]:{port}\r\n".encode() in request


def test_a_camera_opened_again_waits_for_the_driver_that_still_holds_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Red before: two threads in one driver, and the first went on after the second began."""
    monkeypatch.setattr("sensors.cameras.camera.JOIN_S", 0.01)
    free, inside, most = threading.Event(), list[int](), list[int]()

    def connect() -> CameraLink:
        inside.append(1)
        most.append(len(inside))
        free.wait()
        inside.pop()
        raise CameraLostError("gone")

    eyes = EyeCamera("eyes", connect, Views(), MonotonicClock())
    eyes.open()
    wait_until(lambda: len(most) == 1, "the first")
    eyes.close()
    eyes.open()
    time.sleep(0.1)
    assert len(most) == 1
    free.set()
    wait_until(lambda: len(most) > 1, "the second")
    eyes.close()
    wait_until(lambda: not any(t.name == "eyes" for t in threading.enumerate()), "the end")
    assert max(most) == 1


@pytest.mark.parametrize("ends", ["a picture", "a failure"])
def test_a_late_read_leaves_a_closed_camera_closed(
    ends: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Red before: it was live, or waiting, for good."""
    monkeypatch.setattr("sensors.cameras.camera.JOIN_S", 0.01)
    inside, free = threading.Event(), threading.Event()

    class Late(CameraLink):
        def read(self, timeout_s: float) -> Shot:
            inside.set()
            free.wait()
            if ends == "a failure":
                raise CameraLostError("gone")
            return Shot(FILM_PICTURE, 0)

        def close(self) -> None: ...

    eyes = EyeCamera("eyes", Late, Views(), ManualClock())
    eyes.open()
    assert inside.wait(20)
    eyes.close()
    free.set()
    wait_until(lambda: not any(t.name == "eyes" for t in threading.enumerate()), "the end")
    assert (eyes.state, eyes.poll()) == ("closed", [])


@pytest.mark.slow
def test_device_times_take_the_jitter_out(server: MjpegServer, start: Start) -> None:
    server.jitter_ms = 12
    packets = collect(start(server.url + "#eye=left"), 60)
    steps = [
        (b.t_ns - a.t_ns) / (b.counter - a.counter)
        for a, b in zip(packets, packets[1:], strict=False)
    ]
    assert np.median(np.abs(np.array(steps) / 1e9 * 60 - 1)) < 0.05


def test_two_views_side_by_side_turned_and_swapped(start: Start) -> None:
    left, right = np.full((200, 200), 60, np.uint8), np.full((200, 200), 180, np.uint8)
    left[:100] = 20  # its upper half is darker
    server = MjpegServer([jpeg(np.concatenate([left, right], 1), 95)])
    try:
        plain = {p.eye: p.image for p in collect(start(server.url), 2)}
        assert plain[0].mean() < 60 < 150 < plain[1].mean()
        turned = {p.eye: p.image for p in collect(start(server.url + "#swap,turn=90"), 2)}
        assert turned[1].mean() < 60 < 150 < turned[0].mean()
        assert turned[1][:, :150].mean() < turned[1][:, 250:].mean() - 20
    finally:
        server.close()


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_camera_survives_its_failures(server: MjpegServer, start: Start, fault: str) -> None:
    camera = start(server.url + "#eye=left")
    collect(camera, 5)
    server.fault = fault
    whole = {JpegDecoder()(data).tobytes() for data in FILM}
    if fault in ("stall", "disconnect", "refuse"):
        wait_until(lambda: camera.counts.connects > 1, "a new attempt")
    elif fault == "flood":
        wait_until(lambda: camera.counts.unused > 20, "pictures that nobody needs")
    elif fault != "clock jump":
        wait_until(lambda: camera.counts.damaged > 3 or camera.counts.connects > 1, "damage")
    if fault != "wrong size":  # small pictures are accepted when they keep coming
        assert {p.image.tobytes() for p in camera.poll()} <= whole
    server.fault = ""
    wait_until(lambda: not camera.poll(), "the slot is empty")
    packets = collect(camera, 30)
    assert packets[-1].image.tobytes() in whole
    assert (camera.state, camera.problem) == ("live", "")


def test_a_slow_reader_gets_the_newest_four(server: MjpegServer, start: Start) -> None:
    camera = start(server.url + "#eye=left")
    wait_until(lambda: camera.counts.pictures > 20, "pictures that nobody takes")
    counters = [p.counter for p in camera.poll()]
    assert len(counters) == 4
    assert counters == sorted(counters)
    assert counters[-1] >= 20
    assert camera.counts.unused >= 16


def test_a_camera_that_sends_only_damage_is_connected_again(
    server: MjpegServer, start: Start
) -> None:
    server.fault = "zeroed"
    camera = start(server.url + "#eye=left")
    wait_until(lambda: camera.counts.connects > 1, "a new attempt")
    assert camera.counts.pictures == 0


def test_a_camera_that_is_not_there_is_found_when_it_comes(start: Start) -> None:
    server = MjpegServer(FILM)
    url = server.url
    server.fault = "refuse"
    camera = start(url + "#eye=right")
    wait_until(lambda: "503" in camera.problem, "the refusal")
    server.fault = ""
    assert collect(camera, 3)[0].eye == 1
    server.close()
    wait_until(lambda: camera.problem != "", "the loss")


@pytest.mark.slow
def test_openiris_over_a_serial_line_and_through_noise(start: Start) -> None:
    pictures = film(12, 240, 240)
    line = SerialCamera(pictures, rate_hz=60)
    try:
        camera = start(f"serial:{line.port}#eye=right")
        packets = collect(camera, 20)
        assert {p.eye for p in packets} == {1}
        assert packets[0].image.shape == (400, 400)
        line.noise = True
        wait_until(lambda: camera.counts.damaged > 2, "noise that is noticed")
        line.noise = False
        collect(camera, 10)
        line.unplug()
        wait_until(lambda: camera.state != "live", "the loss", step_s=0.002)
        assert camera.problem
    finally:
        line.close()


@pytest.mark.slow
def test_one_lost_eye_leaves_the_other_and_the_tick_alone(server: MjpegServer) -> None:
    clock = MonotonicClock()
    dead = MjpegServer(FILM)
    dead.fault = "stall"
    source = LiveSource(None, cameras([server.url, dead.url], clock), clock)
    source.open()
    seen: list[EyePacket] = []
    try:
        deadline = time.monotonic() + 20
        while len(seen) < 30 and time.monotonic() < deadline:
            seen += [p for p in source.poll() if isinstance(p, EyePacket)]
            time.sleep(0.004)
    finally:
        source.close()
        dead.close()
    assert len(seen) >= 30
    assert {p.eye for p in seen} == {0}


@pytest.mark.slow
def test_recorded_eyes_play_as_if_live(tmp_path: Path, start: Start) -> None:
    path = video(tmp_path / "eye.mkv", 10)
    (camera,) = cameras([f"file:{path}#eye=left"], MonotonicClock())
    camera.open()
    try:
        wait_until(lambda: camera.counts.pictures + camera.counts.damaged > 15, "a second round")
    finally:
        camera.close()
    assert camera.counts.damaged > 0  # plain grey is no eye
    smoke = Path(__file__).parents[3] / "recordings" / "smoke"
    packets = collect(start(f"session:{smoke}"), 12)
    assert {p.eye for p in packets} == {0, 1}


def test_a_damaged_picture_of_a_video_is_left_out(tmp_path: Path) -> None:
    """Red before: it ended the camera's thread."""
    path = video(tmp_path / "eye.avi")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + len(data) // 8] = np.random.default_rng(0).bytes(len(data) // 8)
    path.write_bytes(data)
    pictures = file_pictures(path)
    times = [next(pictures)[0] for _ in range(70)]
    assert times == sorted(set(times)) and times[-1] > 70 / 30 * NS  # some were left out


def test_cameras_behind_the_systems_driver_are_read_through_ffmpeg() -> None:
    """FFmpeg's own test picture in place of /dev/video0: the same reader, another input format."""
    link = DriverLink("testsrc=size=640x480:rate=30", "lavfi", MonotonicClock(), {})
    shot = link.read(1.0)
    assert shot is not None
    assert shot.image.shape == (480, 640)
    link.close()


def test_a_camera_of_macos_is_asked_again_for_its_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: each try opened it anew, at a rate that none of them has, and got nothing."""
    opened: list[object] = []
    real = av.open

    class NotYet:
        """Says at every other look that there is no picture yet."""

        def __init__(self) -> None:
            self._test = real("testsrc=size=640x480:rate=30", format="lavfi")
            self.streams, self._looks = self._test.streams, 0

        def demux(self, stream: object) -> Iterator[object]:
            for packet in self._test.demux(stream):
                self._looks += 1
                if self._looks % 2:
                    raise av.error.BlockingIOError(errno.EAGAIN, "nothing yet")
                yield packet

        def close(self) -> None:
            self._test.close()

    def av_open(device: str, format: str, options: dict[str, str]) -> NotYet:  # noqa: A002
        opened.append((device, format, options))
        return NotYet()

    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(av, "open", av_open)
    link = SCHEMES["uvc"].open(CameraTarget("0", Views()), MonotonicClock())()
    shots = [link.read(1.0) for _ in range(8)]
    assert len([shot for shot in shots if shot is not None]) == 4
    assert opened == [("0", "avfoundation", {"framerate": "30"})]
    link.close()


@pytest.mark.parametrize(
    "specs",
    [
        ["nonsense"],
        ["ftp://host/"],
        ["usb:12:34"],
        ["http://h/", "http://h/", "http://h/"],
        ["http://h/#turn=45"],
        ["http://127.0.0.1:99999/"],  # red before: the thread died, "connecting" for ever
        ["http://[::1/"],
        ["http:///x"],
        ["http://h/a b"],
        ["http://h/#crop=0:0:5:5"],
        ["http://a/#eye=left", "http://b/#eye=left"],
        ["file:no such file.mkv"],
        ["session:no such folder"],
    ],
)
def test_bad_specs_are_refused_in_one_line(specs: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        cameras(specs, MonotonicClock())
    assert "\n" not in str(caught.value)


def test_a_session_without_eyes_is_no_camera(tmp_path: Path) -> None:
    """Red before: looked for without an end, while nothing but silence was recorded."""
    create(tmp_path / "s", wav(tmp_path / "a.wav", 0.1))
    with pytest.raises(InputError, match=r"expected pictures of eyes, got none in .*; choose"):
        cameras((f"session:{tmp_path / 's'}",), ManualClock())
