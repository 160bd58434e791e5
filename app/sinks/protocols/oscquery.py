"""Finds VRChat on the local network and asks it what its avatar takes: OSCQuery, for `vrchat://auto`.

    mDNS: who is VRChat? -> HTTP: its OSC port -> HTTP: the avatar's parameters -> their prefix,
    and which of them are bits

Whoever announces itself as VRChat gets the face, so only that address is sent to which has
answered, and where several have, the user must choose.
"""

import asyncio
import contextlib
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from app.sinks.protocols.bits import Bits, bits_among
from app.sinks.protocols.vrchat import PARAMETER_NAMES
from sensors.files import parse_json
from sensors.mdns import Announced, announced
from sensors.types import InputError

SERVICE, CLIENT = "_oscjson._tcp.local.", "VRChat-Client"
PARAMETERS = "/avatar/parameters"
FACE = re.compile(PARAMETERS + r"/((?:[\w-]+/){0,4}v2)/JawOpen\w*")  # also as bits: JawOpen1, ...
MAX_PREFIX = 64  # characters; it stands in every message
WAIT_S, MAX_ANSWER = 2.0, 4 << 20  # of an answer: seconds, bytes
MAX_NODES = 100_000


@dataclass(frozen=True)
class VRChat:
    """Where its OSC is, and where the parameters of a face are; None: the avatar has none."""

    host: str
    port: int
    prefix: str | None
    bits: dict[str, Bits] = field(default_factory=dict[str, Bits])  # below the prefix, by name
    asked: Announced | None = field(default=None, compare=False, repr=False)  # what told this
    told: bool = field(default=True, compare=False, repr=False)  # False: parameters were not told


def find(seconds: float = 3.0, interfaces: Sequence[str] | None = None) -> VRChat | None:
    """The one VRChat here, told to the user; None where there is none, or none yet. Raises
    InputError where there are several."""
    asked = list(announced(SERVICE, "--send vrchat://auto", seconds, interfaces))
    clients = [service for service in asked if service.name.startswith(CLIENT)]
    found = [v for service in clients if (v := asyncio.run(_ask(service))) is not None]
    if len({(v.host, v.port) for v in found}) > 1:
        got = ", ".join(f"{v.host}:{v.port}" for v in found)
        raise InputError(
            f"--send vrchat://auto: expected one VRChat with OSC on, got several: {got}; name one: "
            "--send vrchat://HOST:9000"
        )
    if found:
        _tell(found[0])
    return found[0] if found else None


def _tell(where: VRChat) -> None:
    face = f"parameters of the face below {where.prefix}" if where.prefix else "no face parameters"
    bits = f", {len(where.bits)} of them as bits" if where.bits else ""
    print(f"livedrive: VRChat at {where.host}:{where.port}, {face}{bits}", file=sys.stderr)


def again(there: VRChat | None) -> VRChat | None:
    """What VRChat takes now, as its user may have changed the avatar, or started it late or anew;
    `there` where nothing answers in time."""
    now = asyncio.run(_ask(there.asked)) if there and there.asked else None
    if now is None:
        with contextlib.suppress(InputError):
            now = find()
    return now if now and now.told else there


async def _ask(service: Announced) -> VRChat | None:
    """None where what answers is no OSCQuery."""
    info = await _get(service, "/?HOST_INFO")
    port = cast(dict[str, object], info).get("OSC_PORT") if isinstance(info, dict) else None
    if not isinstance(port, int) or isinstance(port, bool) or not 0 < port < 1 << 16:
        return None
    parameters = await _get(service, PARAMETERS)
    told = parameters is not None
    return VRChat(service.host, port, *face_in(parameters), asked=service, told=told)


async def _get(service: Announced, path: str) -> Any:
    """What the service answers, as JSON; None where it does not, or too late; "" for nonsense."""
    from aiohttp import ClientError, ClientSession, ClientTimeout

    url, data = f"http://{service.host}:{service.port}{path}", b""
    try:
        async with (
            ClientSession(timeout=ClientTimeout(total=WAIT_S)) as session,
            session.get(url, allow_redirects=False) as answer,
        ):
            async for chunk in answer.content.iter_any():
                data += chunk
                if len(data) > MAX_ANSWER:
                    return ""
        return parse_json(data)
    except ValueError:
        return ""
    except (OSError, ClientError, TimeoutError):
        return None


def face_in(node: Any) -> tuple[str | None, dict[str, Bits]]:
    """The prefix of the face's parameters below a node of OSCQuery, and those that are bits."""
    found = list(paths(node))
    faces = (face[1] for path in found if (face := FACE.fullmatch(path)))
    prefix = next((face for face in faces if len(face) <= MAX_PREFIX), None)
    if prefix is None:
        return None, {}
    here = f"{PARAMETERS}/{prefix}/"
    there = {path.removeprefix(here) for path in found if path.startswith(here)}
    return prefix, bits_among(there, PARAMETER_NAMES)


def paths(node: Any) -> Iterator[str]:
    """Every address at or below a node of OSCQuery."""
    waiting, seen = [node], 0
    while waiting and seen < MAX_NODES:
        here, seen = waiting.pop(), seen + 1
        if isinstance(here, dict):
            path: Any = here.get("FULL_PATH")  # pyright: ignore
            below: Any = here.get("CONTENTS")  # pyright: ignore
            if isinstance(path, str):
                yield path
            if isinstance(below, dict):
                waiting += below.values()  # pyright: ignore
