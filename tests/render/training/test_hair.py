"""Heads of hair: strands over a mass, hairs on the skin, a collar's curve."""

from dataclasses import replace

import numpy as np
import pytest

from render.strands import Hair, axes
from render.training.geometry import cards, curls, hair, hem, mass, rooted, trace
from render.training.geometry.trace import Pieces
from render.training.look import wrinkles
from render.types import Floats

LINEAR = np.array([0.1, 0.06, 0.03], np.float32)


def sheet_of_hair() -> Pieces:
    """200 strands of 20 pieces, side by side on a plane behind the head, 100 mm across."""
    x, y = np.meshgrid(np.linspace(-50, 50, 200), np.linspace(65, -35, 20), indexing="ij")
    middles = np.stack([x, y, np.full_like(x, -100)], -1).reshape(-1, 3).astype(np.float32)
    down = np.tile(np.array([0, -1, 0], np.float32), (len(middles), 1))
    progress = np.tile(np.linspace(0, 1, 20, dtype=np.float32), 200)
    return Pieces(middles, down, np.ones(4000, np.float32), progress, np.repeat(np.arange(200), 20))


@pytest.fixture
def body(monkeypatch: pytest.MonkeyPatch) -> tuple[Hair, float]:
    """Its mass and how large that is."""
    monkeypatch.setattr(mass, "COUNT", 500)
    pieces = sheet_of_hair()
    rng = np.random.default_rng(0)
    places, whole = mass.sheet(pieces.middles, rng)
    return mass.mass(pieces, places, whole, np.full((4000, 4), 0.5, np.float32), LINEAR, rng)


def test_whole_strands_are_chosen_all_over_the_head() -> None:
    pieces = sheet_of_hair()
    rows = hair.strands_of(pieces, 1000, np.random.default_rng(0))
    lengths = np.bincount(pieces.strand[rows], minlength=200)
    assert set(lengths) == {0, 20} and 900 < len(rows) <= 1000
    chosen = np.sort(np.unique(pieces.strand[rows]))
    assert np.diff(chosen).max() < 20  # an even choice of every fourth
    first = pieces.strand[rows[: len(rows) // 2]]
    assert len(set(first)) <= len(chosen) // 2 + 1  # thinner heads draw whole strands too


def test_a_mass_is_opaque_inside_the_hair_and_fades_where_it_ends(body: tuple[Hair, float]) -> None:
    made, area = body
    off = np.abs(made.means[:, :2] - (0, 15)).max(1)
    assert made.opacities[off < 30].min() > 0.9
    assert made.opacities[off > 45].min() < 0.85
    assert axes(made.quats)[:, 1].max() < -0.7  # along the strands, as it lies on the head
    assert (made.albedo**2 < LINEAR).all() and 5_000 < area < 20_000


def test_a_mass_ends_before_its_strands_and_glints_less_if_dark(body: tuple[Hair, float]) -> None:
    made, _ = body
    off = np.abs(made.means[:, :2] - (0, 15)).max(1)
    assert made.opacities[off > 44].mean() < 0.83
    assert (made.seen[:, 0] > 0.49).all() and (made.seen[:, 1:] < 0.45).all()


def test_a_piece_that_crosses_the_hair_is_no_hair() -> None:
    pieces = sheet_of_hair()
    along = pieces.along.copy()
    along[2010] = 1, 0, 0
    along[2050] = 0, 1, 0  # from the tip to the root: the same way
    kept = trace.in_line(pieces.middles, along)
    assert np.flatnonzero(~kept).tolist() == [2010]


def test_a_strand_goes_evenly_through_where_it_was_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """Red before: it stood still there for a step, and pieces were a step too short."""
    monkeypatch.setattr(trace, "SEEDS", 200)
    monkeypatch.setattr(trace, "SAMPLES", 4000)
    a, b, c, d = (-50, 65, -100), (50, 65, -100), (50, -35, -100), (-50, -35, -100)
    cards, white = np.array([(a, b, c), (a, c, d)], np.float32), np.ones((4, 4, 4), np.float32)
    down, uv = np.tile(np.array([0, -1, 0], np.float32), (2, 1)), np.full((2, 3, 2), 0.5, "f4")
    pieces = trace.trace(cards, uv, white, down, 1, np.random.default_rng(0))
    same = pieces.strand[1:] == pieces.strand[:-1]
    apart = np.linalg.norm(np.diff(pieces.middles, axis=0), axis=1)[same]
    assert len(apart) > 2000 and apart.min() > 0.8 * trace.STEP_MM


def test_a_peak_on_the_crown_is_lowered() -> None:
    rng = np.random.default_rng(0)
    out = rng.normal(0, 1, (4000, 3)) * (0.4, 0.1, 0.4) + (0, 1, 0)
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    middles = (out * 100 + (0, 15, -8)).astype(np.float32)
    tip = np.linalg.norm(middles[:, [0, 2]] - middles[0, [0, 2]], axis=1) < 3
    middles[tip] += 9 * out[tip]
    pieces = Pieces(middles, middles, middles[:, 0], middles[:, 0], np.arange(4000))
    heights = np.linalg.norm(trace.evened(pieces).middles - (0, 15, -8), axis=1)
    assert heights[tip].max() < 106 and np.abs(heights[~tip] - 100).max() < 1


def test_curls_are_springs_below_a_hull() -> None:
    hull = np.array([[[-60, 100, -40], [60, 100, -40], [0, 100, 60]]], np.float32)
    made = curls.curls(hull, np.random.default_rng(0))
    lines = made.middles.reshape(-1, curls.PIECES, 3)
    assert (made.strand.reshape(-1, curls.PIECES) == np.arange(len(lines))[:, None]).all()
    np.testing.assert_allclose(np.linalg.norm(made.along, axis=1), 1, rtol=1e-5)
    turned = (made.along.reshape(lines.shape)[:, 0] * made.along.reshape(lines.shape)[:, 2]).sum(1)
    assert np.median(turned) < 0  # half a turn on
    depth = 100 - lines.mean(1)[:, 1]
    assert depth.min() > -5 and depth.max() < 7


def test_fine_hairs_stand_across_the_edge_of_the_hair() -> None:
    x, z = np.meshgrid(np.arange(-60, 60, 3.0), np.arange(-60, 60, 3.0))
    skin = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], 1).astype(np.float32)
    u, v = np.meshgrid(np.arange(-60, 0, 1.5), np.arange(-60, 60, 1.5))
    feet = np.stack([u.ravel(), np.zeros(u.size), v.ravel()], 1).astype(np.float32)
    density = rooted.edge(skin, feet, np.ones(len(skin), np.float32))
    inside, middle, bare = (
        density[(skin[:, 0] > low) & (skin[:, 0] < high) & (np.abs(skin[:, 2]) < 45)]
        for low, high in ((-45, -22), (-6, 0), (22, 45))
    )
    assert inside.max() == 0 and bare.max() == 0 and middle.mean() > 0.5
    edge = density[(skin[:, 0] == 6) & (np.abs(skin[:, 2]) < 45)]
    assert edge.std() > 0.1  # no ruled line


def test_skin_below_a_mass_is_hidden_and_beside_it_is_not(body: tuple[Hair, float]) -> None:
    made, _ = body
    points = np.array([[0, 15, -95], [0, 15, -60], [70, 15, -95], [56, 15, -95]], np.float32)
    assert mass.hidden(points, made).tolist() == [True, False, False, False]


def test_a_tail_is_whole_all_around() -> None:
    rng = np.random.default_rng(0)
    turn, down = rng.uniform(0, 2 * np.pi, 6000), rng.uniform(-100, 0, 6000)
    tail = np.stack([22 * np.cos(turn), down, 22 * np.sin(turn) - 120], 1).astype(np.float32)
    _, whole = mass.sheet(tail, rng)
    assert np.median(whole[(np.abs(down + 50) < 30)]) > 0.95
    assert np.median(whole[(np.abs(down + 50) < 30) & (np.abs(tail[:, 0]) > 18)]) > 0.9


def test_skin_below_a_hole_in_a_mass_is_seen(body: tuple[Hair, float]) -> None:
    made, _ = body
    holed = made.rows(np.flatnonzero(np.linalg.norm(made.means[:, :2] - (0, 15), axis=1) > 9))
    x, y = np.meshgrid(np.arange(-30, 31, 3.0), np.arange(-15, 46, 3.0))
    points = np.stack([x, y, np.full_like(x, -95)], -1).reshape(-1, 3).astype(np.float32)
    off = np.linalg.norm(points[:, :2] - (0, 15), axis=1)
    hidden = mass.hidden(points, holed)
    assert not hidden[off < 10].any() and hidden[(off > 24) & (off < 28)].all()


def test_a_mass_leaves_no_gaps() -> None:
    rng = np.random.default_rng(0)
    points = np.zeros((20_000, 3), np.float32)
    points[:, :2] = 100 * rng.random((20_000, 2)) ** 1.5  # denser in a corner
    middles, reach = mass.spread(points, 400, rng)
    assert 250 < len(middles) <= 400
    assert reach.max() < 1.2 * np.sqrt(1e4 / len(middles))


def test_hair_swept_off_a_temple_is_dark_inside(body: tuple[Hair, float]) -> None:
    front = replace(body[0], means=body[0].means + np.array([0, 0, 180], np.float32))
    lined = mass.lined(front, np.array([[0, 15, 60]], np.float32))
    dark = lined.albedo.max(1) < 0.7 * front.albedo.max()
    assert len(lined) == len(front) and len(front) / 4 < dark.sum() < len(front) / 2
    assert not dark[dark.sum() :].any()  # first: thinner heads draw it too
    assert lined.means[dark, 2].max() < lined.means[~dark, 2].min()  # on the side of the head
    assert lined.seen[dark].max() < 0.35
    behind = mass.lined(body[0], np.array([[0, 15, -80]], np.float32))
    np.testing.assert_array_equal(behind.means, body[0].means)  # no one sees it from inside


def test_a_mass_that_hangs_without_strands_is_left_out(body: tuple[Hair, float]) -> None:
    made, _ = body
    pieces = sheet_of_hair()
    strands = pieces.middles[pieces.middles[:, 0] < 10] + np.array([0, 0, 2], np.float32)
    n = len(strands)
    blank = np.zeros((n, 4), np.float32)
    fibres = Hair(strands, blank, blank[:, :3], blank[:, 0], blank[:, :3], blank)
    hanging = hair.covered(made, fibres, np.array([[0, 15, -60]], np.float32))
    assert hanging.means[:, 0].max() < 17 and (made.means[:, 0] < 8).sum() > 0.9 * len(hanging) - 20
    on_skin = hair.covered(made, fibres, made.means)
    assert len(on_skin) == len(made)


def test_locks_are_neighbours() -> None:
    pieces = sheet_of_hair()
    lock = hair.locks(pieces, np.random.default_rng(0))
    for one in np.unique(lock):
        across = pieces.middles[lock == one, 0]
        assert np.ptp(across) < 20
    assert len(np.unique(lock)) > 20


def test_thinner_heads_draw_the_first_of_the_hair_and_wider_strands() -> None:
    count = 40_000
    scales = np.tile(np.array([3, 0.2, 0.2], np.float32), (count, 1))
    scales[:10, 1] = 4.0  # of the mass
    rows = np.arange(count, dtype=np.float32)
    means, quats = np.repeat(rows[:, None], 3, 1), np.zeros((count, 4), np.float32)
    whole = Hair(means, quats, scales, rows, means, quats)
    thin, same = whole.of_density("32k"), whole.of_density("65k")
    assert len(thin) == 18_000 and len(same) == count
    np.testing.assert_array_equal(thin.opacities, rows[:18_000])
    np.testing.assert_allclose(thin.scales[10:, 1], 0.2 * (40 / 18) ** 0.5, rtol=1e-5)
    np.testing.assert_array_equal(thin.scales[:10, 1], 4.0)
    np.testing.assert_array_equal(same.scales, scales)


def test_cropped_hair_fades_at_the_hairline() -> None:
    y, z = np.meshgrid(np.arange(-60, 120, 4.0), np.arange(-100, 80, 4.0))
    side = np.stack([np.full(y.size, 75), y.ravel(), z.ravel()], 1)
    skin = np.random.default_rng(0).uniform(1e3, 9e3, (rooted.SKIN_VERTICES, 3))  # far away
    skin[: len(side)] = side
    cover = rooted.head_of_hair(skin.astype(np.float32))[: len(side)]

    def at(z: float, y: float) -> float:
        return float(cover[np.argmin(np.hypot(side[:, 2] - z, side[:, 1] - y))])

    assert at(-40, 80) > 0.95 and at(50, 0) == 0 and at(0, 0) == 0  # crown, cheek, ear
    before = [at(z, 62) for z in (28, 40, 48, 56)]
    assert all(a >= b for a, b in zip(before, before[1:], strict=False))
    assert 0 < before[1] < 0.9 and before[3] < 0.1  # over more than a centimetre


def test_a_collar_lies_on_a_smooth_curve() -> None:
    """The edge of a shirt steps from triangle to triangle; its collar does not."""
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    ring = 60 * np.stack([np.sin(turn), np.zeros(120), np.cos(turn)], 1)
    ring[::4, 1] += 3
    ring[1::4, 1] += 3
    vertices = np.concatenate([ring, ring + (0, 6, 0)]).astype(np.float32)
    corners = np.stack([np.arange(120), np.roll(np.arange(120), -1), np.arange(120) + 120], 1)
    curve = hem.even(ring, np.roll(ring, -1, 0), corners, vertices, hem.APART_MM)
    heights: Floats = curve.points[:, 1]
    assert np.ptp(heights) < 0.2
    np.testing.assert_allclose(np.linalg.norm(curve.points[:, [0, 2]], axis=1), 60, atol=2)
    apart = np.linalg.norm(np.diff(curve.points, axis=0), axis=1)
    np.testing.assert_allclose(apart, apart.mean(), rtol=0.1)


def test_wrinkles_come_with_age() -> None:
    assert wrinkles.depth(0) < 1 < wrinkles.depth(0.75)
    albedo, maps = np.full((2, 3), 0.6, np.float32), np.array([[0] * 4, [0.2] * 4], np.float32)
    np.testing.assert_array_equal(wrinkles.at_rest(albedo, maps, 0), albedo)
    aged = wrinkles.at_rest(albedo, maps, 0.75)
    assert (aged[0] == albedo[0]).all() and (aged[1] < albedo[1]).all()


def test_hair_that_stands_off_a_temple_is_pressed_and_a_nape_is_left() -> None:
    turns = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    skin = (80 * np.stack([np.sin(turns), 0 * turns, np.cos(turns)], 1)).astype(np.float32)
    off = (skin[::30] * 110 / 80).astype(np.float32)  # 30 mm
    after = cards.pressed(off, skin)
    far = np.linalg.norm(after, axis=1) - 80
    front, back = off[:, 2] > cards.BEFORE_MM[1], off[:, 2] < cards.BEFORE_MM[0]
    wanted = cards.STANDS_MM + cards.STANDS * (30 - cards.STANDS_MM)
    np.testing.assert_allclose(far[front], wanted, atol=0.1)
    np.testing.assert_array_equal(after[back], off[back])
    near = (skin * 84 / 80).astype(np.float32)
    np.testing.assert_array_equal(cards.pressed(near, skin), near)
