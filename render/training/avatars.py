"""The people who ship: recipes, and how they become avatar files."""

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import strands
from render.avatars import detail, lashes
from render.avatars.maker import Maker
from render.decoder import identity, mesh_parts
from render.decoder.beard import Beard, joined
from render.training.data import people
from render.training.data.face_data import SKIN_VERTICES
from render.training.data.people import Skin
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry import beard, hair, hem, mass, rooted, teeth
from render.training.geometry.assembly import Assembly
from render.training.geometry.beard import BeardStyle
from render.training.look import brows, clothes, hairline, lids, wrinkles
from render.training.look.brows import Brows
from render.types import Floats

BALD, BUZZ = "bald", "buzz"
HANGING = ("long01", "afro01")  # styles that hide skin without touching it


@dataclass(frozen=True)
class Recipe:
    """One avatar."""

    seed: int  # of the 100 identity modes
    strength: float  # standard deviations of the modes
    feminine: float  # along the axis of sex; below zero: masculine
    skins: tuple[str, str, float]  # two skins and the share of the second
    eye: str
    style: str  # of hair, or "bald", "buzz"
    tint: tuple[float, float, float]  # of hair
    shirt: tuple[float, float, float]
    skin: Skin = field(default_factory=Skin)
    brows: Brows = field(default_factory=Brows)
    lashes: float = 1.0  # length, factor
    tone: float = 1.0  # gain of the skins
    stubble: float = 0.0  # 0 shaven .. 1 full
    beard: BeardStyle | None = None
    hairs: int = 30_000


BLACK, BROWN, DARK = (0.12, 0.10, 0.09), (0.34, 0.21, 0.13), (0.20, 0.14, 0.10)
BLOND, RED, GREY = (0.56, 0.45, 0.31), (0.44, 0.20, 0.09), (0.58, 0.57, 0.56)
NAVY, SAND, WINE, MOSS = (
    (0.16, 0.20, 0.30),
    (0.62, 0.57, 0.49),
    (0.36, 0.13, 0.16),
    (0.24, 0.29, 0.22),
)
CHALK, COAL, SKY = (
    (0.78, 0.77, 0.74),
    (0.14, 0.14, 0.15),
    (0.36, 0.47, 0.58),
)
FINE, SOFT, FULL = Brows(440, 0.72, 1.2, 1.0), Brows(500, 0.85, 0.6, 0.5), Brows(680, 1.15)
RECIPES = {
    "ada": Recipe(5, 0.40, 2.1, ("young_lightskinned_female3", "young_lightskinned_female2", 0.3),
                  "green", "bob02_swept", BROWN, MOSS, Skin(0.9, 0.35, 0.5), FINE, 1.15),
    "ben": Recipe(11, 0.65, -1.6, ("young_lightskinned_male2", "young_lightskinned_male2", 0.0),
                  "brownlight", "short04", DARK, NAVY, Skin(1.0, 0.0, 0.25), FULL, 0.9,
                  stubble=0.30),
    "chen": Recipe(31, 0.6, -0.9, ("young_lightskinned_male3", "middleage_lightskinned_male", 0.4),
                   "brown", "short02", BLACK, CHALK, Skin(0.7, 0.0, 0.3), Brows(600, 1.1), 0.8),
    "dalia": Recipe(42, 0.5, 1.9,
                    ("young_lightskinned_female2", "middleage_darkskinned_female", 0.35),
                    "brown", "long01", BLACK, WINE, Skin(0.8, 0.0, 0.7), SOFT, 1.2),
    "emil": Recipe(53, 0.65, -0.7, ("young_lightskinned_male", "young_lightskinned_male3", 0.5),
                   "blue", "short03_swept", BLOND, COAL, Skin(1.2, 0.3, 0.3)),
    "femi": Recipe(64, 0.6, 1.5, ("middleage_darkskinned_female", "young_darkskinned_male", 0.45),
                   "brown", "afro01", (0.13, 0.10, 0.085), CHALK, Skin(0.3, 0.0, 0.5), SOFT, 1.2,
                   1.22),
    "greta": Recipe(75, 0.6, 1.2,
                    ("middleage_lightskinned_female2", "old_lightskinned_male2", 0.25),
                    "grey", "short01", GREY, SKY, Skin(1.1, 0.2, 0.4), SOFT, 0.9),
    "hugo": Recipe(86, 0.7, -1.9, ("middleage_lightskinned_male", "old_lightskinned_male2", 0.35),
                   "grey", BALD, DARK, MOSS, Skin(1.1, 0.0, 0.3), FULL, 0.8, 1.0, 0.9,
                   BeardStyle(5600, 11.0)),
    "ines": Recipe(97, 0.45, 1.7,
                    ("young_lightskinned_female2", "young_lightskinned_female3", 0.6),
                   "blue", "ponytail01", RED, SAND, Skin(1.2, 0.9, 0.5), FINE, 1.1),
    "joao": Recipe(108, 0.65, -1.3,
                    ("middleage_darkskinned_male", "young_lightskinned_male2", 0.45),
                   "brown", BUZZ, BLACK, SAND, Skin(0.7, 0.0, 0.3), FULL, stubble=0.6,
                   hairs=16_000),
    "kofi": Recipe(23, 0.65, -0.9, ("young_darkskinned_male", "young_darkskinned_male", 0.0),
                   "brown", "short01", BLACK, SKY, Skin(0.3, 0.0, 0.3), FULL, 1.0, 1.22, 0.9,
                   BeardStyle(4600, 7.0, 0.7)),
    "lena": Recipe(119, 0.5, 2.2,
                    ("young_lightskinned_female3", "young_lightskinned_female3", 0.0),
                   "brownlight", "long01", BLOND, NAVY, Skin(0.9, 0.1, 0.6),
                   Brows(440, 0.75, 1.2, 1.0), 1.1),
}  # fmt: skip
BROW_DARKER, BRIGHTEST_BROW = 0.8, 0.36  # than the hair; stored
UNDER_NOSE = slice(31, 36)  # of the 68 landmarks
CROPPED, SHAVEN = 0.6, 0.16  # share of the roots' colour on the scalp
FOREHEAD_MM, EVENED = ((-30, 60, 60), (30, 85, 200)), 0.85
WHOLLY = 0.6  # of the scalp: skin so far inside it is not drawn where hair hides it
MATTE = 0.9  # share of the skin's gloss that hair keeps off
GREYER = 0.4  # roots than hair
SCALP = 0.85  # brightness of a covered scalp, as a share of the hair's


def make(
    assembly: Assembly, maker: Maker, wardrobe: Wardrobe, name: str, recipe: Recipe
) -> identity.Identity:
    """Geometry and texture of the recipe, Theta_id from the encoder, hair from the cards."""
    face = assembly.face
    rng = np.random.default_rng(recipe.seed)
    modes = (rng.standard_normal(100) * recipe.strength).astype(np.float32)
    modes = people.leaning_to(face, modes, recipe.feminine)
    bare = people.relaxed(face, modes)
    dressed = clothes.worn(face.neutral, bare, assembly.normals(bare))
    dressed = teeth.set_back(face, dressed)
    first, second, mix = recipe.skins
    person = people.VirtualPerson(
        modes, (f"mh_{first}.jpg", f"mh_{second}.jpg"), mix, np.full(3, recipe.tone, np.float32),
        recipe.eye,
        np.ones(len(face.rig_names), np.float32), recipe.skin,
    )  # fmt: skip
    vertices = maker.posing.rest(dressed).geometry
    worn = cover = None
    if recipe.style not in (BALD, BUZZ):
        worn = hair.cards(assembly, vertices, assembly.normals(vertices), recipe.style)
        cover = worn.corners if worn.texture is None else hair.opaque(worn)
    who = maker.identity(name, dressed, wardrobe.texture(person), wardrobe.eye(recipe.eye), cover)
    albedo, age = calmed(assembly, maker, who), wrinkles.age(recipe.skins)
    albedo = wrinkles.at_rest(albedo, maker.wrinkles, age)
    who = replace(who, wrinkles=wrinkles.depth(age))
    albedo = beard.stubble(assembly, maker, albedo, recipe.stubble, recipe.tint, rng)
    dark = np.array(recipe.tint) * min(BROW_DARKER, BRIGHTEST_BROW / max(recipe.tint))
    standing = [
        lashes.grow(maker.posing, who.rest, maker.skin, recipe.lashes),
        brows.grow(
            face, vertices, assembly.normals(vertices), maker.skin, recipe.brows,
            (float(dark[0]), float(dark[1]), float(dark[2])), recipe.seed,
        ),
    ]  # fmt: skip
    if recipe.beard:
        own = np.random.default_rng((recipe.seed, 1))
        standing.append(beard.grow(assembly, maker, vertices, recipe.beard, recipe.tint, own))
        albedo = bearded(assembly, maker, vertices, albedo, standing[-1], recipe.tint)
    who = replace(who, beard=joined(standing))
    gloss = who.gloss

    def onto(cap: Floats) -> Floats:  # [SKIN_VERTICES] -> [N]
        full = np.zeros(len(vertices), np.float32)
        full[:SKIN_VERTICES] = cap
        return maker.surface.interpolate @ full[maker.surface.used]

    if worn is not None:
        under = hair.under(who.visibility[0], maker.visibility(who.rest)[:, 0])
        hangs = recipe.style in HANGING
        cap = rooted.softened(vertices[:SKIN_VERTICES], worn.cap) ** rooted.THIN
        albedo = scalp(assembly, maker, albedo, cap, recipe.tint, 0.97, under if hangs else None)
        grown = hair.grow(worn, recipe.tint, recipe.hairs, maker.occlusion, vertices, recipe.seed)
        # Light gets between strands: skin in full shadow under them would look like a hole.
        full = np.zeros(len(vertices), np.float32)
        full[:SKIN_VERTICES] = cap
        between = np.maximum(full[maker.surface.used], 0.8 * under)
        floor = between * np.array([[0.6], [0.5], [0.3], [0.3]], np.float32)
        visible = np.maximum(who.visibility, floor)
        used = vertices[maker.surface.used]
        visible = hairline.shaded(visible, used, grown.means)
        visible = hairline.lit(visible, used, grown.means, grown.seen)
        root = roots(recipe.tint)
        points = maker.surface.interpolate @ used
        albedo = hairline.rooted(albedo, points, grown.means, root)
        gloss = gloss * (1 - MATTE * np.maximum(onto(cap), hairline.near(points, grown.means)))
        fine = hair.before(assembly, vertices, worn, grown, recipe.tint, recipe.seed)
        inside = onto(np.maximum(cap, rooted.head_of_hair(face.neutral))) > WHOLLY
        shows = 1 - inside * mass.hidden(points, grown)
        who = replace(
            who, visibility=visible, hair=strands.joined([fine, grown]),
            opacity_factors=who.opacity_factors * shows.astype(np.float32),
        )  # fmt: skip
    else:
        cover, cropped = rooted.head_of_hair(face.neutral), recipe.style == BUZZ
        albedo = evened(
            albedo, onto(cover), maker.surface.interpolate @ vertices[maker.surface.used]
        )
        albedo = scalp(assembly, maker, albedo, cover, recipe.tint, CROPPED if cropped else SHAVEN)
    if recipe.style == BUZZ:
        gloss = gloss * (1 - MATTE * onto(cover))
        grown = hair.cropped(assembly, vertices, recipe.tint, recipe.hairs, recipe.seed)
        who = replace(who, hair=grown)
    cloth = clothes.cover(face.neutral, maker.surface)
    albedo = clothes.dyed(albedo, cloth, recipe.shirt, rng)
    gloss = gloss * (1 - cloth)
    seen, used = who.visibility, maker.surface.used
    args = assembly, vertices, used, seen, recipe.shirt
    shirt = [hem.collar(*args), hem.drape(*args)]
    return replace(who, albedo=albedo, gloss=gloss, beard=joined([who.beard, *shirt]))


def evened(albedo: Floats, scalp: Floats, points: Floats) -> Floats:  # [N, 3], [N] 0..1, [N, 3] mm
    """A scalp in the colour of the forehead: textures have brown blots there."""
    low, high = np.array(FOREHEAD_MM)
    forehead = np.median(albedo[((points > low) & (points < high)).all(1)], 0)
    return (albedo + EVENED * scalp[:, None] * (forehead - albedo)).astype(np.float32)


def calmed(assembly: Assembly, maker: Maker, who: identity.Identity) -> Floats:  # [N, 3]
    """The albedo without blots in the corners of the eyes and under the nose."""
    posing, head = maker.posing, maker.surface
    on_eye = np.isin(head.used, np.concatenate(posing.eyeballs)).astype(np.float32)
    skin = head.interpolate @ on_eye < 0.01
    edges = [who.geometry[np.concatenate([e.upper, e.lower])] for e in posing.lid_lines]
    edges.append(who.geometry[assembly.face.landmarks[UNDER_NOSE]])
    return lids.calmed(who.albedo, head.interpolate @ who.geometry[head.used], skin, edges)


def bearded(
    assembly: Assembly,
    maker: Maker,
    vertices: Floats,  # [V, 3] mm at rest
    albedo: Floats,  # [N, 3]
    strands: Beard,
    tint: tuple[float, float, float],
) -> Floats:  # [N, 3]
    """Roots show under a beard, and not on the lips."""
    head, middles = maker.surface, np.zeros((len(strands), 3), np.float32)
    strands.attach(vertices, middles, np.zeros((len(strands), 4), np.float32))
    root, points = roots(tint), head.interpolate @ vertices[head.used]
    dyed = hairline.rooted(albedo, points, middles, root, hairline.BEARD_MM2)
    where = beard.where(assembly, maker)[:, None]
    return (albedo + where * (dyed - albedo)).astype(np.float32)


def roots(tint: tuple[float, float, float]) -> Floats:  # [3] stored
    """Their colour on skin: less red than hair, as skin in half shadow is lit redder."""
    color = np.array(tint, np.float32) * SCALP
    return color + GREYER * (color.mean() - color)


def scalp(
    assembly: Assembly,
    maker: Maker,
    albedo: Floats,
    cap: NDArray[np.floating],  # [SKIN_VERTICES] 0..1
    tint: tuple[float, float, float],
    strength: float,
    under: Floats | None = None,  # [U] 0..1 where hair lies over it
) -> Floats:
    """Colour the skin under the hair, softly at the hairline: roots, not a bald head, show."""
    full = np.zeros(len(assembly.face.neutral), np.float32)
    full[:SKIN_VERTICES] = np.clip(np.asarray(cap, np.float32), 0, 1)
    head = maker.surface
    x, y, z = (head.interpolate @ assembly.face.neutral[head.used]).T
    uneven = np.sin(3.1 * x + np.sin(2.3 * y)) * np.sin(3.7 * y + np.sin(2.9 * z)) * np.sin(3.3 * z)
    cover = np.clip((head.interpolate @ full[head.used] - 0.1 + 0.1 * uneven) / 0.8, 0, 1)
    if under is not None:
        cover = np.maximum(cover, head.interpolate @ under)
    root = roots(tint) * (1 + 0.2 * uneven[:, None])
    return (albedo + strength * cover[:, None] * (root - albedo)).astype(np.float32)


def run(assembly: Assembly, wardrobe: Wardrobe, folder: Path, card: dict[str, object]) -> None:
    """Write every avatar beside the prior."""
    from tqdm import tqdm

    maker = Maker(folder)
    for name, recipe in tqdm(RECIPES.items(), desc="avatars", unit="avatar"):
        who = make(assembly, maker, wardrobe, name, recipe)
        identity.save(who, folder, {"recipe": asdict(recipe), "detail": detail.card(), **card})


def eyes(wardrobe: Wardrobe, maker: Maker) -> dict[str, NDArray[np.uint8]]:
    """Colours of the eyes' Gaussians in every eye colour: so that anyone can be given eyes."""
    rows, skin = maker.anchor_kinds == mesh_parts.EYE, np.ones((8, 16, 3), np.float32)
    return {
        f"eye.{name}": np.rint(maker.albedo(skin, wardrobe.eye(name))[rows] * 255).astype(np.uint8)
        for name in people.EYES
    }
