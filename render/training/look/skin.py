"""Albedo of skin: MakeHuman's tones without their painted brows and shadows, pores and mottling of
Reom's skins (CC BY), blood and melanin on top.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from render.lighting import LUMINANCE
from render.training.data.face_data import FaceData
from render.training.data.people import Skin
from render.training.look import complexion, lids
from render.training.look.places import SIZE, Places, soft
from render.training.look.relief import Relief, noise
from render.types import Floats

LEAST_HUE, MOST_HUE = 0.90, 1.12  # of a lid's red, green and blue, in those of the skin around
DARKER_BROW = 0.9  # than the skin around it, in luminance, are the hairs of a painted brow
LID_TOP_MM = (44, 50), (36.5, 26)  # mm across, mm up: painted brows are looked for above it
EVEN_HUE = 0.9  # how far patches take the hue of the face that are so wide, near lips and not
EVEN_TEXELS = 14, 5
FURROW = 0.8  # of a dark blot in the furrow under a nose, how far it takes the skin around
RIM = 0.7  # of the brightness of skin beside the lips, how far it takes that of the skin around
CORNER, CORNER_COLOR = 0.9, np.array([0.93, 0.83, 0.81], np.float32)  # of the mouth, in its skin's
DARK_LIP, FLESH = 0.9, np.array([0.88, 0.80, 0.80], np.float32)  # of the outer lips' colour
CORNER_MM = 15.0  # from the edges of the lids: there the detail of another face has its own eyes
# Where a texture's ears reach before those of the mesh: middle, half width; mm up, forward, across.
EAR_MM, EAR_HALF_MM, EAR_ACROSS_MM = (36, 17), (11, 10), 80
DARK = 0.16  # linear luminance below which a skin takes the dark detail
# The same points in Reom's picture and in the face's half of the atlas; x right, y down, 0..1.
REOM_POINTS = np.array([
    (140, 166), (191, 166), (260, 166), (311, 166), (208, 229), (241, 229), (178, 286),
    (273, 286), (225, 262), (225, 312), (225, 360), (60, 205), (390, 205), (225, 75),
]) / 448  # fmt: skip
FACE_POINTS = np.array([
    (232, 220), (308, 221), (468, 220), (548, 220), (355, 345), (427, 345), (303, 440),
    (482, 440), (391, 385), (391, 512), (391, 590), (40, 300), (745, 300), (391, 60),
]) / 784  # fmt: skip


def linear(stored: Floats) -> Floats:
    """sRGB -> linear."""
    low, high = stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4
    return np.where(stored <= 0.04045, low, high).astype(np.float32)


def cleaned(face: FaceData, name: str, places: Places) -> Floats:  # [SIZE, 2 SIZE, 3] linear
    """A stored skin without brows, painted shadows and blotches."""
    atlas = linear(face.image(f"albedo/{name}")[..., :3])
    tone = atlas[:, :SIZE].copy()
    known = places.points.any(2)
    tone = shaven(tone, places)
    skin = _bare(places)
    weight = (skin * known * (places.up > -90) + 1e-4).astype(np.float32)
    wide, near = (soft(tone * weight[..., None], s) / soft(weight, s)[..., None] for s in (35, 9))
    sockets = np.clip(3 * soft((places.lids > 0.3).astype(np.float32), 7), 0, 1)[..., None]
    flat = (0.7 * skin[..., None] * (1 - sockets) + 0.6 * sockets) * soft(places.face, 7)[..., None]
    tone *= 1 + (np.clip(wide / np.clip(near, 0.01, None), 0.75, 1.5) - 1) * flat
    tone += sockets * (_in_hue(tone, wide) - tone)
    light = tone @ LUMINANCE
    blotch = soft(light, 0.6) / np.clip(soft(light, 3.5), 0.01, None)
    tone /= np.clip(blotch, 0.6, 1.6)[..., None] ** 0.35
    return np.concatenate([lids.plain(tone, places), atlas[:, SIZE:]], 1)


def shaven(tone: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] linear
    """A skin whose painted brows, hair by hair, have the colour of the skin around them."""
    lid = soft((places.lids > 0.3).astype(np.float32), 8)
    whole = (places.points.any(2) & (lid < 0.06)).astype(np.float32)
    brow = soft((places.brows > 0.25).astype(np.float32), 9) > 0.01
    above = places.up - np.interp(places.across, *LID_TOP_MM)
    brow &= above > 0
    hairs = brow & (tone @ LUMINANCE < DARKER_BROW * (_among(tone, whole, 60) @ LUMINANCE))
    hole = soft(hairs.astype(np.float32), 4) > 0.02
    around = _among(tone, whole * ~hole, 16)
    share = soft(hole * np.clip(above / 1.5, 0, 1), 3)[..., None]
    return (tone + np.clip(1.3 * share, 0, 1) * (around - tone)).astype(np.float32)


def _in_hue(tone: Floats, around: Floats) -> Floats:  # [..., 3] each
    """As bright as before, in about the hue of the skin around: wet corners and lashes that a
    texture has are red and green."""
    light, hue = tone @ LUMINANCE, around / np.clip(around @ LUMINANCE, 1e-3, None)[..., None]
    own = tone / np.clip(light, 1e-3, None)[..., None]
    own = np.clip(own, LEAST_HUE * hue, MOST_HUE * hue)
    return (own * (light / np.clip(own @ LUMINANCE, 1e-3, None))[..., None]).astype(np.float32)


def reom(face: FaceData, name: str) -> Floats | None:  # [SIZE, SIZE, 3] linear
    """Reom's skin fitted to the face; none if the picture is not there."""
    path = face.folder / "reom" / f"{name}Skin_Face_BaseColor.jpg"
    if not path.is_file():
        return None
    picture = linear(face.image(f"reom/{path.name}"))
    fit = np.linalg.lstsq(_bends(FACE_POINTS), REOM_POINTS, rcond=None)[0]
    centres = (np.arange(SIZE) + 0.5) / SIZE
    x, y = np.meshgrid(centres, centres)
    at = _bends(np.stack([x.ravel(), y.ravel()], 1)) @ fit
    where = [at[:, 1] * picture.shape[0] - 0.5, at[:, 0] * picture.shape[1] - 0.5]
    step = max(picture.shape[0] // (4 * SIZE), 1)
    fine = soft(picture, 0.5 * step) if step > 1 else picture
    bands = [map_coordinates(fine[..., c], where, order=1, mode="reflect") for c in range(3)]
    return np.stack(bands, 1).reshape(SIZE, SIZE, 3).astype(np.float32)


def _bends(points: NDArray[np.float64]) -> NDArray[np.float64]:  # [n, 2] -> [n, 6]
    x, y = points.T
    return np.stack([np.ones_like(x), x, y, x * y, x * x, y * y], 1)


def detail(skin: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] -> gains
    """Pores and mottling of a fitted skin, without its tone."""
    on = _bare(places) * (1 - places.spot(0, -20, 9, 5))  # there is a mark of theirs
    on = (on * soft((places.up > -70).astype(np.float32), 10))[..., None]
    fine = skin / np.clip(soft(skin, 4.5), 0.01, None)
    light = skin @ LUMINANCE  # mottling in hues looks like stains
    band = (soft(light, 2.5) / np.clip(soft(light, 18), 0.01, None))[..., None]
    gain = 1 + 1.3 * on * (np.clip(fine, 0.75, 1.1) - 1)
    return (gain * (1 + 0.55 * on * (np.clip(band, 0.85, 1.15) - 1))).astype(np.float32)


def painted(tone: Floats, grain: Floats, skin: Skin, places: Places, relief: Relief) -> Floats:
    """[SIZE, SIZE, 3] linear -> the same with detail, blood, melanin, pores and lips."""
    out = evened(tone, places) * (1 + _off_lips(places) * (grain - 1))
    out, lips = fleshed(out.astype(np.float32), places), soft(places.lips, 1.5)
    out = before_ears(out, places)
    bare = _bare(places)
    ears = np.clip((places.across - 74) / 8, 0, 1)
    red = 0.14 * places.cheeks + 0.11 * places.nose + 0.07 * places.chin + 0.05 * ears
    red += 0.04 * places.face + 0.05 * places.spot(0, -36, 42, 26)
    red = skin.blood * (red + 0.025 * relief.patches * bare + 0.02 * relief.clouds)
    out = out * np.clip(1 + red[..., None] * np.array([0.10, -0.55, -0.45], np.float32), 0.5, 1.3)
    melanin = 0.018 * relief.patches + 0.015 * relief.grain
    if skin.freckles > 0:
        spots = np.clip(noise(places.points, 3.4, 31, 2) - 0.9, 0, 1.2) * bare
        spots *= np.clip(places.cheeks + places.nose + 0.3 * places.forehead, 0, 1)
        melanin = melanin + 0.55 * skin.freckles * soft(spots, 0.8)
    brown = np.array([0.5, 0.9, 1.1], np.float32)
    out = out * np.clip(1 - melanin[..., None] * brown, 0.4, 1.4)
    out = out * (1 - 0.13 * relief.pores[..., None] * np.array([0.6, 1.0, 1.1], np.float32))
    rouge = np.array([0.0, -0.29, -0.28], np.float32) * np.float32(skin.lips)
    streaks = 1 + 0.05 * lips * relief.grain
    out = out * (1 + lips[..., None] * rouge) * streaks[..., None]
    out = out.astype(np.float32)
    if skin.melanin > 0:
        out = complexion.deep(out, skin.melanin, places, relief)
    if skin.age > 0:
        out = complexion.old(out, skin.age, places, relief)
    return np.clip(out, 0.004, 0.95).astype(np.float32)


def _bare(places: Places) -> Floats:  # [SIZE, SIZE] 0..1
    """Where skin is neither lip nor lid, nor in a corner of an eye."""
    off = np.clip(1.3 * places.lips + 1.2 * places.lids + places.roll, 0, 1)
    off = np.maximum(off, np.clip((CORNER_MM - places.off_eyes) / 4, 0, 1))
    return np.clip(1 - 1.2 * soft(off, 2.5), 0, 1)


def evened(tone: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] linear
    """Less of the hues that a texture has in patches (yellow around a mouth), of its pale rim of
    the lips and its painted furrow above them, and none of its dark corners of the mouth."""
    bare = _bare(places) * soft(places.face, 7)
    off = np.clip(1 - 1.3 * soft(np.clip(places.lips + places.lids + places.roll, 0, 1), 1.2), 0, 1)
    off *= soft(places.face, 7)
    near, far = (_among(tone, off, texels) for texels in EVEN_TEXELS)
    wide = near + _off_lips(places) * (far - near)
    hue = wide / np.clip(wide @ LUMINANCE, 1e-3, None)[..., None]
    usual = np.median(hue[bare > 0.9], 0)
    out = (tone * (1 + EVEN_HUE * off[..., None] * (usual / hue - 1))).astype(np.float32)
    out *= (tone @ LUMINANCE / np.clip(out @ LUMINANCE, 1e-3, None))[..., None]
    skin = _among(out, bare, 34)
    rim = RIM * off * np.clip(3 * soft(places.lips, 22), 0, 1)
    lit = skin @ LUMINANCE / np.clip(_among(out, off, 5) @ LUMINANCE, 1e-3, None)
    out *= (1 + rim * (np.minimum(lit, 1.15) - 1))[..., None]
    furrow = (FURROW * off * places.spot(0, -19.5, 13, 3.5))[..., None]
    out += furrow * (skin - out)
    corner = CORNER * np.clip((places.across - 20) / 5, 0, 1) * places.spot(25, -35, 7, 6)
    return (out + corner[..., None] * (skin * CORNER_COLOR - out)).astype(np.float32)


def fleshed(tone: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] linear
    """With lips that are wet flesh up to the teeth: a texture has the dark of the mouth on them,
    which lips that part, roll and round bring out."""
    lip = np.median(tone[(places.lips > 0.9) & (places.roll < 0.1)], 0)
    mouth = soft(np.clip(places.lips + places.roll, 0, 1), 1.5)
    dark = np.clip((DARK_LIP - soft(tone @ LUMINANCE, 1) / (lip @ LUMINANCE)) / 0.3, 0, 1)
    out = tone + (mouth * dark)[..., None] * (lip * FLESH - tone)
    ragged = np.clip(1.5 * mouth * places.spot(20, -34, 6, 5), 0, 1)[..., None]
    return (out + ragged * (soft(out, 6) - out)).astype(np.float32)


def before_ears(tone: Floats, places: Places) -> Floats:  # [SIZE, SIZE, 3] linear
    """Without the outline of a texture's ears on the temples."""
    offs = np.stack([places.up, places.points[..., 2]], -1) - EAR_MM
    near = np.exp(-((offs / EAR_HALF_MM) ** 4).sum(-1)) * places.points.any(2)
    near = (near * np.clip((EAR_ACROSS_MM - places.across) / 2, 0, 1)).astype(np.float32)
    around = _among(tone, np.clip(1 - 2 * near, 0, 1) * (places.across < EAR_ACROSS_MM - 3), 24)
    return (tone + near[..., None] * (around - tone)).astype(np.float32)


def _among(tone: Floats, where: Floats, sigma: float) -> Floats:  # [H, W, 3], [H, W]
    """Blurred, by what lies there alone."""
    total = soft(tone * (where[..., None] + 1e-3), sigma)
    return (total / (soft(where, sigma) + 1e-3)[..., None]).astype(np.float32)


def _off_lips(places: Places) -> Floats:  # [SIZE, SIZE, 1] 0..1
    """Where the detail of another face has no edge of its lips."""
    near = 4 * soft(np.clip(places.lips + places.roll, 0, 1), 8) + 1.6 * places.spot(29, -36, 9, 6)
    return np.clip(1 - near, 0, 1)[..., None].astype(np.float32)
