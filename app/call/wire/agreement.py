"""Consent in a call. Each end repeats its whole state, so a lost message changes
nothing, and what may be sent or recorded follows from the states alone.
"""

import json
import secrets
from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any, cast

from app.call.wire.packet import VERSION, MalformedError

MAX_HELLO = 4096  # bytes
MAX_NAME = 40  # characters
MAX_PEOPLE = 8
LARGEST = 2**63 - 1  # of a time; JSON has larger ones, which no float takes
SINGLE: tuple[object, ...] = (str, int, bool)  # types of fields that are no lists


@dataclass(frozen=True, kw_only=True)
class Hello:
    """The state of one end. `identity` is drawn anew for every call."""

    version: int = VERSION
    identity: str  # 32 hex digits
    name: str
    avatar: str = ""  # a name; it is drawn as such where it is known
    basis: int
    accepted: bool = False  # agrees to send and to receive
    muted: bool = False
    eyes_muted: bool = False
    records: bool = False  # asks to record, and does so once everybody agrees
    may_record: bool = False  # agrees to be recorded
    parcel: str = ""  # SHA-256 of an avatar's file that is offered
    parcel_bytes: int = 0  # of it, packed
    takes_avatars: bool = False  # agrees to be sent such files
    has: tuple[str, ...] = ()  # files that have come
    origin_ns: int = 0  # this end's clock at its sample 0
    now_ns: int = 0  # this end's clock when this was written
    met: tuple[str, ...] = ()  # identities whose hello came
    hears: tuple[str, ...] = ()  # identities whose voice is heard here
    echoes: tuple[tuple[str, int, int], ...] = ()  # identity, its newest now_ns, our clock at that

    def to_bytes(self) -> bytes:
        return json.dumps(asdict(self), separators=(",", ":")).encode()


def read_hello(data: bytes) -> Hello:
    """Raises MalformedError, with one line, for anything else than a hello."""
    if len(data) > MAX_HELLO:
        raise MalformedError(f"hello: expected {MAX_HELLO} bytes at most, got {len(data)}")
    try:
        given = json.loads(data)
    except (ValueError, RecursionError):
        raise MalformedError("hello: expected JSON") from None
    if not isinstance(given, dict):
        raise MalformedError("hello: expected an object")
    given = cast(dict[str, Any], given)
    if given.get("version") != VERSION:
        got = str(given.get("version"))[:20]
        raise MalformedError(f"hello: expected version {VERSION}, got {got}; update both ends")
    return Hello(**{f.name: _checked(f.name, f.type, given) for f in fields(Hello)})


def _checked(name: str, kind: Any, given: Mapping[str, Any]) -> Any:
    value = given.get(name)
    if name == "echoes":
        return _echoes(value)
    if kind not in SINGLE:
        items = _few(value)
        texts = [v for v in items or () if isinstance(v, str) and len(v) <= 64]
        if items is not None and len(texts) == len(items):
            return tuple(texts)
    elif type(value) is kind:
        if isinstance(value, str):
            value = "".join(c for c in value if c.isprintable())[:64]
            return value[:MAX_NAME] if name in ("name", "avatar") else value
        if not isinstance(value, int) or abs(value) <= LARGEST:
            return value
    wanted = getattr(kind, "__name__", "a list of short texts")
    raise MalformedError(f"hello: {name}: expected {wanted}, got {str(value)[:40]!r}")


def _echoes(value: Any) -> tuple[tuple[str, int, int], ...]:
    items = _few(value)
    rows = [_few(row) or [] for row in items or ()]
    if items is None or any([type(v) for v in row] != [str, int, int] for row in rows):
        raise MalformedError("hello: echoes: expected rows of identity and two times")
    if any(abs(time) > LARGEST for row in rows for time in row[1:]):
        raise MalformedError("hello: echoes: expected times of 64 bits, got more")
    return tuple((a[:64], b, c) for a, b, c in rows)


def _few(value: object) -> list[Any] | None:
    """A list of no more than as many as can be in a call; None for anything else."""
    if not isinstance(value, list):
        return None
    items = cast(list[Any], value)
    return items if len(items) <= MAX_PEOPLE else None


def new_identity() -> str:
    """32 hex digits, drawn anew for every call."""
    return secrets.token_hex(16)


def is_fresh(mine: Hello, theirs: Hello) -> bool:
    """True once their hello names this end's identity, which was drawn for this call: it is no
    recording of an earlier one."""
    return mine.identity in theirs.met


def may_send(mine: Hello, theirs: Iterable[Hello]) -> bool:
    """Nothing leaves before this end and at least one other have accepted."""
    return mine.accepted and any(t.accepted and is_fresh(mine, t) for t in theirs)


def may_receive(mine: Hello, theirs: Hello) -> bool:
    return mine.accepted and theirs.accepted and is_fresh(mine, theirs)


def may_record(mine: Hello, theirs: Collection[Hello]) -> bool:
    """Recording is allowed only while everybody present agrees."""
    return mine.records and len(theirs) > 0 and all(t.may_record for t in theirs)


def may_send_file(mine: Hello, theirs: Iterable[Hello]) -> bool:
    """Somebody who accepted the call agreed to be sent the avatar's file, and lacks it."""
    return any(
        may_receive(mine, t) and t.takes_avatars and mine.parcel not in t.has for t in theirs
    )


def news(mine: Hello, before: Hello | None, theirs: Hello) -> list[str]:
    """Lines about a hello that follows on `before`, with the keys that answer it."""
    lines: list[str] = []
    is_new = before is None or theirs.identity not in mine.met
    if is_new:
        lines.append(f"{theirs.name} is here" + ("" if mine.accepted else ": y and Enter accept"))
        if theirs.parcel:
            size = f"{theirs.parcel_bytes / 1e3:.0f} kB"
            lines.append(f"{theirs.name} offers an avatar's file, {size}: a and Enter take it")
    if theirs.records and not mine.may_record and (is_new or not (before and before.records)):
        lines.append(f"{theirs.name} asks to record: r and Enter agree")
    return lines


def heard_by(mine: Hello, theirs: Iterable[Hello]) -> int:
    """Number of partners that hear this end now."""
    return sum(mine.identity in t.hears for t in theirs)


def clock_difference_ns(mine: Hello, theirs: Hello, now_ns: int) -> tuple[int, int] | None:
    """Their clock minus ours, and the round trip it was told by; None before the first echo.

    They echo our newest `now_ns` with their clock when it came; `now_ns` is ours as `theirs` came.
    """
    for identity, sent_ns, came_ns in theirs.echoes:
        if identity == mine.identity:
            there_ns = theirs.now_ns - came_ns
            trip_ns = max(now_ns - sent_ns - there_ns, 0)
            return theirs.now_ns + trip_ns // 2 - now_ns, trip_ns
    return None
