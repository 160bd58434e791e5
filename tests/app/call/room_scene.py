"""Run inside a network namespace by test_call_rooms.py: a Janus server and people in a room, each
in a process of their own that prints how many others it sees whenever that changes."""

import asyncio
import json
import os
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

from app.call.core.call import Call, Sight, new_identity
from app.call.core.status import report_of
from app.call.media.connection import bind_only
from app.call.rooms import janus_server
from app.call.rooms.janus import JanusRoom
from app.call.rooms.janus_server import ServerSettings
from app.call.rooms.room import LineSettings
from app.call.trial.material import synthetic_material
from app.call.trial.relay import Leg, LossyLine, open_line
from app.call.wire.agreement import Hello
from app.call.wire.invite import Invite
from app.call.wire.packet import Tick
from sensors.types import InputError

HOST = "10.9.9.1"  # libnice leaves loopback out
MATERIAL = synthetic_material(3, 0)
NETWORK = (
    "ip link set lo up",
    "ip link add v0 type veth peer name v1",
    f"ip addr add {HOST}/24 dev v0",
    "ip link set v0 up",
    "ip link set v1 up",
)


class End:
    def __init__(self, invite: Invite, name: str, line: LineSettings, admin_key: str = "") -> None:
        self.told: list[str] = []
        self.seen: dict[str, int] = {}
        hello = Hello(
            identity=new_identity(), name=name, basis=MATERIAL.basis.number, accepted=True
        )
        self.call = Call(
            invite.secret, hello, MATERIAL.basis, self.told.append, self._show, time.monotonic_ns
        )
        self.room = JanusRoom(invite, hello.identity, self.call.events(), line, admin_key)
        self.call.room = self.room

    def _show(self, sight: Sight, now_ns: int) -> None:
        self.seen[sight.identity] = now_ns

    def sees(self) -> int:
        """How many others, within the last second."""
        since = time.monotonic_ns() - 10**9
        return sum(seen_ns > since for seen_ns in self.seen.values())


async def talk(end: End) -> None:
    """Until the input closes."""
    closed = asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    start_ns, block, told = time.monotonic_ns(), 0, 0
    while not closed.done():
        block += 1
        await asyncio.sleep(max(0, (start_ns + block * 10**7 - time.monotonic_ns()) / 1e9))
        now_ns = time.monotonic_ns()
        end.call.speak(block * 480, MATERIAL.sound[:480], now_ns)
        if block % 3 == 0:
            tick = Tick(block // 3, MATERIAL.expression[block % 60], MATERIAL.gaze[0])
            end.call.tick(tick, now_ns)
        end.call.pull(480, now_ns)
        if block % 10 == 0 and end.sees() != told:
            told = end.sees()
            say({"sees": told})
        if block % 100 == 0:
            end.call.step()


async def take_part(secret: str, token: str, name: str, loss: float, admin_key: str) -> None:
    bind_only(HOST)
    invite = Invite("room", HOST, ServerSettings.port, bytes.fromhex(secret), b"", "choir", token)
    end = End(invite, name, await lossy_leg(loss) if loss else LineSettings(), admin_key)
    room = asyncio.create_task(end.room.run())
    cpu_s, start_s = time.process_time(), time.monotonic()
    await talk(end)
    cpu_share = (time.process_time() - cpu_s) / (time.monotonic() - start_s)
    room.cancel()
    report = report_of(end.call, time.monotonic_ns(), {}, cpu_share)
    say({"report": list(report.values()), "told": end.told})


def say(value: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(value) + "\n")
    sys.stdout.flush()


class Person:
    """One of these processes, and what it last said."""

    def __init__(self, invite: Invite, name: str, loss: float = 0.0, admin_key: str = "") -> None:
        words = [invite.secret.hex(), invite.token, name, str(loss), admin_key]
        self.sees, self.last = 0, {}
        self._process = subprocess.Popen(
            [sys.executable, __file__, "end", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def leave(self) -> None:
        assert self._process.stdin
        self._process.stdin.close()
        self._reader.join()

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self.last = json.loads(line)
            self.sees = self.last.get("sees", self.sees)


def all_together(people: list[Person], patience_s: float) -> float:
    """Seconds until everybody sees everybody."""
    start = time.monotonic()
    while not all(person.sees == len(people) - 1 for person in people):
        if time.monotonic() - start > patience_s:
            raise TimeoutError([person.sees for person in people])
        time.sleep(0.05)
    return time.monotonic() - start


async def lossy_leg(loss: float) -> LineSettings:
    """Everything that this end receives passes a relay that loses packets."""
    legs: dict[tuple[str, int], tuple[Leg, Leg]] = {}

    async def reroute(host: str, port: int) -> tuple[str, int]:
        if (host, port) not in legs:
            near, far = await open_line(LossyLine(name="leg", loss=loss), 1, HOST)
            far.near = (host, port)
            legs[host, port] = near, far
        return HOST, legs[host, port][0].port

    return LineSettings(reroute=reroute)


def scene(count: int, seconds: float) -> dict[str, object]:
    folder = Path(tempfile.mkdtemp())
    settings = ServerSettings(key=secrets.token_hex(16), host=HOST)
    server = janus_server.start(folder, settings)
    time.sleep(2)
    invite = janus_server.room_invite(
        f"ws://{HOST}:{settings.port}",
        "choir",
        secrets.token_bytes(16),
        settings.key,
        int(time.time_ns() // 10**9),
    )
    people = [Person(invite, "Ann", admin_key=janus_server.admin_key(settings.key))]
    time.sleep(1)
    people += [Person(invite, f"P{k}", 0.05 * (k == 1)) for k in range(1, count)]
    try:
        met_s = all_together(people, 150)
        lowest = watched(people, seconds)
        false = {
            "wrong secret": replace(invite, secret=bytes(16)),
            "no token": replace(invite, token="1,janus,janus.plugin.videoroom:AAAA"),
        }
        bind_only(HOST)
        refused = {name: asyncio.run(refusal(wrong)) for name, wrong in false.items()}
        server.kill()
        server.wait()
        while any(person.sees for person in people):  # who sees nobody has noticed
            time.sleep(0.05)
        server = janus_server.start(folder, settings)
        back_s = all_together(people, 120)
    except TimeoutError as error:
        raise SystemExit(f"{error}\n{(folder / 'janus.log').read_text()[-1500:]}") from None
    finally:
        for person in people:
            person.leave()
        server.kill()
    found = {"met_s": met_s, "back_s": back_s, "refused": refused, "together": lowest}
    return found | {"reports": [person.last["report"] for person in people]}


def watched(people: list[Person], seconds: float) -> float:
    """Share of the time in which everybody saw everybody."""
    looks = [0, 0]
    for _ in range(int(seconds * 20)):
        looks[all(person.sees == len(people) - 1 for person in people)] += 1
        time.sleep(0.05)
    return looks[1] / max(sum(looks), 1)


async def refusal(invite: Invite) -> str:
    end = End(invite, "Eve", LineSettings())
    try:
        await asyncio.wait_for(end.room.run(), 15)
    except InputError as error:
        return str(error)
    except TimeoutError:
        return ""
    return ""


if __name__ == "__main__":
    if sys.argv[1] == "end":
        asyncio.run(take_part(*sys.argv[2:5], float(sys.argv[5]), sys.argv[6]))
        os._exit(0)  # aiortc leaves tasks behind that complain
    for command in NETWORK:
        subprocess.run(command.split(), check=True)
    say(scene(int(sys.argv[1]), float(sys.argv[2])))
    os._exit(0)
