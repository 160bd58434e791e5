"""`livedrive call host | join | server | test`: people meet as driven heads."""

import getpass
import sys
import threading
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional, subcommand

from app.commands.live import LiveOptions, ends_on_signals
from app.commands.meet.server import Server, Test
from app.commands.options import DriveOptions
from app.compose.call import SoundSettings, Switch
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from app.call.live.link import CallLink
    from app.call.live.protocol import CallSettings

KEYS = "y accepts, m mutes, e mutes the eyes, r agrees to be recorded, q leaves; then Enter"


@dataclass(kw_only=True)
class CallOptions(LiveOptions, DriveOptions):
    """What both ends of a call share: all of `livedrive run`, and the call itself."""

    name: str = ""
    """What others see; default: the user's name here."""
    speaker: Annotated[str | None, tyro.conf.arg(metavar="NAME|none")] = None
    """Where the others are heard; default: the system's output."""
    echo: Switch = "auto"
    """Cancel the echo of the loudspeaker; auto: unless it is worn."""
    noise: Switch = "auto"
    """Take noise out of the microphone; auto: as with the echo."""
    accept: bool = False
    """Accept who holds the invite without being asked."""
    ice: Annotated[tuple[str, ...], tyro.conf.arg(metavar="URL ...")] = ()
    """stun:HOST:PORT or turn:NAME:PASSWORD@HOST:PORT, where a direct line is not to be had."""
    headless: bool = False
    """Open no window."""
    record: Path | None = None
    """Record this end into this folder, once everybody has agreed."""

    def settings_of_call(self) -> "CallSettings":
        raise NotImplementedError

    def run(self) -> None:
        if self.headless and self.window:
            raise InputError("window: expected --headless or --window, got both; give one")
        self.window = not self.headless
        from app.call.live.tape import CallTape
        from app.compose.build import build, load_driver
        from app.compose.call import open_call, through_call, with_call
        from app.compose.live import live_source, open_page, open_recorder, tell
        from app.compose.report import finish, report, sensor_report
        from app.drive.calibration import in_session, of_user
        from app.drive.loop import drive
        from app.sinks.live_stats import LiveStats
        from app.sinks.sensor_notes import SensorNotes
        from sensors.audio.portaudio import silence_native_messages
        from sensors.clock import MonotonicClock

        live, clock, stats = self.live_settings(), MonotonicClock(), LiveStats()
        settings = self.settings(
            realtime=True,
            draw=False,
            title="call",
            head=live.head_mode,
            web_microphone=self.mic == "web",
            web_head=self.head in ("auto", "web"),
        )
        link = open_call(self.settings_of_call())
        try:
            self.opened(link, clock)
            page = open_page(settings, clock, link.seats.descriptor)
            source = live_source(live, clock, page)
            through_call(
                source, link, SoundSettings(echo=self.echo, noise=self.noise), self.speaker
            )
            driver = load_driver(settings, bool(source.info.eyes), of_user())
            recorder = partial(open_recorder, source=source, calibration=in_session(driver))
            tape = CallTape(link, self.record, recorder)
            silence_native_messages()
            with ends_on_signals(source) as signals:
                listen_to_keys(link, source.stop)
                parts = build(
                    settings,
                    source=source,
                    driver=driver,
                    clock=clock,
                    sinks=[stats, SensorNotes(source, tell)],
                    tape=tape,
                    page=page,
                    seats=link.seats,
                )
                summary = drive(with_call(parts, link))
                tape.close()
        finally:
            link.close()
        values = report(settings, parts, summary) | stats.report()
        values |= {"sensors": sensor_report(source), "call": link.report}
        finish(values, self.report, settings.files.written)
        for session in tape.sessions:
            print(f"wrote {session.resolve()}; next: livedrive replay {session}")
        if link.error:
            raise InputError(link.error)
        if signals:
            raise KeyboardInterrupt

    def opened(self, link: "CallLink", clock: Any) -> None:
        """What is told before the first frame."""


@dataclass(kw_only=True)
class Host(CallOptions):
    """Open a call and print the invite to it."""

    port: int = 0
    """To listen at; 0: any that is free."""
    address: str = ""
    """Of this machine, as others reach it; default: found out."""
    room: str = ""
    """Open a room of 2 to 8 people on a Janus server."""
    server: str = ""
    """That server: ws://HOST:PORT or wss://HOST:PORT."""
    key: Path | None = None
    """File with the server's key, as `livedrive call server` wrote it."""

    def settings_of_call(self) -> "CallSettings":
        from app.call.live.protocol import CallSettings

        if bool(self.room) != bool(self.server):
            raise InputError("call host: expected --room and --server together, got one of them")
        return CallSettings(
            name=self.name or getpass.getuser(),
            avatar=Path(self.avatar).stem,  # no path of this machine leaves it
            room=self.room,
            server=self.server,
            server_key=files.read_text(self.key).strip() if self.key else "",
            port=self.port,
            address=self.address,
            speaker=self.speaker,
            accept=self.accept,
            ice_servers=self.ice,
        )

    def opened(self, link: "CallLink", clock: Any) -> None:
        print(f"invite: {link.wait_for_invite(clock)}", flush=True)
        print(f"send it to the people you want to meet, by a way that you trust; {KEYS}")


@dataclass(kw_only=True)
class Join(CallOptions):
    """Take part in a call."""

    invite: Positional[str]
    """As `livedrive call host` printed it."""

    def settings_of_call(self) -> "CallSettings":
        from app.call.live.protocol import CallSettings
        from app.call.wire.invite import parse

        parse(self.invite)
        return CallSettings(
            name=self.name or getpass.getuser(),
            avatar=Path(self.avatar).stem,  # no path of this machine leaves it
            invite=self.invite,
            speaker=self.speaker,
            accept=self.accept,
            ice_servers=self.ice,
        )

    def opened(self, link: "CallLink", clock: Any) -> None:  # noqa: ARG002
        print(f"joining; {KEYS}", flush=True)


def listen_to_keys(link: "CallLink", stop: Any) -> None:
    """Lines of the terminal become consent; a thread, as reading waits."""

    def read() -> None:
        for line in sys.stdin:
            word = line.strip().lower()
            if word in ("y", "yes"):
                link.change(accepted=True)
            elif word == "m":
                link.change(muted=not link.muted)
            elif word == "e":
                link.change(eyes_muted=not link.eyes_muted)
            elif word == "r":
                link.change(may_record=True)
            elif word == "q":
                stop()
                return

    threading.Thread(target=read, name="call keys", daemon=True).start()


@dataclass(kw_only=True)
class Call:
    """Meet other people as driven heads: host | join | server | test."""

    action: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Host, subcommand("host")]
        | Annotated[Join, subcommand("join")]
        | Annotated[Server, subcommand("server")]
        | Annotated[Test, subcommand("test")]
    ]

    def run(self) -> None:
        self.action.run()
