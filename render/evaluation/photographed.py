"""Held-out people as their photographs show them, and how near what is made of these comes.

People are drawn as `eval prior` draws them, from the face data, and dressed with brows, lashes and
the hair of a shipped avatar. Their photographs are pictures of Gaussians: other light, other
lenses, some with a smile or an open mouth.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import cameras
from render.avatars import hair_transfer, lashes, registration, sheet
from render.avatars.alignment import similarity
from render.avatars.maker import Maker
from render.avatars.photos.person import PhotographedHead, avatar
from render.avatars.photos.shape import picture
from render.avatars.photos.shape.detector import FaceDetector
from render.avatars.photos.shape.picture import Photo
from render.decoder import identity
from render.decoder.beard import joined
from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.decoder.learned import avatar_files
from render.gl.contexts import GLContext
from render.lighting import LUMINANCE
from render.splats.renderer import wrap_context
from render.training.data import face_data, people
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry import assembly as assemblies
from render.training.look.brows import Brows, grow
from render.types import AHEAD, Floats
from sensors import folders

SIZE_PX = 1024
LIGHTS = ("soft", "studio", "evening")
YAWS = (0.0, 35.0, -35.0, 18.0, -18.0)  # degrees, of the photographs in order
DISTANCES_MM, SCAN_MM = (320.0, 700.0), 500.0  # lenses as of 30 to 67 mm, 48 mm
FRONTS: tuple[dict[str, float], ...] = (
    {},
    {"mouthSmile_L": 0.7, "mouthSmile_R": 0.7, "cheekSquint_L": 0.4, "cheekSquint_R": 0.4},
    {"jawOpen": 0.35},
)
COARSE = 16  # colours across the face
DARKEST = np.float32(0.02)  # added before logarithms


@dataclass(frozen=True)
class HeldOutSitter:
    """A held-out person."""

    geometry: Floats  # [V, 3] mm at rest
    skin: Floats  # [1024, 2048, 3] stored
    eye: str
    who: Identity
    lender: Identity  # of the hair and the shirt
    light: str  # of the photographs
    photos: list[Photo]


class PhotoStudio:
    """Photographs people."""

    def __init__(self, face_folder: Path, maker: Maker, context: GLContext) -> None:
        self.maker = maker
        self._assembly = assemblies.build(face_data.load(face_folder))
        cache = folders.cache() / "wardrobe"
        cache.mkdir(parents=True, exist_ok=True)
        self._wardrobe = Wardrobe(self._assembly.face, cache)
        self.renderer = wrap_context(context)
        self._decoders = {light: Decoder.load(gaussians="65k", light=light) for light in LIGHTS}
        self.face, _ = registration.visible(maker)

    def sitter(self, index: int, seed: int, detector: FaceDetector) -> HeldOutSitter:
        face, rng = self._assembly.face, np.random.default_rng((seed, index))
        person = people.draw(face, people.HELD_OUT + index)
        geometry, skin = people.neutral(face, person), self._wardrobe.texture(person)
        who = self.maker.identity("sitter", geometry, skin, person.eye)
        at, shipped = who.geometry, avatar_files.shipped()
        lender = identity.load(shipped[int(rng.integers(len(shipped)))])
        dark = (0.16, 0.11, 0.08)
        own = grow(face, at, self._assembly.normals(at), self.maker.skin, Brows(), dark, index)
        lash = lashes.grow(self.maker.posing, who.rest)
        who = hair_transfer.worn(self.maker, replace(who, beard=joined([lash, own])), lender)
        light, distance = LIGHTS[index % len(LIGHTS)], float(rng.uniform(*DISTANCES_MM))
        photos = list[Photo]()
        for k, yaw in enumerate(YAWS):
            rig = FRONTS[index % len(FRONTS)] if k == 0 else {}
            pitch = float(rng.uniform(-8, 8))
            shot = self.picture(who, light, yaw + float(rng.uniform(-4, 4)), pitch, distance, rig)
            photos.append(picture.seen(f"sitter {index}, {yaw:.0f}", shot, None, detector))
        return HeldOutSitter(geometry, skin, person.eye, who, lender, light, photos)

    def scan(self, seed: int, detector: FaceDetector) -> tuple[Floats, list[Photo]]:
        """The face data's scan [V, 3], and its pictures: bald, with lashes."""
        face, rng = self._assembly.face, np.random.default_rng(seed)
        geometry = face.scan()
        skin = face.image("albedo/lps_leeperrysmith.jpg")[..., :3]
        who = self.maker.identity("scan", geometry, skin, "brown")
        who = replace(who, beard=lashes.grow(self.maker.posing, who.rest))
        photos = list[Photo]()
        for yaw in YAWS:
            shot = self.picture(who, LIGHTS[0], yaw, float(rng.uniform(-8, 8)), SCAN_MM)
            photos.append(picture.seen(f"scan, {yaw:.0f}", shot, None, detector))
        return geometry, photos

    def picture(
        self,
        who: Identity,
        light: str,
        yaw: float,
        pitch: float = 0.0,
        distance_mm: float = cameras.PORTRAIT_DISTANCE_MM,
        rig: dict[str, float] | None = None,
    ) -> NDArray[np.uint8]:  # [1024, 1024, 3]
        decoder = self._decoders[light]
        cloud = decoder.decode(sheet.code(decoder, rig or {}), AHEAD, who)[1]
        self.renderer.draw(cloud, cameras.portrait(SIZE_PX, SIZE_PX, yaw, pitch, distance_mm))
        return self.renderer.read_rgba()[..., :3].copy()

    def beside(self, sitter: HeldOutSitter, found: PhotographedHead) -> NDArray[np.uint8]:
        """[1024, 6144, 3]: three photographs, then the avatar from there, in the same light."""
        who = avatar(self.maker, "made", found, sitter.lender)
        own = [self.picture(who, sitter.light, yaw) for yaw in YAWS[:3]]
        return np.concatenate([*(p.picture for p in sitter.photos[:3]), *own], 1)

    def errors_mm(self, made: Floats, truth: Floats, scaled: bool = False) -> Floats:
        """Of the face's vertices [n], after a rigid motion; `scaled`: and a change of size."""
        a, b = made[self.face].astype(np.float64), truth[self.face].astype(np.float64)
        off = similarity(a, b, scaled=scaled).place(a) - b
        return np.linalg.norm(off, axis=1).astype(np.float32)


def shape_signature(studio: PhotoStudio, geometry: Floats) -> Floats:  # [V, 3] -> [n]
    """How a face differs from the mean face, whatever its size; of length one."""
    mean = studio.maker.template[studio.face].astype(np.float64)
    own = geometry[studio.face].astype(np.float64)
    off = (similarity(own, mean, scaled=True).place(own) - mean).ravel()
    return (off / np.linalg.norm(off)).astype(np.float32)


def color_signature(skin: Floats, mean: Floats) -> Floats:  # [1024, 2048, 3] -> [n]
    """How the colours of a face differ from others' `mean` of `colors`; of length one."""
    off = (colors(skin) - mean).ravel()
    return (off / np.linalg.norm(off)).astype(np.float32)


def colors(skin: Floats) -> Floats:  # [1024, 2048, 3] -> [n, 3]
    """Coarse, of the middle of the face, as logarithms; but for the brightness of all, which a
    photograph of unknown exposure does not tell."""
    half = skin[:, : skin.shape[1] // 2]
    step = half.shape[0] // COARSE
    coarse = half.reshape(COARSE, step, COARSE, step, 3).mean((1, 3))
    low, high = COARSE // 5, COARSE - COARSE // 5
    middle = coarse[low:high, low:high].reshape(-1, 3)
    return np.log(middle / np.median(middle @ LUMINANCE) + DARKEST).astype(np.float32)
