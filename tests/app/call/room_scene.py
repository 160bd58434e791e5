"""Run inside a network namespace by test_call_rooms.py: a Janus server and people in a room."""

import asyncio
import json
import os
import secrets
import subprocess
import sys
import tempfile
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

    def sees(self, others: list["End"]) -> bool:
        """All `others`, within the last second."""
        since = time.monotonic_ns() - 10**9
        return all(self.seen.get(o.call.hello.identity, 0) > since for o in others)


async def talk(ends: list[End]) -> None:
    start_ns, block = time.monotonic_ns(), 0
    while True:
        block += 1
        await asyncio.sleep(max(0, (start_ns + block * 10**7 - time.monotonic_ns()) / 1e9))
        now_ns = time.monotonic_ns()
        for end in ends:
            end.call.speak(block * 480, MATERIAL.sound[:480], now_ns)
            if block % 3 == 0:
                tick = Tick(block // 3, MATERIAL.expression[block % 60], MATERIAL.gaze[0])
                end.call.tick(tick, now_ns)
            end.call.pull(480, now_ns)
            if block % 100 == 0:
                end.call.step()


async def all_together(ends: list[End], patience_s: float) -> float:
    """Seconds until everybody sees everybody."""
    start = time.monotonic()
    async with asyncio.timeout(patience_s):
        while not all(e.sees([o for o in ends if o is not e]) for e in ends):
            await asyncio.sleep(0.1)
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


async def scene(people: int, seconds: float) -> dict[str, object]:
    bind_only(HOST)
    folder = Path(tempfile.mkdtemp())
    settings = ServerSettings(key=secrets.token_hex(16), host=HOST)
    server = janus_server.start(folder, settings)
    await asyncio.sleep(2)
    token = janus_server.token(settings.key, int(time.time_ns() // 10**9))
    invite = Invite("room", HOST, settings.port, secrets.token_bytes(16), b"", "choir", token)
    admin = janus_server.admin_key(settings.key)
    plain = LineSettings()
    ends = [End(invite, "Ann", plain, admin)]
    tasks = [asyncio.create_task(ends[0].room.run())]
    await asyncio.sleep(1)
    lines = [await lossy_leg(0.05), *[plain] * people]
    ends += [End(invite, f"P{k}", lines[k - 1]) for k in range(1, people)]
    tasks += [asyncio.create_task(end.room.run()) for end in ends[1:]]
    tasks.append(asyncio.create_task(talk(ends)))
    try:
        met_s = await all_together(ends, 60)
        await asyncio.sleep(seconds)
        false = {
            "wrong secret": replace(invite, secret=bytes(16)),
            "no token": replace(invite, token="1,janus,janus.plugin.videoroom:AAAA"),
        }
        refused = {name: await refusal(wrong) for name, wrong in false.items()}
        server.kill()
        server.wait()
        await asyncio.sleep(1)
        server = janus_server.start(folder, settings)
        back_s = await all_together(ends, 60)
    except TimeoutError:
        log = (folder / "janus.log").read_text()[-1500:]
        raise SystemExit(
            f"{[e.told for e in ends]}\n{[len(e.seen) for e in ends]}\n{log}"
        ) from None
    finally:
        for task in tasks:
            task.cancel()
        server.kill()
    reports = [list(report_of(end.call, time.monotonic_ns(), {}).values()) for end in ends]
    return {"met_s": met_s, "back_s": back_s, "refused": refused, "reports": reports}


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
    for command in NETWORK:
        subprocess.run(command.split(), check=True)
    result = asyncio.run(scene(int(sys.argv[1]), float(sys.argv[2])))
    sys.stdout.write(json.dumps(result, default=float) + "\n")
    sys.stdout.flush()
    os._exit(0)  # aiortc leaves tasks behind that complain
