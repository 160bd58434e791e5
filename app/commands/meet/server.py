"""`livedrive call server | bridge | test`: what a call needs beside people."""

import re
import signal
import socket
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote

from tyro.conf import Positional

from app.terminal import confirm, outputs
from app.terminal.arguments import File, Listening
from sensors import files
from sensors.listening import cannot_listen
from sensors.types import LOOPBACK, InputError

LEAST_S, MOST_S = 5, 3600  # of a call that is measured: in less, lips may not be judged at all


@dataclass(kw_only=True)
class Server:
    """Run a Janus server for rooms until Ctrl-C; Janus is to be installed separately."""

    folder: Positional[Path]
    """Folder for its configuration, key and log; created if missing."""
    host: str = LOOPBACK
    """Address to listen on; other than on this machine alone it uses TLS."""
    port: Listening = 8188
    """Port to listen on."""
    address: str = ""
    """Public address, if a router forwards one to this machine."""
    media: str = "20000-20400"
    """UDP ports for sound and motion."""

    def run(self) -> None:
        import secrets

        from app.call.rooms.janus_server import ServerSettings, read_key, start
        from app.call.rooms.listen import write_certificate
        from app.call.wire.invite import in_url

        _check_range(self.media)
        host = self.host.strip("[]")  # an address of IPv6 may be given as a URL has it
        _check_free(host, self.port)
        self.folder.mkdir(parents=True, exist_ok=True)
        key, pem = self.folder / "key", None
        if not key.exists():
            files.write_text(key, secrets.token_hex(16) + "\n", private=True)
        fragment, scheme = "", "ws"
        if host != LOOPBACK:
            pem = self.folder / "certificate.pem"
            fragment, scheme = f"#{write_certificate(pem).hex()}", "wss"
        settings = ServerSettings(
            key=read_key(key),
            host=host,
            port=self.port,
            public_address=self.address,
            ports=self.media,
            certificate=pem,
        )
        process = start(self.folder, settings)
        shown = in_url(self.address or host)
        print(f"next: livedrive call host --room NAME --key {quote(str(key))} \\", flush=True)
        print(f"  --server '{scheme}://{shown}:{self.port}{fragment}'", flush=True)

        signals = list[int]()

        def stop(number: int, frame: object) -> None:  # noqa: ARG001
            signals.append(number)
            process.terminate()

        signal.signal(signal.SIGTERM, stop)
        try:
            status = process.wait()
        finally:
            process.kill()
        if signals:
            raise KeyboardInterrupt
        raise OSError(f"call server: Janus ended with status {status}; see {self.folder}/janus.log")


def _check_free(host: str, port: int) -> None:
    """Janus goes on without a port that it cannot get."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.create_server((host, port), family=family).close()
    except (OSError, TypeError) as error:  # TypeError: a name that no address can have
        raise cannot_listen("call server", host, port, error, "--port") from None


def _check_range(ports: str) -> None:
    """Janus takes other ones without a word, and no sound arrives."""
    found = re.fullmatch(r"(\d{1,5})-(\d{1,5})", ports)
    if found is None or not 0 < int(found[1]) < int(found[2]) < 65536:
        raise InputError(
            f"--media: expected LOW-HIGH of ports in 1..65535, got {ports!r}; "
            "try --media 20000-20400"
        )


@dataclass(kw_only=True)
class Bridge:
    """Let a room span a second Janus server until Ctrl-C; print the invite that leads there."""

    invite: Positional[str]
    """The invite to the room, as `livedrive call host` printed it."""
    key: Path
    """File with the key of the invite's server."""
    to: str
    """The second server: wss://HOST:PORT#FINGERPRINT, as `livedrive call server` printed it."""
    to_key: Path
    """File with the second server's key."""

    def run(self) -> None:
        import asyncio

        from app.call.rooms import bridge
        from app.call.rooms.janus_server import read_key, room_invite
        from app.call.wire.invite import parse

        first = parse(self.invite)
        keys = [read_key(key) for key in (self.key, self.to_key)]
        if first.kind != "room":
            raise InputError(
                "call bridge: expected an invite to a room, got one of two people; "
                "see livedrive call host --room"
            )
        second = room_invite(self.to, first.room, first.secret, keys[1], _date_s())
        ends = [
            bridge.ServerAccess(invite=i, key=k) for i, k in zip((first, second), keys, strict=True)
        ]

        def tell(line: str) -> None:
            print(line, flush=True)

        async def run() -> None:
            task = asyncio.current_task()
            if task is not None and sys.platform != "win32":
                asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
            tell(f"invite through the second server: {second}")
            await bridge.Bridge((ends[0], ends[1]), tell, _date_s).run()

        try:
            asyncio.run(run())
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None


def _date_s() -> int:
    return int(datetime.now(UTC).timestamp())


@dataclass(kw_only=True)
class Test:
    """Measure calls on this machine: two ends over four lossy lines, or several in a room."""

    session: Path = Path("recordings/demo")
    """Session that both ends say and show."""
    seconds: float = 20.0
    """Length of each call."""
    lines: tuple[int, ...] = (0, 1, 2, 3)
    """Lines to try: 0 clean, 1 with 1 % loss, 2 with 5 %, 3 with loss in bursts."""
    room: int = 0
    """Instead: so many people in a room whose Janus server is restarted, one with 5 % loss."""
    report: File = None
    """Write the metrics as JSON."""

    def run(self) -> None:
        from app.call.trial.meeting import RoomSettings, metrics_of, run_room
        from app.call.wire.agreement import MAX_PEOPLE
        from app.compose.call import session_material, trial_report
        from app.terminal.thresholds import finish

        outputs.check("--report", self.report, outputs.REPORTS)
        confirm.overwriting([self.report])
        if not self.lines or sorted({*self.lines} & {0, 1, 2, 3}) != sorted(self.lines):
            got = " ".join(map(str, self.lines)) or "none"
            raise InputError(f"--lines: expected numbers in 0..3, each once, got {got}; try 0 1")
        if not LEAST_S <= self.seconds <= MOST_S:
            raise InputError(
                f"--seconds: expected {LEAST_S} to {MOST_S}, got {self.seconds:g}; try --seconds 20"
            )
        if self.room and not 2 <= self.room <= MAX_PEOPLE:
            raise InputError(f"--room: expected 2 to {MAX_PEOPLE} people, got {self.room}")
        if self.room:
            found = run_room(RoomSettings(people=self.room, seconds=self.seconds))
            report = metrics_of(found)
        else:
            report = trial_report(session_material(self.session), self.lines, self.seconds)
        for note in report.get("notes", ()):
            print(note)
        finish(report, self.report)
