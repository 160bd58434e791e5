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

from app.bars import at_least, at_most
from app.sinks.sink import FrameResult, RunInfo
from encoder.driver import DrivenFrame
from sensors.types import FPS, NS, Clock, SensorFrame

if TYPE_CHECKING:
    from app.web.sink import WebSink

CROWD, CROWD_S = 50, 60.0  # clients, s
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
    """The tick beside a quiet server, and beside one that a crowd besets."""
    quiet, beset = _drive(clock, avatar, 0), _drive(clock, avatar, CROWD)
    return {
        "quiet_tick_p99_ms": quiet["p99_ms"],
        "crowd_tick_p99_ms": beset["p99_ms"],
        "crowd_tick_p99_change": round(beset["p99_ms"] / quiet["p99_ms"] - 1, 3),
        "crowd_memory_growth_mb": beset["growth_mb"],
        "quiet_server_cpu_share": quiet["cpu_share"],
        "crowd_server_cpu_share": beset["cpu_share"],
        "crowd_refused": beset["refused"],
    }


class Watch:
    """A sink that lets the crowd loose with the first tick and weighs the server every second."""

    def __init__(self, server: "WebSink", num: int) -> None:
        self._server, self._num = server, num
        self._crowd: subprocess.Popen[bytes] | None = None
        self.memory_mb: list[float] = []
        self.cpu_share = 0.0  # of one core, that the server took

    def on_start(self, info: RunInfo) -> None:
        address = self._server.link.status["addresses"][0]
        words = [sys.executable, "-m", "app.bench_crowd", address, str(self._num), str(CROWD_S)]
        self._crowd = subprocess.Popen(words) if self._num else None

    def on_frame(self, result: FrameResult) -> None:
        import psutil

        if result.driven.index % FPS == 0:
            process = psutil.Process(self._server.pid)
            self.memory_mb.append(process.memory_info().rss / 2**20)
            used = process.cpu_times()
            self.cpu_share = (used.user + used.system) * FPS / (result.driven.index + 1)

    def close(self) -> None:
        if self._crowd:
            self._crowd.terminate()
            self._crowd.wait()


def _drive(clock: Clock, avatar: str, crowd: int) -> dict[str, Any]:
    """The whole tick on silence, with pictures, for a minute."""
    from app.loop import Head, drive
    from app.stages import Stages
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from encoder.inference import load_driver
    from render import cameras, identity
    from render.decoder import Decoder
    from render.renderer import create_renderer
    from sensors.live import LiveSource

    server = WebSink(ServerInfo("127.0.0.1", 0, avatar), clock)
    watch, stages = Watch(server, crowd), Stages()
    renderer, camera = create_renderer(), cameras.portrait(512, 512)
    head = Head(Decoder.load(), identity.load(avatar), renderer, camera)
    source, info = LiveSource(None, [], clock, seconds=CROWD_S), RunInfo(512, 512, None)
    drive(source, load_driver(), head, [server, watch], clock, stages, info, 0, True)
    renderer.close()
    half = len(watch.memory_mb) // 2
    growth = np.max(watch.memory_mb[half:]) - np.max(watch.memory_mb[:half])
    return {
        "p99_ms": stages.summary()["tick"]["p99_ms"],
        "growth_mb": round(float(growth), 2),
        "cpu_share": round(watch.cpu_share, 3),  # its start, about 1 s of CPU, included
        "refused": server.report()["page"]["refused"],
    }
