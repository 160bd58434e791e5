"""What leaving the machine costs: every protocol, the page, and hostile clients of the server."""

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

from app.bench.network.load import measure_hostile_clients
from app.drive.sink import FrameResult, RunInfo
from app.sinks.progress import ProgressSink
from app.terminal.thresholds import at_least, at_most
from encoder.types import DrivenFrame
from sensors.types import FPS, LOOPBACK, NS, Clock, SensorFrame

if TYPE_CHECKING:
    from app.web.sink import WebSink

PAGE_S, PAGE_START_S = 10.0, 15.0  # measured, and allowed for a browser to start
SCHEMES = ("vmc", "vrchat", "livelink")


def measure_web(session: Path, avatar: str, minutes: float) -> dict[str, Any]:
    """Send for `minutes`, show a page, and serve hostile clients; the report holds metrics and
    thresholds."""
    from tqdm import tqdm

    from sensors.clock import MonotonicClock

    clock = MonotonicClock()
    driven = list(tqdm(_driven(session), unit="frame", desc="driving", disable=None))
    sending = _send(clock, driven, avatar, minutes * 60)
    page = _show(clock, driven, avatar)
    hostile = measure_hostile_clients(clock, avatar)
    thresholds = [at_most(f"{s}_p99_ms", sending[f"{s}_p99_ms"], 1.5) for s in SCHEMES]
    thresholds += [
        at_most(f"{s}_lost_ticks", sending[f"{s}_lost_ticks"], 0) for s in (*SCHEMES, "json")
    ]
    if page:
        thresholds.append(at_least("page_updates_hz", page["page_updates_hz"], 25.0))
    thresholds += [
        at_most("hostile_tick_p99_change", hostile["hostile_tick_p99_change"], 0.10),
        at_most("hostile_memory_growth_mb", hostile["hostile_memory_growth_mb"], 16.0),
        at_most("hostile_clients_died", hostile["hostile_clients_died"], 0),
    ]
    return {"avatar": avatar, "metrics": sending | page | hostile, "bars": thresholds}


def _driven(session: Path) -> Iterator[DrivenFrame]:
    """The session's codes, as fast as they can be had."""
    from encoder.inference import load_driver
    from sensors.session.files import replay_frames
    from sensors.session.recording import Recording

    driver = load_driver()
    state = driver.init_state(0)
    with Recording(session) as recording:
        for frame in replay_frames(recording):
            driven, state = driver.step(frame, state)
            yield driven


def _play(
    clock: Clock, driven: list[DrivenFrame], sinks: list[Any], seconds: float, what: str
) -> int:
    """Give the codes to the sinks at 30 a second, over and over; return how many ticks it took.
    `what` is done, as a progress bar says."""
    count = int(seconds * FPS)
    sinks = [*sinks, ProgressSink(what)]
    for sink in sinks:
        sink.on_start(RunInfo(512, 512, count))
    silence, ages = np.zeros(1600, np.float32), np.full(2, -1, np.int64)
    start_ns = clock.now_ns()
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
    from app.sinks.protocols.face import FaceReader
    from app.sinks.protocols.send import SendSink
    from app.sinks.table import Outlet, open_all
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from render.decoder.decoder import Decoder

    decoder = Decoder.load()
    reader = FaceReader(decoder)
    receivers = subprocess.Popen(
        [sys.executable, "-m", "app.bench.network.receivers"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert receivers.stdin and receivers.stdout
    ports = json.loads(receivers.stdout.readline())
    urls = [f"{scheme}://127.0.0.1:{port}" for scheme, port in zip(SCHEMES, ports, strict=True)]
    (sender,) = open_all(urls, Outlet(decoder, avatar, clock))
    assert isinstance(sender, SendSink)
    face = reader(driven[0])
    parts = [len(receiver.encode(face)) for receiver in sender.receivers if receiver.encode]
    server = WebSink(ServerInfo(LOOPBACK, 0, avatar, page=False), clock)
    sinks = [sender, server, AddressPipe(server, receivers.stdin)]
    ticks = _play(clock, driven, sinks, seconds, "sending")
    output, _ = receivers.communicate("end\n")
    heard, report = json.loads(output), sender.network_report()
    metrics: dict[str, Any] = {"sent_ticks": ticks}
    for scheme, url, num, count in zip(SCHEMES, urls, parts, heard["datagrams"], strict=True):
        metrics[f"{scheme}_lost_ticks"] = ticks - count / num
        for cost in ("p50_ms", "p99_ms", "cpu_ms"):
            metrics[f"{scheme}_{cost}"] = report[url][cost]
    # From the first tick that the program saw: it connects while the run has begun.
    metrics["json_lost_ticks"] = ticks - heard["first"] - heard["frames"]
    return metrics


class AddressPipe:
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
    server = WebSink(ServerInfo(LOOPBACK, 0, avatar), clock)
    words = [sys.executable, "-m", "app.bench.network.page", str(PAGE_S)]
    page = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert page.stdin and page.stdout

    sinks = [server, AddressPipe(server, page.stdin)]
    _play(clock, driven, sinks, PAGE_S + PAGE_START_S, "showing a page")
    output = page.stdout.read()
    page.wait()
    return json.loads(output) if output else {"page_updates_hz": 0.0}
