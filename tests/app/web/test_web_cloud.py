"""The bytes of the cloud: what a page gets is what the decoder made, within its steps."""

import numpy as np
import pytest
from web_client import draw, psnr

from app.web.cloud import STATIONS, CloudReader, Ranges, base_message, pack, tick_message
from app.web.feed import AvatarFeed
from app.web.info import ServerInfo
from render.decoder import identity
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.types import AHEAD, Gaussians, Renderer
from sensors import rotation
from sensors.types import HeadPose


def test_a_cloud_survives_the_network(decoder: Decoder, who: Identity, renderer: Renderer) -> None:
    rest = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
    rig = np.zeros(53, np.float32)
    rig[decoder.rig_names.index("jawOpen")] = 0.8
    now = decoder.decode(decoder.encode(rig), AHEAD, who)[1]
    ranges, reader = Ranges.around(rest), CloudReader()
    base = base_message(rest, ranges)
    tick = tick_message(pack(now, ranges), pack(rest, ranges), 7, 11)
    assert len(base) <= 21 * len(rest) + 256  # of which 5 bytes are what it mirrors
    reader.read(base)
    reader.read(tick)
    got = reader.gaussians
    assert got is not None and (reader.frame, reader.t_ns) == (7, 11)
    np.testing.assert_allclose(got.means, now.means, atol=ranges.step_mm)
    np.testing.assert_allclose(np.log2(got.scales), np.log2(now.scales), atol=ranges.step_scale)
    np.testing.assert_allclose(got.colors, now.colors, atol=1 / 255)
    assert len(tick) < len(base)
    still = tick_message(pack(rest, ranges), pack(rest, ranges), 8, 12)
    assert len(still) <= len(rest) / 8 + 64  # what rests is not sent
    picture = draw(renderer, now)
    assert psnr(draw(renderer, got), picture) > 50
    assert psnr(draw(renderer, rest), picture) < 40  # the jaw did move


def test_every_turn_survives_the_network() -> None:
    rng = np.random.default_rng(0)
    quats = rng.standard_normal((5000, 4)).astype(np.float32)
    quats[:6] = [
        [1, 0, 0, 0],
        [-1, 0, 0, 0],
        [0, 1, 0, 0],
        [0, 0, -1, 0],
        [0, 0, 0, 1],
        [-0.0, 1, 0, 0],
    ]
    n = len(quats)
    cloud = Gaussians(
        means=rng.uniform(-100, 100, (n, 3)).astype(np.float32),
        quats=quats,
        scales=rng.uniform(0.1, 5, (n, 3)).astype(np.float32),
        opacities=np.ones(n, np.float32),
        colors=np.ones((n, 3), np.float32),
    )
    reader = CloudReader()
    reader.read(base_message(cloud, Ranges.around(cloud)))
    assert reader.gaussians is not None
    unit = quats / np.linalg.norm(quats, axis=1, keepdims=True)
    cosine = np.abs((unit * reader.gaussians.quats).sum(1)).clip(0, 1)
    assert np.degrees(2 * np.arccos(cosine.astype(np.float64))).max() < 0.5


def test_a_tick_needs_no_other_tick(decoder: Decoder, who: Identity) -> None:
    """Newest wins: a client that missed ticks decodes the next one to the same cloud."""
    rest = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
    ranges = Ranges.around(rest)
    base, words = base_message(rest, ranges), pack(rest, ranges)
    ticks = []
    for k in range(3):
        rig = np.zeros(53, np.float32)
        rig[5 * k : 5 * k + 5] = 0.7
        now = decoder.decode(decoder.encode(rig), AHEAD, who)[1]
        ticks.append(tick_message(pack(now, ranges), words, k, k))
    all_of_them, last = CloudReader(), CloudReader()
    for message in (base, *ticks):
        all_of_them.read(message)
    for message in (base, ticks[-1]):
        last.read(message)
    assert all_of_them.gaussians is not None and last.gaussians is not None
    np.testing.assert_array_equal(all_of_them.gaussians.means, last.gaussians.means)


@pytest.mark.slow
def test_a_page_gets_as_many_gaussians_as_were_asked_for(who: Identity) -> None:
    counts = {}
    for gaussians in ("16k", "32k"):
        reader = CloudReader()
        reader.read(AvatarFeed(ServerInfo("127.0.0.1", 0, "ben", gaussians=gaussians)).base)
        assert reader.gaussians is not None
        counts[gaussians] = len(reader.gaussians)
        decoder = Decoder.load(gaussians=gaussians)
        head = decoder.decode(np.zeros(256, np.float32), AHEAD, who)[1]
        assert counts[gaussians] == len(head)
    assert counts["32k"] - counts["16k"] > 15_000


@pytest.mark.slow
def test_a_receiver_turns_the_head_itself() -> None:
    """What the page's shader does with `neck`, in numpy, against the decoder."""
    decoder, who = Decoder.load(), identity.load("ben")
    zero, turn = np.zeros(256, np.float32), rotation.from_angles((0.1, 0.4, -0.1))
    head = HeadPose((2.0, 1.0, -3.0), turn)
    rest, now = (decoder.decode(zero, AHEAD, who, pose)[1] for pose in (HeadPose(), head))
    neck = decoder.cached(who).neck
    words = pack(rest, ranges := Ranges.around(rest, neck.offset))
    reader = CloudReader()
    reader.read(base_message(rest, ranges))
    reader.read(tick_message(words, words, 1, 2, neck.stations(head, 0.0, STATIONS)))
    assert reader.gaussians is not None and reader.neck.shape == (STATIONS, 3, 4)
    means = reader.gaussians.means
    place = neck.along(means) * (STATIONS - 1)
    low = np.minimum(place.astype(int), STATIONS - 2)
    part = (place - low)[:, None, None]
    moves = (1 - part) * reader.neck[low] + part * reader.neck[low + 1]
    turned = np.einsum("nij,nj->ni", moves[:, :, :3], means) + moves[:, :, 3]
    skin = slice(0, len(decoder.opacities))
    assert np.abs(turned - now.means)[skin].max() < 1.0
