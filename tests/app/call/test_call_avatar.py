"""An avatar's file: sent once to who agreed, whole or refused, checked before it is drawn."""

import hashlib
import lzma
from pathlib import Path

import numpy as np
import pytest

from app.call.core import parcel
from app.call.core.call import Call
from app.call.core.parcel import HEAD, PART, Parcel, Receipt
from app.call.live.shelf import Shelf
from app.call.rooms.room import AVATAR, BYE, HELLO
from app.call.table.company import Company
from app.call.table.seats import Seats
from app.call.trial.material import synthetic_material
from app.call.wire.agreement import Hello, new_identity
from app.call.wire.packet import MalformedError
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.learned import avatar_files
from sensors.types import InputError

FILE = avatar_files.path_of("ada")
MATERIAL = synthetic_material(2, 0)


@pytest.mark.parametrize("name", avatar_files.shipped())
def test_every_shipped_avatar_can_be_sent(name: str) -> None:
    Parcel(avatar_files.path_of(name))


def test_parts_come_in_any_order_and_more_than_once() -> None:
    sent = Parcel(FILE)
    receipt = Receipt(sent.digest, len(sent.packed))
    parts = [part for _ in range(20) for part in sent.parts()]
    whole = [data for part in reversed(parts) if (data := receipt.add(part))]
    assert whole[0] == FILE.read_bytes()


def test_what_is_not_of_the_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    packed = lzma.compress(b"somebody else")
    receipt = Receipt(hashlib.sha256(b"what was offered").hexdigest(), len(packed))
    for bad in (b"", b"123", HEAD.pack(1, len(packed)) + packed, HEAD.pack(0, 9) + b"x" * 9):
        with pytest.raises(MalformedError):
            receipt.add(bad)
    with pytest.raises(MalformedError, match="another"):
        receipt.add(HEAD.pack(0, len(packed)) + packed)
    bomb = lzma.compress(bytes(1 << 24))
    receipt = Receipt(hashlib.sha256(bytes(1 << 24)).hexdigest(), len(bomb))
    parts = [bomb[at : at + PART] for at in range(0, len(bomb), PART)]
    with pytest.raises(MalformedError, match="another"):
        for number, part in enumerate(parts):
            receipt.add(HEAD.pack(number, len(bomb)) + part)
    monkeypatch.setattr(parcel, "MAX_PACKED", 1000)
    with pytest.raises(InputError, match="1000 bytes"):
        Parcel(FILE)


class Wire:
    """Two calls, their messages handed over at once."""

    def __init__(self, **ben: object) -> None:
        self.now_ns, self.parts, secret = 10**9, 0, bytes(16)
        self.told: list[str] = []
        self.calls = [self._call(secret, "Ann", {}), self._call(secret, "Ben", ben)]
        for k, call in enumerate(self.calls):
            call.room = _Handing(self, 1 - k, call)  # type: ignore[assignment]

    def _call(self, secret: bytes, name: str, state: dict[str, object]) -> Call:
        hello = Hello(
            identity=new_identity(),
            name=name,
            basis=MATERIAL.basis.number,
            **({"accepted": True} | state),  # type: ignore[arg-type]
        )
        show = lambda sight, now_ns: None  # noqa: E731
        return Call(secret, hello, MATERIAL.basis, self.told.append, show, lambda: self.now_ns)

    def go_on(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now_ns += 10**9
            for call in self.calls:
                call.step()


class _Handing:
    def __init__(self, wire: Wire, to: int, call: Call) -> None:
        self._wire, self._to, self._call = wire, to, call

    def say(self, message: bytes) -> None:
        self._wire.parts += message[:1] == AVATAR
        events = self._wire.calls[self._to].events()
        events.message(*events.open(self._call.events().seal(message)))


@pytest.mark.parametrize("state", [{}, {"accepted": False, "takes_avatars": True}])
def test_nothing_is_sent_to_who_did_not_agree(state: dict[str, object]) -> None:
    wire = Wire(**state)
    sent = wire.calls[0].parcel = Parcel(FILE)
    wire.calls[0].change(parcel=sent.digest, parcel_bytes=len(sent.packed))
    wire.go_on(20)
    assert wire.parts == 0 and not wire.calls[1].files
    assert any("offers an avatar" in line for line in wire.told)


@pytest.mark.slow
def test_it_is_sent_once_and_drawn(tmp_path: Path) -> None:
    wire = Wire(takes_avatars=True)
    sent = wire.calls[0].parcel = Parcel(FILE)
    wire.calls[0].change(parcel=sent.digest, parcel_bytes=len(sent.packed))
    wire.go_on(20)
    assert wire.calls[1].files == {sent.digest: FILE.read_bytes()}
    parts = wire.parts
    wire.go_on(5)
    assert wire.parts == parts

    shelf = Shelf(tmp_path, wire.told.append)
    shelf.keep(wire.calls[1].files)
    kept = Path(shelf.path(sent.digest))
    assert kept.parent == tmp_path and kept.stat().st_mode & 0o077 == 0
    seats = Seats()
    seats.take("ann", "Ann", "somebody unknown", str(kept))
    company = Company(Decoder.load(gaussians="16k"), seats)
    sitter = type("Sitter", (), {"file": str(kept), "avatar": "somebody unknown"})()
    drawn = company._avatar(sitter)  # noqa: SLF001
    np.testing.assert_array_equal(drawn.geometry, identity.load("ada").geometry)


def test_what_is_no_avatar_is_told_and_not_drawn(tmp_path: Path) -> None:
    told: list[str] = []
    shelf = Shelf(tmp_path, told.append)
    shelf.keep({"ab" * 32: b"no avatar", "cd" * 32: FILE.read_bytes()[:-8] + bytes(8)})
    assert shelf.path("ab" * 32) == "" and len(told) >= 1
    assert shelf.path("unknown") == ""


def test_avatars_of_guests_who_have_left_make_room() -> None:
    """Red before: the ninth of a long call was sent again and again, and never shown."""
    host = Wire(takes_avatars=True).calls[1]
    for k in range(12):
        data = bytes([k]) * 900
        packed, digest = lzma.compress(data), hashlib.sha256(data).hexdigest()
        guest = Hello(
            identity=new_identity(), name=f"g{k}", basis=MATERIAL.basis.number, accepted=True,
            parcel=digest, parcel_bytes=len(packed), now_ns=1,
        )  # fmt: skip
        host.events().message(guest.identity, HELLO + guest.to_bytes())
        host.events().message(guest.identity, AVATAR + HEAD.pack(0, len(packed)) + packed)
        assert digest in host.files
        host.events().message(guest.identity, BYE)
    assert len(host.files) == 1
