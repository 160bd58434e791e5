"""What leaving the machine costs: every protocol, the page, and a crowd that wishes us ill."""

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from itertools import cycle, islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.bars import at_least, at_most
from app.sinks.sink import FrameResult, RunInfo
from encoder.driver import DrivenFrame
from sensors.types import FPS, NS, Clock, SensorFrame

if TYPE_CHECKING:
    from app.stages import Stages
    from app.web.sink import WebSink

CROWD, CROWD_S = 50, 60.0  # clients, s
SPELL_S = 5  # of the crowd, and without it
PAGE_S, PAGE_START_S = 10.0, 15.0  # measured, and allowed for a browser to start
SCHEMES = ("vmc", "vrchat", "livelink")


def measure_web(session: Path, avatar: str, minutes: float) -> dict[str, Any]:
    """Send for `minutes`, show a page, and stand a crowd; the report holds metrics and bars."""
    from sensors.clock import MonotonicClock

    clock = MonotonicClock()
    driven = list(_driven(session))
    sending = _send(clock, driven, avatar, minutes * 60)
    page = _show(clock, driven, avatar)
    crowd = _stand(clock, avatar)
    bars = [at_most(f"{s}_p99_ms", sending[f"{s}_p99_ms"], 1.5) for s in SCHEMES]
    bars += [at_most(f"{s}_lost_ticks", sending[f"{s}_lost_ticks"], 0) for s in (*SCHEMES, "json")]
    if page:
        bars.append(at_least("page_updates_hz", page["page_updates_hz"], 25.0))
    bars += [
        at_most("crowd_tick_p99_change", crowd["crowd_tick_p99_change"], 0.10),
        at_most("crowd_memory_growth_mb", crowd["crowd_memory_growth_mb"], 16.0),
    ]
    return {"avatar": avatar, "metrics": sending | page | crowd, "bars": bars}


def _driven(session: Path) -> Iterator[DrivenFrame]:
    """The session's codes, as fast as they can be had."""
    from encoder.inference import load_driver
    from sensors.recording import Recording
    from sensors.session import replay_frames

    driver = load_driver()
    state = driver.init_state(0)
    with Recording(session) as recording:
        for frame in replay_frames(recording):
            driven, state = driver.step(frame, state)
            yield driven


def _play(clock: Clock, driven: list[DrivenFrame], sinks: list[Any], seconds: float) -> int:
    """Give the codes to the sinks at 30 a second, over and over; return how many ticks it took."""
    for sink in sinks:
        sink.on_start(RunInfo(512, 512, None))
    silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
    start_ns, count = clock.now_ns(), int(seconds * FPS)
    for index, frame in enumerate(islice(cycle(driven), count)):
        t_ns = (index + 1) * NS // FPS
        clock.sleep_until_ns(start_ns + t_ns)
        heard = SensorFrame(index, t_ns, silence, None, np.zeros(2, bool), ages, False)
        for sink in sinks:
            sink.on_frame(FrameResult(heard, replace(frame, index=index, t_ns=t_ns), None))
    clock.sleep_until_ns(clock.now_ns() + NS // 2)
    for sink in sinks:
        sink.close()
    return count


def _send(clock: Clock, driven: list[DrivenFrame], avatar: str, seconds: float) -> dict[str, Any]:
    from app.sinks.face import FaceReader
    from app.sinks.send import SendSink, Target
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from render.decoder import Decoder

    reader = FaceReader(Decoder.load())
    peers = subprocess.Popen(
        [sys.executable, "-m", "app.bench_peers"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert peers.stdin and peers.stdout
    ports = json.loads(peers.stdout.readline())
    urls = [f"{scheme}://127.0.0.1:{port}" for scheme, port in zip(SCHEMES, ports, strict=True)]
    parts = [len(Target(url).encode(reader(driven[0]))) for url in urls]
    sender = SendSink(urls, reader)
    server = WebSink(ServerInfo("127.0.0.1", 0, avatar, page=False), clock)
    ticks = _play(clock, driven, [sender, server, Tell(server, peers.stdin)], seconds)
    told, _ = peers.communicate("end\n")
    heard, report = json.loads(told), sender.report()
    metrics: dict[str, Any] = {"sent_ticks": ticks}
    for scheme, url, num, count in zip(SCHEMES, urls, parts, heard["datagrams"], strict=True):
        metrics[f"{scheme}_lost_ticks"] = ticks - count / num
        for cost in ("p50_ms", "p99_ms", "cpu_ms"):
            metrics[f"{scheme}_{cost}"] = report[url][cost]
    # From the first tick that the program saw: it connects while the run has begun.
    metrics["json_lost_ticks"] = ticks - heard["first"] - heard["frames"]
    return metrics


class Tell:
    """A sink that gives a process the server's address as soon as there is one."""

    def __init__(self, server: "WebSink", to: IO[str]) -> None:
        self._server, self._to = server, to

    def on_start(self, info: RunInfo) -> None:
        self._to.write(self._server.link.status["addresses"][0] + "\n")
        self._to.flush()

    def on_frame(self, result: FrameResult) -> None: ...
    def close(self) -> None: ...


def _show(clock: Clock, driven: list[DrivenFrame], avatar: str) -> dict[str, Any]:
    """Updates a second that a page in headless Chromium gets while it draws them."""
    from app.web.info import ServerInfo
    from app.web.sink import WebSink

    if find_spec("playwright") is None:
        print("page: playwright is not installed, left out; run: pip install livedrive[dev]")
        return {}
    server = WebSink(ServerInfo("127.0.0.1", 0, avatar), clock)
    words = [sys.executable, "-m", "app.bench_page", str(PAGE_S)]
    page = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert page.stdin and page.stdout

    _play(clock, driven, [server, Tell(server, page.stdin)], PAGE_S + PAGE_START_S)
    told = page.stdout.read()
    page.wait()
    return json.loads(told) if told else {"page_updates_hz": 0.0}


def _stand(clock: Clock, avatar: str) -> dict[str, Any]:
    """The tick beside a server that a crowd besets, and beside the same one left alone, in turn.

    A machine's speed changes within minutes, so the two take turns of SPELL_S. The first second of
    each turn counts for neither: clients come and go then.
    """
    watch = _drive(clock, avatar)
    second = watch.frames // FPS
    counts, beset = second % SPELL_S > 0, second // SPELL_S % 2 == 1
    quiet_ms, crowd_ms = (watch.ticks_ms[counts & side] for side in (~beset, beset))
    quiet_p99, crowd_p99 = (float(np.percentile(ticks, 99)) for ticks in (quiet_ms, crowd_ms))
    seconds = np.arange(len(watch.cpu_s) - 1)
    shares, besets = np.diff(watch.cpu_s), seconds // SPELL_S % 2 == 1
    half = len(watch.memory_mb) // 2
    growth = max(watch.memory_mb[half:]) - max(watch.memory_mb[:half])
    return {
        "quiet_tick_p50_ms": round(float(np.median(quiet_ms)), 3),
        "crowd_tick_p50_ms": round(float(np.median(crowd_ms)), 3),
        "quiet_tick_p99_ms": round(quiet_p99, 3),
        "crowd_tick_p99_ms": round(crowd_p99, 3),
        "crowd_tick_p99_change": round(crowd_p99 / quiet_p99 - 1, 3),
        "crowd_memory_growth_mb": round(growth, 2),
        "quiet_server_cpu_share": round(float(shares[~besets & (seconds > 0)].mean()), 3),
        "crowd_server_cpu_share": round(float(shares[besets].mean()), 3),
        "crowd_refused": watch.refused,
    }


class Watch:
    """A sink that lets the crowd loose every other spell, and notes ticks and the server's cost."""

    def __init__(self, server: "WebSink", stages: "Stages") -> None:
        self._server, self._stages = server, stages
        self._crowd: subprocess.Popen[str] | None = None
        self._frames: list[int] = []  # the newest of each tick
        self._ticks_ms: list[float] = []  # of the tick before each
        self.memory_mb: list[float] = []  # of the server, every second
        self.cpu_s: list[float] = []
        self.refused = 0

    @property
    def frames(self) -> NDArray[np.int64]:  # [T] the newest frame of each tick
        return np.array(self._frames[:-1])

    @property
    def ticks_ms(self) -> NDArray[np.float64]:  # [T]
        return np.array(self._ticks_ms[1:])

    def on_start(self, info: RunInfo) -> None:
        address = self._server.link.status["addresses"][0]
        words = [sys.executable, "-m", "app.bench_crowd", address, str(CROWD), str(SPELL_S)]
        self._crowd = subprocess.Popen(words, stdin=subprocess.PIPE, text=True)

    def on_frame(self, result: FrameResult) -> None:
        import psutil

        index = result.driven.index
        if result.picture is not None:
            self._frames.append(index)
            self._ticks_ms.append(self._stages.latest_ms()[-1])  # this one has not ended
        if index % FPS == 0:
            process = psutil.Process(self._server.pid)
            self.memory_mb.append(process.memory_info().rss / 2**20)
            used = process.cpu_times()
            self.cpu_s.append(used.user + used.system)
        if index % (2 * SPELL_S * FPS) == SPELL_S * FPS and self._crowd and self._crowd.stdin:
            self._crowd.stdin.write("now\n")
            self._crowd.stdin.flush()

    def close(self) -> None:
        self.refused = self._server.report()["page"]["refused"]
        if self._crowd:
            self._crowd.terminate()
            self._crowd.wait()


def _drive(clock: Clock, avatar: str) -> Watch:
    """The whole tick on silence, with pictures, for as long without the crowd as with it."""
    from app.loop import Head, drive
    from app.stages import Stages
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from encoder.inference import load_driver
    from render import cameras, identity
    from render.decoder import Decoder
    from render.renderer import create_renderer
    from sensors.live import LiveSource

    server, stages = WebSink(ServerInfo("127.0.0.1", 0, avatar), clock), Stages()
    watch = Watch(server, stages)
    renderer, camera = create_renderer(), cameras.portrait(512, 512)
    head = Head(Decoder.load(), identity.load(avatar), renderer, camera)
    source, info = LiveSource(None, [], clock, seconds=2 * CROWD_S), RunInfo(512, 512, None)
    drive(source, load_driver(), head, [server, watch], clock, stages, info, 0, True)
    renderer.close()
    return watch
