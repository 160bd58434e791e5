"""WebSink: the loop's end of the web server.

Why the server is a process and not a thread: it decodes, packs and sends up to 800 kB for every
tick and talks to whoever connects. In a process of its own, at a lower priority, nothing that a
client does can take Python's lock from the tick. What crosses is a tick of one kilobyte.
"""

import subprocess
import sys
from typing import Any

from app.drive.sink import FrameResult, RunInfo
from app.process import child
from app.process.channel import pair
from app.terminal import qr
from app.web.info import ServerInfo
from app.web.link import ServerLink
from sensors.types import NS, Clock, InputError

START_S, END_S = 60, 10  # patience with a server that starts, or ends


class WebSink:
    """Serves the driven head; its `link` also carries the page's microphone."""

    def __init__(self, info: ServerInfo, clock: Clock) -> None:
        """Starts the server; `on_start` waits for it."""
        ours, theirs = pair()
        self.link = ServerLink(ours)
        self._info, self._clock, self._told = info, clock, False
        memories = [info.seats] if info.seats else []
        self._process = child.start("app.web", info, memories, theirs)
        theirs.close()

    @property
    def pid(self) -> int:
        """Of the server's process."""
        return self._process.pid

    def on_start(self, info: RunInfo) -> None:
        start_ns = self._clock.now_ns()
        while "addresses" not in self.link.status:
            self.link.read()
            if self.link.status.get("error") or self.link.ended:
                raise InputError(self.link.status.get("error") or "web: the server did not start")
            if self._clock.now_ns() > start_ns + START_S * NS:
                raise InputError(f"web: expected a server within {START_S} s, got none; try again")
            self._clock.sleep_until_ns(self._clock.now_ns() + NS // 100)
        for address in self.link.status["addresses"]:
            print(f"{self._info.what} at {address}", flush=True)
            if self._info.page and not self._info.is_local:
                qr.show(address)

    def on_frame(self, result: FrameResult) -> None:
        self.link.read()
        self.link.post(result.driven)
        if self.link.ended and not self._told:
            self._told = True
            print("livedrive: the web server has ended; driving goes on", file=sys.stderr)

    def close(self) -> None:
        self.link.finish()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self.link.read()
        self.link.close()

    def network_report(self) -> dict[str, Any]:
        """{"page" or "json": what the server counted, and the ticks it was too slow for}."""
        status = {k: v for k, v in self.link.status.items() if k != "addresses"}
        return {"page" if self._info.page else "json": status | {"dropped": self.link.dropped}}
