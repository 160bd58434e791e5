"""Against Monado, a real OpenXR runtime: what the headset's process shows, and what it survives.

`make check-xr` runs this inside a chroot; it is no part of `make check`. Monado has no display
there (its null compositor), and a simulated headset whose head moves.
"""

import json
import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, monotonic_ns, sleep
from typing import Any

import numpy as np
import pytest

from app.xr.link import XrInfo, XrMemory
from app.xr.loop import XrLoop
from app.xr.place import eye_camera, in_front
from app.xr.runtimes.openxr import OpenXrRuntime, describe
from app.xr.runtimes.protocol import Eye, Frame, Session
from app.xr.scene import Scene
from render.decoder import identity
from render.gl.contexts import GLContext
from render.splats.renderer import wrap_context
from render.types import AHEAD, Gaussians
from sensors.clock import MonotonicClock
from sensors.session.recording import Recording
from sensors.types import FPS, NS

ROOT = Path(__file__).parents[2]
RUNTIME = "/usr/share/openxr/1/openxr_monado.json"
PATIENCE_S = 60.0
MIN_DB = 55.0  # as for golden pictures
FRAMES, EVERY = 300, 10
SECONDS, BACK_S = 80, 3.0
BEHIND = (0.16, 0.16, 0.16)


class Monado:
    """The service, which clients reach by a socket."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._socket = folder, folder / "monado_comp_ipc"
        self._process: subprocess.Popen[bytes] | None = None
        self._number = 0

    def start(self) -> int:
        """When it was started, on the monotonic clock; returns when it takes clients."""
        self._socket.unlink(missing_ok=True)  # what was killed leaves it
        self._number, started = self._number + 1, monotonic_ns()
        with (self._folder / f"monado{self._number}.log").open("wb") as log:
            self._process = subprocess.Popen(
                ["monado-service"], stdin=subprocess.PIPE, stdout=log, stderr=log
            )
        until(self._socket.exists)
        return started

    def kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait()


def tell(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def until(holds: Callable[[], bool]) -> None:
    """Wait until it holds."""
    end = monotonic() + PATIENCE_S
    while not holds():
        assert monotonic() < end, "it never came"
        sleep(0.01)


@pytest.fixture(scope="module")
def monado(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Monado]:
    folder = tmp_path_factory.mktemp("monado")
    os.environ |= {
        "XDG_RUNTIME_DIR": str(folder),
        "XR_RUNTIME_JSON": RUNTIME,
        "XRT_COMPOSITOR_NULL": "1",
        "SIMULATED_ENABLE": "1",
    }
    made = Monado(folder)
    made.start()
    yield made
    made.kill()


@dataclass(frozen=True)
class Seen:
    """A stereo frame as it was handed over."""

    eyes: tuple[Eye, Eye]
    cloud: Gaussians
    pictures: list[np.ndarray]  # [H, W, 3] u8, an eye


class Watched:
    """A session whose pictures are read before they are handed over: those of every 10th frame."""

    def __init__(self, session: Session, watch: "Watch") -> None:
        self._session, self._watch = session, watch
        self._frame, self._targets = Frame(None, 0), list[Any]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def wait_frame(self) -> Frame:
        self._frame, self._targets = self._session.wait_frame(), []
        return self._frame

    def target(self, eye: int) -> Any:
        self._targets.append(self._session.target(eye))
        return self._targets[-1]

    def end_frame(self) -> None:
        watch, (width, height) = self._watch, self._session.size
        if self._frame.eyes is not None:
            watch.frames += 1
            if watch.frames % EVERY == 1:
                read = (target.read(components=4, alignment=4) for target in self._targets)
                shaped = (np.frombuffer(p, np.uint8).reshape(height, width, 4) for p in read)
                pictures = [picture[::-1, :, :3] for picture in shaped]
                watch.seen.append(Seen(self._frame.eyes, watch.clouds[-1], pictures))
        self._session.end_frame()


class Watch:
    """A real runtime, the scene that is drawn for it, and what was seen of both."""

    def __init__(self) -> None:
        self._runtime = OpenXrRuntime(False, MonotonicClock())
        self.frames, self.seen = 0, list[Seen]()
        self.clouds = deque[Gaussians](maxlen=1)
        self.contexts: list[GLContext] = []

    def open(self) -> Any:
        return Watched(self._runtime.open(), self)

    def scene(self, context: GLContext) -> Scene:
        self.contexts.append(context)
        clouds = self.clouds

        class SeenScene(Scene):
            def draw(self, session: Any, eyes: Any, now_ns: int, share: float = 1.0) -> None:
                super().draw(session, eyes, now_ns)  # in full, however long it takes

            def cloud(self, now_ns: int) -> Gaussians:
                clouds.append(super().cloud(now_ns))
                return clouds[-1]

            def close(self) -> None: ...  # its context draws once more

        return SeenScene(context, XrInfo("auto", "ben", gaussians="16k"))


def psnr_db(one: np.ndarray, other: np.ndarray) -> float:
    """inf: equal."""
    squares = np.mean((one.astype(float) - other) ** 2)
    return float(10 * np.log10(255**2 / squares)) if squares else np.inf


def test_both_eyes_hold_what_our_stereo_renderer_draws(monado: Monado) -> None:
    assert describe().startswith("Monado")
    watch, memory, rng = Watch(), XrMemory(), np.random.default_rng(0)
    clock = MonotonicClock()

    def wanted() -> bool:
        """Asked before each frame: a tick comes with every one."""
        now_ns = clock.now_ns()
        face, head = 0.3 * rng.normal(size=256), (0, 0, 0, 1, 0, 0, 0, 0)
        memory.ticks.post(t_ns=now_ns, posted_ns=now_ns, expression=face, gaze=AHEAD, head=head)
        return watch.frames < FRAMES

    XrLoop(watch, memory, watch.scene, clock, wanted).run()
    assert memory.text("state") == "focused" and not memory.text("problem")
    (context,) = watch.contexts
    renderer, middle = wrap_context(context), identity.load("ben").eye_centers.mean(0)
    place = in_front(watch.seen[0].eyes, middle)
    worst_db = np.inf
    for seen in watch.seen:
        for eye, picture in zip(seen.eyes, seen.pictures, strict=True):
            height, width = picture.shape[:2]
            renderer.draw(seen.cloud, eye_camera(eye, place, width, height, BEHIND))
            own = renderer.read_rgba()[..., :3]
            assert own.std() > 10  # somebody is there
            worst_db = min(worst_db, psnr_db(own, picture))
        left, right = (picture.astype(int) for picture in seen.pictures)
        assert np.abs(left - right).max() > 30
    tell(f"{describe()}, {context.renderer}, focused, {width} x {height} an eye: {watch.frames}")
    tell(f"frames; both eyes of {len(watch.seen)} are ours within {worst_db:.1f} dB")
    assert len(watch.seen) >= FRAMES / EVERY and worst_db >= MIN_DB


class Run:
    """`livedrive`, and what it says."""

    def __init__(self, *words: str) -> None:
        command = [sys.executable, "-c", "from app.main import main; main()", *words]
        self._process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
        self.said = list[str]()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def says(self, words: str) -> None:
        """Wait for a line with these words."""
        until(lambda: self._has_said(words) or self._process.poll() is not None)
        assert self._has_said(words), self.said

    def end(self) -> int:
        self._reader.join()
        return self._process.wait()

    def _has_said(self, words: str) -> bool:
        return any(words in line for line in self.said)

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self.said.append(line.strip())
            tell(line.strip())


def test_a_run_survives_its_runtime_and_replays(monado: Monado, tmp_path: Path) -> None:
    session, report, live = tmp_path / "session", tmp_path / "run.json", tmp_path / "live.npz"
    run = Run(
        *("run", "--xr", "--headless", "--mic", "none", "--gaussians", "16k"),
        *("--seconds", str(SECONDS), "--record", str(session)),
        *("--report", str(report), "--motion", str(live)),
    )
    run.says("recording into")
    sleep(SECONDS / 3)
    monado.kill()
    run.says("headset: the runtime")  # has gone
    sleep(1)
    started_ns = monado.start()
    assert run.end() == 0, run.said

    told = json.loads(report.read_text())
    headset = told["xr"]
    tell(str({name: told[name] for name in ("frames", "dropped", "late_ms", "xr")}))
    assert headset["runtime"].startswith("Monado") and headset["state"] == "focused"
    assert headset["losses"] == 1 and headset["crashes"] == 0 and not headset["problem"]
    assert headset["frames"] >= FRAMES
    assert told["frames"] == SECONDS * FPS and told["dropped"] == 0

    again = tmp_path / "again.npz"
    replayed = Run("replay", str(session), "--fast", "--motion", str(again))
    assert replayed.end() == 0, replayed.said
    with Recording(session) as recording:
        assert recording.info.devices["head"] == "xr"
        after_ns = [head.t_ns for head in recording.heads if head.t_ns > started_ns]
        back_s = (min(after_ns) - started_ns) / NS  # a pose is that of a frame
        tell(f"{len(recording.heads)} poses, the first {back_s:.2f} s after the runtime's return")
        assert back_s < BACK_S
        assert len(recording.heads) >= FRAMES and all(head.valid for head in recording.heads)
    with np.load(live) as ours, np.load(again) as theirs:
        for name in ("t_ns", "expression", "gaze"):
            np.testing.assert_array_equal(ours[name], theirs[name])


def test_the_headset_is_recorded_without_being_shown_in(monado: Monado, tmp_path: Path) -> None:
    session = tmp_path / "session"
    run = Run("record", str(session), "--xr", "--mic", "none", "--seconds", "3")
    assert run.end() == 0, run.said
    with Recording(session) as recording:
        tell(f"{len(recording.heads)} poses in 3 s")
        assert len(recording.heads) > 100 and all(head.valid for head in recording.heads)
        assert recording.heads[0].pose != recording.heads[-1].pose  # the simulated head moves
