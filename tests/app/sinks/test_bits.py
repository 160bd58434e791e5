"""Faces as bits, read by python-osc, against a plain rule; and trees of avatars that have them."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket

from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.bits import MAX_BITS, BitEncoder, Bits
from app.sinks.protocols.face import NamedFace
from app.sinks.protocols.osc import MAX_DATAGRAM, Message, OscBundles
from app.sinks.protocols.oscquery import MAX_PREFIX, PARAMETERS, face_in
from app.sinks.protocols.vrchat import ACTIVE, PARAMETER_NAMES, VRChatEncoder
from render.types import AHEAD

FULL = 1 << MAX_BITS


def rule(value: float, bits: Bits) -> dict[str, bool]:
    """By suffix. Slow and plain, as VRCFaceTracking has it: its 0.99999 is all that it takes for 1,
    which with up to 8 bits is in the last step anyway."""
    value = max(-1.0, min(1.0, value))
    told = {"Negative": value < 0} if bits.negative else {}
    if value < 0 and not bits.negative:
        value = 0.0
    code = 2**bits.num - 1 if abs(value) > 0.99999 else int(abs(value) * 2**bits.num)
    return {str(2**k): code // 2**k % 2 == 1 for k in range(bits.num)} | told


def heard(datagrams: Iterable[bytes]) -> dict[str, tuple[Any, ...]]:
    messages = [m.message for d in datagrams for m in OscPacket(d).messages]
    assert len({m.address for m in messages}) == len(messages)
    return {m.address: tuple(m.params) for m in messages}


def faces(count: int) -> Iterable[NamedFace]:
    """Channels from -1.5 to 1.5, as gains may stretch them; eyes in all directions."""
    rng = np.random.default_rng(0)
    for k in range(count):
        arkit = rng.uniform(-1.5, 1.5, len(ARKIT_NAMES)).astype(np.float32)
        arkit[rng.integers(0, len(ARKIT_NAMES), 12)] = rng.choice([-1, 0, 1], 12)
        yield NamedFace(k, 0, arkit, AHEAD, rng.uniform(-1, 1, (2, 2)).astype(np.float32))


def some_bits() -> dict[str, Bits]:
    """Three of four parameters, of all sizes, with and without a sign."""
    rng = np.random.default_rng(1)
    sizes = {
        n: Bits(1 + k % MAX_BITS, bool(rng.integers(2))) for k, n in enumerate(PARAMETER_NAMES)
    }
    return {name: bits for k, (name, bits) in enumerate(sizes.items()) if k % 4}


@pytest.mark.parametrize("bits", [{}, some_bits(), {"JawOpen": Bits(3, False)}])
def test_bits_go_out_beside_every_float(bits: dict[str, Bits]) -> None:
    encode, without = VRChatEncoder("FT/v2", bits), VRChatEncoder("FT/v2")
    for face in faces(40):
        got, floats = heard(encode(face)), heard(without(face))
        expected = {
            f"{PARAMETERS}/FT/v2/{name}{suffix}": (on,)
            for name, taken in bits.items()
            for suffix, on in rule(floats[f"{PARAMETERS}/FT/v2/{name}"][0], taken).items()
        }
        assert got == floats | expected
        assert all(got[address][0] is on for address, (on,) in expected.items())  # 1.0 == True


@pytest.mark.parametrize("num", range(1, MAX_BITS + 1))
@pytest.mark.parametrize("negative", [False, True])
def test_every_size_of_every_number_of_bits(num: int, negative: bool) -> None:
    edges = np.arange(-FULL, FULL + 1) / FULL
    near = [np.nextafter(np.float32(edges), np.float32(to)) for to in (-9, 9)]
    values = np.concatenate([edges, *near, [-0.0, -1e-9, -3, 3, 1000]]).astype(np.float32)
    names, bits = [f"n{k}x" for k in range(len(values))], Bits(num, negative)
    encode = BitEncoder(names, dict.fromkeys(names, bits))
    got = dict(zip(encode.names, encode(values).tolist(), strict=True))
    wanted = [rule(float(value), bits) for value in values]
    assert got == {n + s: on for n, r in zip(names, wanted, strict=True) for s, on in r.items()}


def test_bools_of_any_layout_are_read_back() -> None:
    """The tag's place depends on the lengths of the address and of what stands before it."""
    layout = [Message(f"/{'x' * n},é/{n}", ("word", 7)[: n % 3], n % 2, n % 4) for n in range(90)]
    floats, bools = sum(m.num_floats for m in layout), sum(m.num_bools for m in layout)
    bundles, rng = OscBundles(layout), np.random.default_rng(2)
    for _ in range(5):
        values, told = rng.normal(size=floats).astype(np.float32), rng.random(bools) < 0.5
        datagrams = bundles.fill(values, told)
        assert len(datagrams) > 2 and max(map(len, datagrams)) <= MAX_DATAGRAM
        got, left, marks = heard(datagrams), values.tolist(), told.tolist()
        for m in layout:
            wanted = [*m.words, *left[: m.num_floats], *marks[: m.num_bools]]
            left, marks = left[m.num_floats :], marks[m.num_bools :]
            assert got[m.address] == tuple(wanted)
    with pytest.raises(AssertionError, match="bools"):
        bundles.fill(values, np.append(told, True))


def test_the_most_that_a_tree_can_ask_for_fits_an_ethernet_frame() -> None:
    every = dict.fromkeys(PARAMETER_NAMES, Bits(MAX_BITS, True))
    prefix = "\N{CJK UNIFIED IDEOGRAPH-20000}" * (MAX_PREFIX - 3) + "/v2"  # four bytes each
    assert face_in(tree("JawOpen1", prefix=prefix))[0] == prefix
    (face,) = faces(1)
    datagrams = VRChatEncoder(prefix, every)(face)
    assert max(map(len, datagrams)) <= MAX_DATAGRAM
    assert len(heard(datagrams)) == len(PARAMETER_NAMES) * (MAX_BITS + 2) + 4 + 2 * len(ACTIVE)


@pytest.mark.parametrize(("prefix", "folders"), [("v2", [""]), ("FT/v2", ["", "/FT"])])
def test_avatars_are_told_that_the_face_is_tracked(prefix: str, folders: list[str]) -> None:
    """Red before: the animator layers of most avatars stay off without these."""
    encode = VRChatEncoder(prefix)
    for face in faces(3):  # in every tick: a new avatar has them off
        got = heard(encode(face))
        told = {address: on for address, (on, *_) in got.items() if address.endswith("Active")}
        assert told == {f"{PARAMETERS}{above}/{n}": True for above in folders for n in ACTIVE}
        assert all(on is True for on in told.values())


def tree(*names: str, prefix: str = "FT/v2") -> dict[str, Any]:
    below = {name: {"FULL_PATH": f"{PARAMETERS}/{prefix}/{name}"} for name in names}
    return {"FULL_PATH": PARAMETERS, "CONTENTS": below}


def digits(name: str, *steps: int) -> list[str]:
    return [f"{name}{step}" for step in steps]


@pytest.mark.parametrize(
    ("names", "bits"),
    [
        (digits("JawOpen", 4, 1, 2), {"JawOpen": Bits(3, False)}),
        (["JawOpen", *digits("JawOpen", 1, 2)], {"JawOpen": Bits(2, False)}),
        ([*digits("EyeX", 1, 2, 4), "EyeXNegative"], {"EyeX": Bits(3, True)}),
        (digits("JawX", *(2**k for k in range(8))), {"JawX": Bits(8, False)}),
        (digits("JawX", *(2**k for k in range(9))), {}),  # too many
        (digits("JawX", 1, 2, 8), {}),  # a gap
        (digits("JawX", 2, 4), {}),
        (digits("JawX", 1, 256), {}),
        (digits("JawX", 1, 2, 3, 10), {"JawX": Bits(2, False)}),  # 3 is no bit
        (["JawXNegative"], {}),
        ([*digits("Tail", 1, 2), *digits("jawopen", 1), *digits("x/JawOpen", 1, 2)], {}),
        (["JawX1" + "0" * 1_000_000, "JawX" + "1" * 1_000_000, "JawX\u0661", "JawX01"], {}),
    ],
)
def test_bits_of_a_tree(names: list[str], bits: dict[str, Bits]) -> None:
    """\u0661 is a digit to Python, and 01 a number."""
    assert face_in(tree("JawOpen", *names)) == ("FT/v2", bits)


def test_bits_of_other_folders_are_not_the_faces() -> None:
    node = tree("JawOpen", "JawX1")
    node["CONTENTS"] |= tree("JawX4", prefix="Old/v2")["CONTENTS"]
    node["CONTENTS"] |= tree("JawX2", "JawXNegative", prefix="v2")["CONTENTS"]
    node["CONTENTS"]["x"] = {"FULL_PATH": "JawX2"}
    assert face_in(node) == ("FT/v2", {"JawX": Bits(1, False)})


@pytest.mark.parametrize("part", ["x" * MAX_PREFIX, "JawOpen" * 1000, "a/b/c/d/e"])
def test_a_prefix_that_no_avatar_has_is_left_alone(part: str) -> None:
    """It would stand in every message of every tick."""
    assert face_in(tree("JawOpen", "JawOpen1", prefix=f"{part}/v2")) == (None, {})
