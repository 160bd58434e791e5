"""People in a room of a Janus server that ends and comes back, each in a process of their own.

libnice leaves loopback out, so all of it runs in a network of its own, made with `unshare`.
"""

import asyncio
import json
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from app.call.core.call import Call
from app.call.media.connection import bind_only
from app.call.rooms import janus_server
from app.call.rooms.janus import JanusRoom
from app.call.rooms.janus_server import ServerSettings
from app.call.rooms.listen import write_certificate
from app.call.rooms.room import LineSettings
from app.call.trial.material import synthetic_material
from app.call.trial.meeting import RoomSettings
from app.call.trial.person import PersonSettings
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.invite import Invite
from sensors.types import InputError

HOST = "10.9.9.1"
NETWORK = (
    "ip link set lo up",
    "ip link add v0 type veth peer name v1",
    f"ip addr add {HOST}/24 dev v0",
    "ip link set v0 up",
    "ip link set v1 up",
)
LOSS = 0.05  # of the second person's leg
MEET_S, BACK_S = 90.0, 60.0  # timeout, for a busy machine
LOOK_S = 0.05


class Visitor:
    """The process of one person, and its latest output."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.sees = 0
        self.told: list[str] = []
        self._process = process
        self._reports: asyncio.Queue[list[dict[str, Any]]] = asyncio.Queue()
        self._reader = asyncio.create_task(self._read())

    @property
    def is_here(self) -> bool:
        return self._process.returncode is None

    def order(self, word: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(word.encode() + b"\n")

    async def report(self) -> list[dict[str, Any]]:
        self.order("report")
        return await self._reports.get()

    async def leave(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        await self._process.wait()

    async def _read(self) -> None:
        assert self._process.stdout is not None
        async for line in self._process.stdout:
            said = json.loads(line)
            self.sees = said.get("sees", self.sees)
            if "told" in said:
                self.told.append(said["told"])
            if "report" in said:
                self._reports.put_nowait(said["report"])


async def visit(settings: PersonSettings) -> Visitor:
    pipe, config = asyncio.subprocess.PIPE, json.dumps(asdict(settings))
    command = [sys.executable, "-m", "app.call.trial.person", config]
    return Visitor(await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe))


async def scene(settings: RoomSettings, folder: Path) -> dict[str, Any]:
    """Everybody meets, talks, loses the server and reconnects."""
    pem = folder / "certificate.pem"
    pin = write_certificate(pem).hex()
    at = ServerSettings(key=secrets.token_hex(16), host=HOST, certificate=pem)
    server = janus_server.start(folder, at)
    await _listening(at)
    url, now_s = f"wss://{HOST}:{at.port}#{pin}", int(time.time_ns() // 10**9)
    invite = janus_server.room_invite(url, "choir", secrets.token_bytes(16), at.key, now_s)
    people: list[Visitor] = []
    try:
        for number in range(settings.people):
            key = janus_server.admin_key(at.key) if number == 0 else ""
            loss, name = LOSS if number == 1 else 0.0, f"Person {number}"
            person = PersonSettings(
                name=name, host=HOST, invite=str(invite), admin_key=key, loss=loss
            )
            people.append(await visit(person))
            await asyncio.sleep(1.0 if key else 0.0)  # first comes who makes the room
        met_s = await together(people, MEET_S)
        for person in people:
            person.order("begin")
        share = await watched(people, settings.seconds)
        reports = [await person.report() for person in people]
        refused = await refusals(invite)
        server.kill()
        server.wait()
        while any(person.sees for person in people):
            await asyncio.sleep(LOOK_S)
        server = janus_server.start(folder, at)
        back_s = await together(people, BACK_S)
    except TimeoutError:
        sees = [(person.sees, person.told[-3:]) for person in people]
        raise SystemExit(f"{sees}\n{(folder / 'janus.log').read_text()[-1500:]}") from None
    finally:
        for person in people:
            await person.leave()
        server.kill()
    found = {"met_s": met_s, "together": share, "back_s": back_s}
    return found | {"refused": refused, "reports": reports}


async def while_wanted(settings: RoomSettings, folder: Path) -> dict[str, Any]:
    """The scene, for as long as whoever started it holds our standard input open."""
    loop, task = asyncio.get_running_loop(), asyncio.current_task()
    assert task is not None

    def end() -> None:
        loop.remove_reader(sys.stdin)
        task.cancel()

    loop.add_reader(sys.stdin, end)
    return await scene(settings, folder)


async def together(people: Sequence[Visitor], patience_s: float) -> float:
    """Seconds until everybody sees everybody."""
    start_s = time.monotonic()
    async with asyncio.timeout(patience_s):
        while not _all_see(people):
            if not all(person.is_here for person in people):
                raise TimeoutError
            await asyncio.sleep(LOOK_S)
    return time.monotonic() - start_s


async def watched(people: Sequence[Visitor], seconds: float) -> float:
    """Share of that time in which everybody saw everybody."""
    looks: list[bool] = []
    for _ in range(int(seconds / LOOK_S)):
        looks.append(_all_see(people))
        await asyncio.sleep(LOOK_S)
    return sum(looks) / max(len(looks), 1)


async def refusals(invite: Invite) -> dict[str, str]:
    """The refusals that uninvited visitors get."""
    false = {
        "wrong secret": replace(invite, secret=bytes(16)),
        "no token": replace(invite, token="1,janus,janus.plugin.videoroom:AAAA"),
    }
    bind_only(HOST)
    found: dict[str, str] = {}
    basis = synthetic_material(1, 0).basis
    for name, wrong in false.items():
        hello = Hello(identity=new_identity(), name="Eve", basis=basis.number)
        call = Call(wrong.secret, hello, basis, _nothing, _nothing, time.monotonic_ns)
        room = JanusRoom(wrong, hello.identity, call.events(), LineSettings())
        try:
            await asyncio.wait_for(room.run(), 15)
        except (InputError, TimeoutError) as error:
            found[name] = str(error)
    return found


def _nothing(*_: object) -> None: ...


async def _listening(at: ServerSettings) -> None:
    """Until the server takes connections."""
    async with asyncio.timeout(MEET_S):
        while True:
            try:
                _, writer = await asyncio.open_connection(at.host, at.port)
            except OSError:
                await asyncio.sleep(LOOK_S)
            else:
                writer.close()
                return


def _all_see(people: Sequence[Visitor]) -> bool:
    return all(person.sees == len(people) - 1 for person in people)


if __name__ == "__main__":
    for command in NETWORK:
        subprocess.run(command.split(), check=True)
    with tempfile.TemporaryDirectory() as name:
        wanted = RoomSettings(**json.loads(sys.argv[1]))
        print(json.dumps(asyncio.run(while_wanted(wanted, Path(name)))))
