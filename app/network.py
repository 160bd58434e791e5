"""Options of what leaves this machine: the face for other programs, and the page for headsets."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from sensors.types import Clock, InputError

if TYPE_CHECKING:
    from app.sinks.send import SendSink
    from app.web.info import ServerInfo
    from app.web.sink import WebSink
    from render.decoder import Decoder
    from render.types import Density


@dataclass(kw_only=True)
class NetworkOptions:
    """Nothing is sent and no port is opened unless one of these is given."""

    send: Annotated[tuple[str, ...], tyro.conf.arg(metavar="URL ...")] = ()
    """Send the face to programs: vmc://HOST:39539, vrchat://HOST:9000, livelink://HOST:11111 over
    UDP; ws://127.0.0.1:9001 lets programs fetch it there as JSON."""
    gains: Path | None = None
    """JSON of gains and limits for --send: {"jawOpen": {"gain": 1.4, "low": 0, "high": 0.9}}."""
    web: Annotated[int | None, tyro.conf.arg(metavar="PORT")] = None
    """Serve a page with the live head, also for a headset, e.g. --web 8443."""
    host: str = "127.0.0.1"
    """Address for --web; beyond this machine (0.0.0.0: everywhere) it is https with a token."""

    @property
    def is_networked(self) -> bool:
        return bool(self.send) or self.web is not None

    def open_web(
        self, clock: Clock, avatar: str, gaussians: "Density", microphone: bool = False
    ) -> "WebSink | None":
        """Start the page's server, if there is to be one."""
        if self.web is None:
            return None
        if not 0 <= self.web <= 65535:
            raise InputError(f"--web: expected a port in 0..65535, got {self.web}; try --web 8443")
        info = self._info(self.host, self.web, avatar)
        return _server(replace(info, gaussians=gaussians, microphone=microphone), clock)

    def network_sinks(
        self, clock: Clock, decoder: "Decoder", avatar: str, page: "WebSink | None"
    ) -> "list[SendSink | WebSink]":
        """All sinks that `--send` and `--web` ask for; `page` is the server already open."""
        from app.sinks.face import FaceReader
        from app.sinks.send import SendSink, parse

        reader = FaceReader(decoder, self.gains)
        programs = [url for url in self.send if not url.startswith("ws://")]
        sinks: list[SendSink | WebSink] = [SendSink(programs, reader)] if programs else []
        for url in self.send:
            if url not in programs:
                _, host, port, _ = parse(url)
                sinks.append(_server(replace(self._info(host, port, avatar), page=False), clock))
        return [*sinks, page] if page else sinks

    def _info(self, host: str, port: int, avatar: str) -> "ServerInfo":
        from app.web.info import ServerInfo

        gains = str(self.gains.resolve()) if self.gains else None
        return ServerInfo(host, port, avatar, gains=gains)


def _server(info: "ServerInfo", clock: Clock) -> "WebSink":
    from app.web.sink import WebSink

    return WebSink(info, clock)


def network_report(sinks: "list[SendSink | WebSink]") -> dict[str, Any]:
    """{"network": what each sink counted}, or nothing where there is none."""
    counts: dict[str, Any] = {}
    for sink in sinks:
        counts |= sink.report()
    return {"network": counts} if sinks else {}
