"""`livedrive call host | join | server | bridge | test`: people meet as driven heads."""

import getpass
import socket
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, subcommand

from app.commands.live import LiveDriveOptions, ends_on_signals
from app.commands.meet import keys
from app.commands.meet.server import Bridge, Server, Test
from app.compose.settings import SoundSettings, Switch
from app.terminal.arguments import File, Listening, optional
from sensors import files
from sensors.types import InputError

if TYPE_CHECKING:
    from app.call.live.protocol import CallSettings


@dataclass(kw_only=True)
class CallOptions(LiveDriveOptions):
    """What both ends of a call share: all of `livedrive run`, and the call itself."""

    name: str = ""
    """Name that the others see; default: your user name."""
    speaker: Annotated[str | None, optional("NAME|none|web")] = None
    """Where you hear the others; web: at the page of --web; default: the system's output."""
    echo: Switch = "auto"
    """Cancel the loudspeaker's echo; auto: unless you wear headphones."""
    noise: Switch = "auto"
    """Suppress noise in the microphone; auto: as for --echo."""
    accept: bool = False
    """Accept whoever has the invite without asking you."""
    ice: Annotated[tuple[str, ...], tyro.conf.arg(metavar="URL ...")] = ()
    """STUN or TURN servers for when no direct line is possible: stun:HOST:PORT or
    turn:NAME:PASSWORD@HOST:PORT."""
    offer_avatar: bool = False
    """Offer your avatar's file (1 MB at most) to the others, who may accept it."""
    record: File = None
    """Record this end into this folder once everybody has agreed."""

    def settings_of_call(self) -> "CallSettings":
        raise NotImplementedError

    def name_of_own(self) -> str:
        """Raises InputError where the others' ends would cut it."""
        from app.call.wire.agreement import MAX_NAME

        if len(self.name) > MAX_NAME or not self.name.isprintable():
            raise InputError(
                f"--name: expected {MAX_NAME} characters at most that can be shown, got "
                f"{self.name[:MAX_NAME]!r} of {len(self.name)}; try --name Ann"
            )
        try:
            return self.name or getpass.getuser()[:MAX_NAME]
        except (ImportError, KeyError, OSError):  # a container's user without a name
            return "somebody"

    def file_of_avatar(self) -> str:
        """Empty unless it is offered."""
        from render.decoder.learned import avatar_files

        return str(avatar_files.path_of(self.avatar).resolve()) if self.offer_avatar else ""

    def run(self) -> None:
        from app.call.wire import ice

        for url in self.ice:
            ice.parse(url)
        if self.record:
            files.check_folder(self.record.parent, "--record", "choose another")
        settings = self.live_drive_settings("call", web_sound=self.speaker == "web", in_call=True)
        from app.call.live.tape import CallTape
        from app.compose.call import open_call, through_call, with_call
        from app.compose.live import tell
        from app.compose.live_run import LiveRun
        from app.compose.report import finish
        from app.drive.loop import drive
        from app.sinks.sensor_notes import SensorNotes

        link = open_call(replace(self.settings_of_call(), tells=not settings.window))
        try:
            run = LiveRun(self.live_settings(), settings, link.seats)
            sound = SoundSettings(echo=self.echo, noise=self.noise)
            through_call(run.source, link, sound, self.speaker)
            run.hear_at_page(link)
            tape = CallTape(link, self.record, run.open_recorder)
            with ends_on_signals(run.source) as signals:
                parts = run.build(tape, [SensorNotes(run.source, tell)], [link])
                invite = link.start(run.clock)  # now that all else that was asked for is there
                typed = None if settings.window else tape
                print(f"{self.opening(invite)}; {keys.keys(typed)}", flush=True)
                keys.listen(link, typed, run.source.stop, tell, self.accept)
                try:
                    summary = drive(with_call(parts, link))
                finally:
                    tape.close()
        finally:
            link.close()
        values = run.report(parts, summary) | {"call": link.report}
        values["recording"] = tape.problem or ("complete" if tape.sessions else "none")
        finish(values, self.report, settings.files.written)
        for session in tape.sessions:
            print(f"wrote {session.resolve()}; next: livedrive replay {quote(str(session))}")
        if link.error:
            raise InputError(link.error)
        if signals:
            raise KeyboardInterrupt

    def opening(self, invite: str) -> str:
        """What to know before the first frame."""
        raise NotImplementedError


@dataclass(kw_only=True)
class Host(CallOptions):
    """Open a call and print its invite."""

    port: Listening = 0
    """Port to listen on; 0: any free one."""
    address: str = ""
    """Address under which others reach this machine; default: found automatically."""
    room: str = ""
    """Open a room of 2 to 8 people on a Janus server."""
    server: str = ""
    """The Janus server: ws://HOST:PORT or wss://HOST:PORT."""
    key: File = None
    """File with the server's key, as `livedrive call server` wrote it."""

    def settings_of_call(self) -> "CallSettings":
        from app.call.live.protocol import CallSettings
        from app.call.rooms.janus_server import read_key

        if bool(self.room) != bool(self.server):
            raise InputError("call host: expected --room and --server together, got one of them")
        if self.address:
            _check_address(self.address)
        return CallSettings(
            name=self.name_of_own(),
            avatar=Path(self.avatar).stem,  # no path of this machine leaves it
            avatar_file=self.file_of_avatar(),
            room=self.room,
            server=self.server,
            server_key=read_key(self.key) if self.key else "",
            port=self.port,
            address=self.address,
            speaker=self.speaker,
            accept=self.accept,
            ice_servers=self.ice,
        )

    def opening(self, invite: str) -> str:
        send = "send it to the people you want to meet, by a way that you trust"
        return f"invite: {invite}\n{send}"


@dataclass(kw_only=True)
class Join(CallOptions):
    """Join a call."""

    invite: Positional[str]
    """The invite that `livedrive call host` printed; -: it is read from the terminal, where no
    other user of this machine sees it in the list of processes."""

    def settings_of_call(self) -> "CallSettings":
        from app.call.live.protocol import CallSettings
        from app.call.wire.invite import parse

        invite = sys.stdin.readline().strip() if self.invite == "-" else self.invite
        parse(invite)
        return CallSettings(
            name=self.name_of_own(),
            avatar=Path(self.avatar).stem,  # no path of this machine leaves it
            avatar_file=self.file_of_avatar(),
            invite=invite,
            speaker=self.speaker,
            accept=self.accept,
            ice_servers=self.ice,
        )

    def opening(self, invite: str) -> str:  # noqa: ARG002
        return "joining"


def _check_address(address: str) -> None:
    """Whoever gets the invite must be able to find it."""
    try:
        socket.getaddrinfo(address.strip("[]"), None)
    except (OSError, UnicodeError) as error:
        raise InputError(
            f"--address: expected an address of this machine, got {address!r} "
            f"({getattr(error, 'strerror', None) or error}); leave it away to have one found"
        ) from None


@dataclass(kw_only=True)
class Call:
    """Video calls with driven heads: host | join | server | bridge | test."""

    command: tyro.conf.OmitSubcommandPrefixes[
        Annotated[Host, subcommand("host")]
        | Annotated[Join, subcommand("join")]
        | Annotated[Server, subcommand("server")]
        | Annotated[Bridge, subcommand("bridge")]
        | Annotated[Test, subcommand("test")]
    ]

    def run(self) -> None:
        self.command.run()
