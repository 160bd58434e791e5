"""How recipes become avatar files."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import clothes, strands
from render.avatars import detail, hairline, lashes
from render.avatars.maker import Maker
from render.decoder import identity, mesh_parts
from render.decoder.beard import Beard, joined
from render.decoder.mesh_parts import SKIN_VERTICES
from render.training.data import age, people
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry import beard, cards, hair, hem, mass, rooted, teeth
from render.training.geometry.assembly import Assembly
from render.training.look import brows, eyes, lids, wrinkles
from render.training.recipes import BALD, BUZZ, HANGING, RECIPES, SWEPT, Recipe
from render.types import Floats

BROW_DARKER, BRIGHTEST_BROW = 0.8, 0.36  # than the hair; stored
UNDER_NOSE = slice(31, 36)  # of the 68 landmarks
HANGS_MM = 6.0  # over which the edge of hair that hangs before skin is evened
CROPPED, SHAVEN = 0.8, 0.16  # share of the roots' colour on the scalp
FOREHEAD_MM, EVENED = ((-30, 60, 60), (30, 85, 200)), 0.85
WHOLLY = 0.6  # of the scalp: skin so far inside it is not drawn where hair hides it
BETWEEN = 0.6, 0.5, 0.3, 0.3  # least shares of light on skin below hair
GREYER = 0.4  # roots than hair
SCALP = 0.8, 0.5  # brightness of a covered scalp, as a share of the hair's, and more if light


def make(
    assembly: Assembly, maker: Maker, wardrobe: Wardrobe, name: str, recipe: Recipe
) -> identity.Identity:
    """Geometry and texture of the recipe, Theta_id from the encoder, hair from the cards."""
    face = assembly.face
    rng = np.random.default_rng(recipe.seed)
    modes = (rng.standard_normal(100) * recipe.strength).astype(np.float32)
    modes = people.leaning_to(face, modes, recipe.feminine)
    bare = people.levelled(face.landmarks, people.relaxed(face, modes, recipe.wide))
    bare = age.aged(face.neutral, face.landmarks, bare, recipe.skin.age)
    skin = np.arange(len(bare)) < SKIN_VERTICES
    dressed = teeth.set_back(face, clothes.worn(face.neutral, bare, assembly.normals(bare), skin))
    first, second, mix = recipe.skins
    person = people.VirtualPerson(
        modes, (f"mh_{first}.jpg", f"mh_{second}.jpg"), mix, np.array(recipe.tone, np.float32),
        recipe.eye,
        np.ones(len(face.rig_names), np.float32), recipe.skin,
    )  # fmt: skip
    vertices = maker.posing.rest(dressed).geometry
    worn = cover = None
    if recipe.style not in (BALD, BUZZ):
        worn = cards.bound(assembly, vertices, assembly.normals(vertices), recipe.style)
        cover = worn.corners if worn.texture is None else cards.opaque(worn)
    eye = eyes.toned(wardrobe.eye(recipe.eye), recipe.whites, recipe.irises)
    who = maker.identity(name, dressed, wardrobe.texture(person), eye, cover)
    albedo = calmed(assembly, maker, who)
    albedo = wrinkles.at_rest(albedo, maker.wrinkles, recipe.skin.age)
    who = replace(who, wrinkles=wrinkles.depth(recipe.skin.age))
    albedo = beard.stubble(assembly, maker, albedo, recipe.stubble, rng)
    dark = np.array(recipe.tint) * min(BROW_DARKER, BRIGHTEST_BROW / max(recipe.tint))
    standing = [
        lashes.grow(maker.posing, who.rest, recipe.lashes),
        brows.grow(
            face, vertices, assembly.normals(vertices), maker.skin, recipe.brows,
            (float(dark[0]), float(dark[1]), float(dark[2])), recipe.seed,
        ),
    ]  # fmt: skip
    if recipe.beard:
        own = np.random.default_rng((recipe.seed, 1))
        standing.append(beard.grow(assembly, maker, vertices, recipe.beard, recipe.tint, own))
        dyed = bearded(assembly, maker, vertices, albedo, standing[-1], recipe.tint)
        albedo += np.float32(recipe.beard.roots) * (dyed - albedo)
    who = replace(who, albedo=albedo, beard=joined(standing))
    if worn is None:
        who = shaved(assembly, maker, who, recipe)
    else:
        who = haired(assembly, maker, who, worn, recipe)
    head, used, points = maker.surface, maker.surface.used, face.neutral[maker.surface.used]
    cloth = clothes.cover(head.interpolate @ points, head.interpolate @ skin[used].astype("f4"))
    shirt = assembly, vertices, used, who.visibility, recipe.shirt
    return replace(
        who,
        albedo=clothes.dyed(who.albedo, cloth, recipe.shirt, rng),
        gloss=who.gloss * (1 - cloth),
        visibility=clothes.shaded(who.visibility, points),
        beard=joined([who.beard, hem.collar(*shirt), hem.drape(*shirt)]),
    )


def haired(
    assembly: Assembly, maker: Maker, who: identity.Identity, worn: cards.Cards, recipe: Recipe
) -> identity.Identity:
    """With a head of hair, and what that does to the skin below and beside it."""
    vertices, head, tint = who.geometry, maker.surface, recipe.tint
    used, root = vertices[head.used], roots(tint)
    points = head.interpolate @ used
    bald = maker.visibility(who.rest)
    under = hair.under(who.visibility[0], bald[:, 0])
    cap = rooted.softened(vertices[:SKIN_VERTICES], worn.cap) ** rooted.THIN
    hangs = rooted.softened(used, under, HANGS_MM) if recipe.style in HANGING else None
    albedo = scalp(assembly, maker, who.albedo, cap, tint, 0.97, hangs)
    grown = hair.grow(worn, tint, recipe.hairs, maker.occlusion, vertices, recipe.seed)
    fine = hair.before(assembly, vertices, worn, grown, tint, recipe.seed)
    half = len(fine) // 2  # their roots; tips are left out of thinner heads
    # Light gets between strands: skin in full shadow under them would look like a hole.
    between = np.maximum(on_vertices(maker, cap), 0.8 * under)
    visible = np.maximum(who.visibility, between * np.array(BETWEEN, np.float32)[:, None])
    visible = hairline.shaded(visible, used, grown.means)
    inside = np.maximum(cap, rooted.head_of_hair(assembly.face.neutral))
    visible = hairline.lit(visible, used, grown.means, grown.seen)
    visible = hairline.cast(visible, used, grown.means)
    skin, normals = vertices[:SKIN_VERTICES], assembly.normals(vertices)[:SKIN_VERTICES]
    tops = hairline.LOW_MM, hairline.LIES_MM
    over = [hairline.feet(skin, normals, grown.means, highest) for highest in tops]
    albedo = hairline.rooted(albedo, points, grown.means, root)
    below = hairline.rooted(albedo, points, over[0], root)
    albedo += onto(maker, rooted.growing(skin, inside))[:, None] * (below - albedo)
    matte = hairline.MATTE * np.maximum(onto(maker, cap), hairline.near(points, over[1]))
    whole = mass.lined(grown, skin) if recipe.style in SWEPT else grown
    before, after = (head.interpolate @ seen.mean(1) for seen in (bald, visible.T))
    hidden = (onto(maker, inside) > WHOLLY) & mass.hidden(points, grown)
    return replace(
        who,
        albedo=hairline.paler(albedo, before, after),
        gloss=(who.gloss * (1 - matte)).astype(np.float32),
        opacity_factors=np.where(hidden, 0, who.opacity_factors).astype(np.float32),
        visibility=visible,
        hair=strands.joined([fine.rows(slice(half)), whole, fine.rows(slice(half, None))]),
    )


def shaved(
    assembly: Assembly, maker: Maker, who: identity.Identity, recipe: Recipe
) -> identity.Identity:
    """Bald, or with hair of a few millimetres."""
    cover, cropped = rooted.head_of_hair(assembly.face.neutral), recipe.style == BUZZ
    wide = rooted.softened(
        who.geometry[:SKIN_VERTICES], rooted.softened(assembly.face.neutral[:SKIN_VERTICES], cover)
    )
    albedo = evened(maker, who, onto(maker, wide))
    albedo = scalp(assembly, maker, albedo, cover, recipe.tint, CROPPED if cropped else SHAVEN)
    who = replace(who, albedo=albedo)
    if not cropped:
        return who
    grown = hair.cropped(assembly, who.geometry, recipe.tint, recipe.hairs, recipe.seed)
    used, points = (
        who.geometry[maker.surface.used],
        maker.surface.interpolate @ who.geometry[maker.surface.used],
    )
    matte = np.maximum(onto(maker, cover), hairline.near(points, grown.means))
    return replace(
        who,
        hair=grown,
        gloss=(who.gloss * (1 - hairline.MATTE * matte)).astype(np.float32),
        visibility=hairline.shaded(who.visibility, used, grown.means),
    )


def on_vertices(maker: Maker, cap: Floats) -> Floats:  # [SKIN_VERTICES] -> [U]
    used = maker.surface.used
    return np.where(used < SKIN_VERTICES, cap[np.minimum(used, SKIN_VERTICES - 1)], 0)


def onto(maker: Maker, cap: Floats) -> Floats:  # [SKIN_VERTICES] -> [N]
    return maker.surface.interpolate @ on_vertices(maker, cap)


def evened(maker: Maker, who: identity.Identity, scalp: Floats) -> Floats:  # [N] -> [N, 3]
    """A scalp in the colour of the forehead: textures have brown blots there."""
    (low, high), head = np.array(FOREHEAD_MM), maker.surface
    points = head.interpolate @ who.geometry[head.used]
    forehead = np.median(who.albedo[((points > low) & (points < high)).all(1)], 0)
    return (who.albedo + EVENED * scalp[:, None] * (forehead - who.albedo)).astype(np.float32)


def calmed(assembly: Assembly, maker: Maker, who: identity.Identity) -> Floats:  # [N, 3]
    """The albedo without blots in the corners of the eyes and under the nose; edges of the lids."""
    posing, head, mesh = maker.posing, maker.surface, who.geometry
    skin = head.share_on(np.concatenate(posing.eyeballs)) < 0.01
    points = head.interpolate @ mesh[head.used]
    sides = [(mesh[line.upper], mesh[line.lower]) for line in posing.lid_lines]
    edges = [*map(np.concatenate, sides), mesh[assembly.face.landmarks[UNDER_NOSE]]]
    return lids.rimmed(lids.calmed(who.albedo, points, skin, edges), points, skin, sides)


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
    color = np.array(tint, np.float32)
    color *= SCALP[0] + SCALP[1] * color.mean()
    return color + GREYER * (color.mean() - color)


def scalp(
    assembly: Assembly,
    maker: Maker,
    albedo: Floats,
    cap: Floats,  # [SKIN_VERTICES] 0..1
    tint: tuple[float, float, float],
    strength: float,
    under: Floats | None = None,  # [U] 0..1 where hair lies over it
) -> Floats:
    """Colour the skin under the hair, softly at the hairline: roots, not a bald head, show."""
    head = maker.surface
    x, y, z = (head.interpolate @ assembly.face.neutral[head.used]).T
    uneven = np.sin(3.1 * x + np.sin(2.3 * y)) * np.sin(3.7 * y + np.sin(2.9 * z)) * np.sin(3.3 * z)
    cover = np.clip((onto(maker, cap) - 0.1 + 0.1 * uneven) / 0.8, 0, 1)
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


def eye_colors(wardrobe: Wardrobe, maker: Maker) -> dict[str, NDArray[np.uint8]]:
    """Colours of the eyes' Gaussians in every eye colour: so that anyone can be given eyes."""
    rows, skin = maker.anchor_kinds == mesh_parts.EYE, np.ones((8, 16, 3), np.float32)
    return {
        f"eye.{name}": np.rint(maker.albedo(skin, wardrobe.eye(name))[rows] * 255).astype(np.uint8)
        for name in people.EYES
    }
