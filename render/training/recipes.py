"""The people who ship, as recipes."""

from dataclasses import dataclass, field

from render.training.data.people import Skin
from render.training.geometry.beard import BeardStyle
from render.training.look.brows import Brows

BALD, BUZZ = "bald", "buzz"
HANGING = ("long01", "afro01")  # styles that hide skin without touching it
SWEPT = ("bob02_swept",)  # that stand off a temple: seen from inside


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
    tone: tuple[float, float, float] = (1, 1, 1)  # gain of the skins' stored colours
    stubble: float = 0.0  # 0 shaven .. 1 full
    beard: BeardStyle | None = None
    hairs: int = 22_600
    whites: tuple[float, float, float] = (1, 1, 1)  # of the eyes: gain
    irises: float = 1.0  # gain
    wide: float = 0.0  # how far the lids are apart at rest, of eyeWide


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
WARM, DEEP = (0.72, 0.65, 0.56), 0.45  # whites and irises among dark skin
FINE, SOFT, FULL = Brows(440, 0.72, 1.2, 1.0), Brows(500, 0.85, 0.6, 0.5), Brows(680, 1.15)
RECIPES = {
    "ada": Recipe(5, 0.40, 2.1, ("young_lightskinned_female3", "young_lightskinned_female2", 0.3),
                  "green", "bob02_swept", BROWN, MOSS, Skin(0.9, 0.35, 0.5), FINE, 1.15,
                  (1.0, 0.995, 1.055)),
    "ben": Recipe(11, 0.65, -1.6, ("young_lightskinned_male2", "young_lightskinned_male2", 0.0),
                  "brownlight", "short04", DARK, NAVY, Skin(0.8, 0.0, -0.2), FULL, 0.9,
                  (0.985, 0.995, 1.065), stubble=0.30, wide=0.3),
    "chen": Recipe(31, 0.6, -0.9, ("young_lightskinned_male3", "middleage_lightskinned_male", 0.4),
                   "brown", "short02", BLACK, CHALK, Skin(0.7, 0.0, 0.2, age=0.2),
                   Brows(600, 1.1), 0.8, (0.98, 0.995, 1.075), wide=0.25),
    "dalia": Recipe(42, 0.5, 1.9,
                    ("young_lightskinned_female2", "middleage_darkskinned_female", 0.35),
                    "brown", "long01", BLACK, WINE, Skin(0.8, 0.0, 0.7), SOFT, 1.2,
                    (1.0, 1.0, 1.03)),
    "emil": Recipe(53, 0.65, -0.7, ("young_lightskinned_male", "young_lightskinned_male3", 0.5),
                   "blue", "short03_swept", BLOND, COAL, Skin(0.9, 0.3, 0.2),
                   tone=(0.98, 1.0, 1.09)),
    "femi": Recipe(64, 0.6, 1.5, ("middleage_darkskinned_female", "young_darkskinned_male", 0.45),
                   "brown", "afro01", (0.13, 0.10, 0.085), CHALK,
                   Skin(0.3, 0.0, 0.2, melanin=1.0, age=0.1), SOFT, 1.4, (1.08, 1.325, 1.47),
                   whites=WARM, irises=DEEP),
    "greta": Recipe(75, 0.6, 1.2,
                    ("middleage_lightskinned_female2", "old_lightskinned_male2", 0.25),
                    "grey", "short01", GREY, SKY, Skin(1.1, 0.2, 0.1, age=1.0), SOFT, 0.9,
                    (0.96, 0.985, 1.06)),
    "hugo": Recipe(86, 0.7, -1.9, ("middleage_lightskinned_male", "old_lightskinned_male2", 0.35),
                   "grey", BALD, DARK, MOSS, Skin(0.8, 0.0, -0.3, age=0.65), FULL, 0.8,
                   (0.965, 1.01, 1.13), 0.9,
                   BeardStyle(5600, 11.0), wide=0.5),
    "ines": Recipe(97, 0.45, 1.7,
                    ("young_lightskinned_female2", "young_lightskinned_female3", 0.6),
                   "blue", "ponytail01", RED, SAND, Skin(1.2, 0.9, 0.5), FINE, 1.1,
                    (0.995, 0.995, 1.05)),
    "joao": Recipe(108, 0.65, -1.3,
                    ("middleage_darkskinned_male", "young_lightskinned_male2", 0.45),
                   "brown", BUZZ, BLACK, SAND, Skin(0.5, 0.0, 0.2, melanin=0.5, age=0.3), FULL, 1.0,
                    (0.97, 0.97, 1.01), 0.35, BeardStyle(4600, 1.9, 1.0, 0.45, 0.3, 1),
                   hairs=16_000, whites=(0.88, 0.82, 0.75), wide=0.4),
    "kofi": Recipe(23, 0.65, -0.9, ("young_darkskinned_male", "young_darkskinned_male", 0.0),
                   "brown", "short01", BLACK, SKY, Skin(0.3, 0.0, 0.1, melanin=1.0), FULL, 1.35,
                   (1.12, 1.25, 1.33), 0.9,
                   BeardStyle(3600, 7.0, 0.7), hairs=15_600, whites=WARM, irises=DEEP),
    "lena": Recipe(119, 0.5, 2.2,
                    ("young_lightskinned_female3", "young_lightskinned_female3", 0.0),
                   "brownlight", "long01", BLOND, NAVY, Skin(0.9, 0.1, 0.6),
                   Brows(440, 0.75, 1.2, 1.0), 1.1, (1.0, 0.995, 1.06)),
}  # fmt: skip
