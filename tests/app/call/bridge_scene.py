"""Two room servers and one person on each, bridged by the command, in a network of their own.

`unshare --net --map-root-user python -m tests.app.call.bridge_scene`; prints what came of it."""

import asyncio
import json
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from app.call.rooms import janus_server
from app.call.rooms.bridge import RoomEnd, ServerAccess, ServerError
from app.call.rooms.janus_server import ServerSettings, admin_key, room_invite
from app.call.rooms.listen import write_certificate
from app.call.trial.person import PersonSettings
from app.call.trial.room import HOST, LOOK_S, NETWORK, Visitor, _listening, together, visit
from app.call.wire.invite import Invite, parse

PATIENCE_S = 90.0
PACKETS = 100
COMMAND = "from app.main import main; main()"


class Server:
    """A Janus process with a folder of its own, and the room's address there."""

    def __init__(self, folder: Path, number: int) -> None:
        folder.mkdir()
        pem, first = folder / "certificate.pem", 20000 + 200 * number
        pin = write_certificate(pem).hex()
        self.folder, self.key = folder, folder / "key"
        self.settings = ServerSettings(
            key=secrets.token_hex(16),
            host=HOST,
            port=8188 + number,
            ports=f"{first}-{first + 199}",
            certificate=pem,
        )
        self.key.write_text(self.settings.key)
        self.url = f"wss://{HOST}:{self.settings.port}#{pin}"

    async def start(self) -> None:
        self.process = janus_server.start(self.folder, self.settings)
        await _listening(self.settings)

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()

    def invite(self, secret: bytes) -> Invite:
        return room_invite(self.url, "choir", secret, self.settings.key, _date_s())

    async def publishers(self, invite: Invite) -> dict[str, dict[str, Any]]:
        async with RoomEnd(ServerAccess(invite=invite, key=self.settings.key), _date_s()) as end:
            return await end.publishers()


class Bridge:
    """The command's process; its lines one by one."""

    async def start(self, one: Server, two: Server, invite: Invite) -> None:
        options = [str(invite), "--key", one.key, "--to", two.url, "--to-key", two.key]
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-c", COMMAND, "call", "bridge", *options),
            stdout=asyncio.subprocess.PIPE,
        )

    async def line(self) -> str:
        assert self._process.stdout is not None
        return (await self._process.stdout.readline()).decode().strip()

    async def end(self) -> int:
        self._process.send_signal(signal.SIGTERM)
        return await self._process.wait()


async def scene(folder: Path) -> dict[str, Any]:
    one, two = Server(folder / "one", 0), Server(folder / "two", 1)
    secret, bridge = secrets.token_bytes(16), Bridge()
    people: list[Visitor] = []
    found: dict[str, Any] = {}
    await one.start()
    await two.start()
    here = one.invite(secret)
    try:
        await bridge.start(one, two, here)
        there = parse((await bridge.line()).partition("server: ")[2])
        found["lines"] = [await bridge.line()]
        for invite in (here, there):
            name = f"Person {invite.port}"
            person = PersonSettings(name=name, host=HOST, invite=str(invite))
            people.append(await visit(person))
        await together(people, PATIENCE_S)
        for person in people:
            person.order("begin")
        found["reports"] = [await _talked(person) for person in people]
        found["stranger"] = await stranger(one, here)
        two.stop()
        found["lines"].append(await bridge.line())
        await two.start()
        found["lines"].append(await bridge.line())
        await together(people, PATIENCE_S)
        await people[1].leave()
        async with asyncio.timeout(PATIENCE_S):
            while people[0].sees or len(await one.publishers(here)) > 1:
                await asyncio.sleep(LOOK_S)
        found["left"] = len(await two.publishers(there))
        found["status"] = await bridge.end()
        found["apart"] = len(await two.publishers(there))
    finally:
        for person in people:
            await person.leave()
        one.stop()
        two.stop()
    return found


async def stranger(server: Server, invite: Invite) -> str:
    """What the server answers who has the invite but not its key."""
    access = ServerAccess(invite=invite, key=server.settings.key)
    async with RoomEnd(access, _date_s()) as end:
        end._admin_key = admin_key("0" * 32)
        number = next(iter(await end.publishers()))
        try:
            to = {"publisher_id": number, "remote_id": "x", "host": HOST, "port": 9}
            await end.ask("publish_remotely", **to)
        except ServerError as error:
            return str(error)
    return ""


async def _talked(person: Visitor) -> list[dict[str, Any]]:
    """The report, once enough has come from the other."""
    async with asyncio.timeout(PATIENCE_S):
        while min((line["packets"] for line in await person.report()), default=0) < PACKETS:
            await asyncio.sleep(LOOK_S)
    return await person.report()


def _date_s() -> int:
    return int(time.time())


if __name__ == "__main__":
    for command in NETWORK:
        subprocess.run(command.split(), check=True)
    with tempfile.TemporaryDirectory() as name:
        sys.stdout.write(json.dumps(asyncio.run(scene(Path(name)))))
