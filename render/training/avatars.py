"""The people who ship: recipes, and how they become avatar files."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import identity, mesh_parts
from render.avatar import Maker
from render.training import beard, hair, people
from render.training.assembly import Assembly
from render.training.beard import Strands
from render.training.face_data import SKIN_VERTICES, geometry

Floats = NDArray[np.float32]
BALD, BUZZ = "bald", "buzz"


@dataclass(frozen=True)
class Recipe:
    """One avatar."""

    seed: int  # of the 100 identity modes
    strength: float  # standard deviations of the modes
    skins: tuple[str, str, float]  # two skins and the share of the second
    eye: str
    style: str  # of hair, or "bald", "buzz"
    tint: tuple[float, float, float]  # of hair
    stubble: float = 0.0  # 0 shaven .. 1 full
    beard: Strands | None = None
    hairs: int = 3200


BLACK, BROWN, DARK = (0.10, 0.085, 0.08), (0.30, 0.19, 0.12), (0.17, 0.12, 0.09)
BLOND, RED, GREY = (0.52, 0.42, 0.30), (0.42, 0.19, 0.09), (0.52, 0.51, 0.50)
RECIPES = {
    "ada": Recipe(5, 0.5, ("young_lightskinned_female3", "young_lightskinned_female2", 0.3),
                  "green", "bob02_swept", BROWN),
    "ben": Recipe(11, 0.5, ("young_lightskinned_male2", "young_lightskinned_male2", 0.0),
                  "brownlight", "short04", DARK, 0.25),
    "chen": Recipe(31, 0.6, ("young_lightskinned_male3", "middleage_lightskinned_male", 0.4),
                   "brown", "short02", BLACK),
    "dalia": Recipe(42, 0.55, ("young_lightskinned_female2", "middleage_darkskinned_female", 0.35),
                    "brown", "long01", BLACK, hairs=4200),
    "emil": Recipe(53, 0.6, ("young_lightskinned_male", "young_lightskinned_male3", 0.5),
                   "blue", "short03_swept", BLOND),
    "femi": Recipe(64, 0.6, ("middleage_darkskinned_female", "young_darkskinned_male", 0.45),
                   "brown", "afro01", (0.11, 0.085, 0.07), hairs=4200),
    "greta": Recipe(75, 0.5, ("middleage_lightskinned_female2", "old_lightskinned_male2", 0.15),
                    "grey", "short01", GREY),
    "hugo": Recipe(86, 0.6, ("middleage_lightskinned_male", "middleage_lightskinned_male", 0.0),
                   "grey", BALD, DARK, 0.9, Strands(2400, 12.0)),
    "ines": Recipe(97, 0.55, ("young_lightskinned_female2", "young_lightskinned_female3", 0.6),
                   "blue", "ponytail01", RED, hairs=3800),
    "joao": Recipe(108, 0.6, ("middleage_darkskinned_male", "young_lightskinned_male2", 0.45),
                   "brown", BUZZ, BLACK, 0.6),
    "kofi": Recipe(23, 0.5, ("young_darkskinned_male", "young_darkskinned_male", 0.0),
                   "brown", "short01", BLACK, 0.9, Strands(2400, 7.5, 0.7)),
    "lena": Recipe(119, 0.55, ("young_lightskinned_female3", "young_lightskinned_female3", 0.0),
                   "brownlight", "long01", BLOND, hairs=3800),
}  # fmt: skip


def make(assembly: Assembly, maker: Maker, name: str, recipe: Recipe) -> identity.Identity:
    """Geometry and texture of the recipe, Theta_id from the encoder, hair from the cards."""
    face = assembly.face
    rng = np.random.default_rng(recipe.seed)
    modes = (rng.standard_normal(100) * recipe.strength).astype(np.float32)
    first, second, mix = recipe.skins
    skin = face.image(f"albedo/mh_{first}.jpg")[..., :3]
    skin = skin + mix * (face.image(f"albedo/mh_{second}.jpg")[..., :3] - skin)
    skin = skin.astype(np.float32, copy=False)
    vertices = maker.posing.rest(geometry(face, modes)).geometry
    worn = None
    if recipe.style not in (BALD, BUZZ):
        worn = hair.cards(assembly, vertices, assembly.normals(vertices), recipe.style)
    cover = None
    if worn is not None:
        cover = worn.corners if worn.texture is None else hair.opaque(worn)
    who = maker.identity(name, geometry(face, modes), skin, recipe.eye, cover)
    albedo = beard.stubble(assembly, maker, who.albedo, recipe.stubble, recipe.tint, rng)
    if recipe.beard:
        own = np.random.default_rng((recipe.seed, 1))
        strands = beard.grow(assembly, maker, vertices, recipe.beard, recipe.tint, own)
        who = replace(who, beard=strands)
    if worn is None:
        if recipe.style == BUZZ:
            cap = np.load(face.folder / "hair" / "hair_short03.npz", allow_pickle=False)
            albedo = scalp(assembly, maker, albedo, cap["scalp_cap"], recipe.tint, 0.72, rng)
        return replace(who, albedo=albedo)
    albedo = scalp(assembly, maker, albedo, worn.cap, recipe.tint, 0.95, rng)
    strands = hair.grow(worn, recipe.tint, recipe.hairs, maker.occlusion, vertices, recipe.seed)
    # Roots are lit as hair is, from between the strands: a scalp in full shadow looks like holes.
    cap = np.zeros(len(vertices), np.float32)
    cap[:SKIN_VERTICES] = worn.cap
    floor = cap[maker.surface.used] * np.array([[0.45], [0.3]], np.float32)
    return replace(who, albedo=albedo, seen=np.maximum(who.seen, floor), hair=strands)


def scalp(
    assembly: Assembly,
    maker: Maker,
    albedo: Floats,
    cap: NDArray[np.floating],  # [SKIN_VERTICES] 0..1
    tint: tuple[float, float, float],
    strength: float,
    rng: np.random.Generator,
) -> Floats:
    """Colour the skin under the hair, softly at the hairline: roots, not a bald head, show."""
    full = np.zeros(len(assembly.face.neutral), np.float32)
    full[:SKIN_VERTICES] = np.clip(np.asarray(cap, np.float32), 0, 1)
    cover = maker.surface.interpolate @ full[maker.surface.used]
    cover = np.clip(cover * (1 + 0.25 * rng.standard_normal(len(cover))), 0, 1) * strength
    root = np.array(tint, np.float32) * hair.ROOT_DARK
    shade = 0.85 + 0.3 * rng.random((len(cover), 1))
    return (albedo + cover[:, None] * (root * shade - albedo)).astype(np.float32)


def run(assembly: Assembly, folder: Path, card: dict[str, object]) -> None:
    """Write every avatar beside the prior."""
    from tqdm import tqdm

    maker = Maker(folder)
    for name, recipe in tqdm(RECIPES.items(), desc="avatars", unit="avatar"):
        who = make(assembly, maker, name, recipe)
        identity.save(who, folder, {"recipe": asdict(recipe), **card})


def eyes(
    assembly: Assembly, kinds: NDArray[np.integer], at: Floats, mixing: Floats
) -> dict[str, NDArray[np.uint8]]:
    """Colours of the eyes' Gaussians in every eye colour: so that anyone can be given eyes."""
    from render import textures

    rows = kinds == mesh_parts.EYE
    plain = np.tile(np.array([[0.97, 0.94, 0.92]], np.float32), (int(rows.sum()), 1))
    out = {}
    for name in people.EYES:
        picture = people.eye_texture(assembly.face, name)
        skin = np.ones((8, 16, 3), np.float32)
        levels = textures.levels(kinds[rows], at[rows], plain, skin, picture)
        color = np.einsum("nl,nlc->nc", mixing[rows], levels)
        out[f"eye.{name}"] = np.rint(np.clip(color, 0, 1) * 255).astype(np.uint8)
    return out
