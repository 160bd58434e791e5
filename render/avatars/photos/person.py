"""Somebody from photographs, all the steps: geometry and skin, then the whole avatar."""

from dataclasses import dataclass

from render.avatars import hair_transfer
from render.avatars.maker import Maker
from render.avatars.photos import brows, dress
from render.avatars.photos.colors import complete, eyes, hair, skin
from render.avatars.photos.colors.light import DARK
from render.avatars.photos.shape import fit, irises, places, point_shapes, shapes
from render.avatars.photos.shape.fit import FaceFit
from render.avatars.photos.shape.picture import Photo
from render.avatars.photos.shape.places import PointPlaces
from render.avatars.photos.shape.point_shapes import PointShapes
from render.avatars.registration import Progress
from render.decoder import identity
from render.decoder.identity import Identity
from render.types import Doubles, Floats
from sensors.types import InputError

MOST_LEFT_MM = 4.0  # 1 to 2 is what a face leaves


@dataclass(frozen=True)
class PhotographedHead:
    geometry: Floats  # [V, 3] mm at rest
    skin: Floats  # [1024, 2048, 3] 0..1
    eye: str  # colour, a name of Maker.eyes
    hair: Doubles | None  # [3] linear albedo, where hair is seen
    beard: Doubles | None  # the same
    left_mm: float  # see FaceFit


def make(maker: Maker, photos: list[Photo], progress: Progress) -> PhotographedHead:
    progress("shape", 0.0)
    table = places.load()
    known = shapes.build(maker, table)
    progress("shape", 0.2)
    found = fitted(maker, table, point_shapes.load(), photos)
    if not found.left_mm < MOST_LEFT_MM:
        raise InputError(
            f"--photos: expected photographs of one face, got points {found.left_mm:.1f} mm away "
            f"from any; leave out, one after the other, {', '.join(p.name for p in photos)}"[:500]
        )
    geometry = known.through(found.points).astype("f4")
    progress("skin", 0.4)
    painted = skin.paint(maker, table, photos, found, geometry)
    progress("skin", 1.0)
    return PhotographedHead(
        geometry=geometry,
        skin=painted.atlas,
        eye=eyes.color(photos, painted.lights),
        hair=hair.color(maker, photos, found, geometry, painted),
        beard=None if painted.beard is None else hair.dye(painted.beard + DARK),
        left_mm=found.left_mm,
    )


def avatar(
    maker: Maker,
    name: str,
    head: PhotographedHead,
    lender: Identity | None = None,  # of the hair; None: no hair
    eye: str | None = None,  # None: as photographed
) -> Identity:
    """With the brows that are seen, the lender's hair in the colour that is seen, and a shirt."""
    if lender and head.hair is not None:
        lender = dress.dyed(maker, lender, head.hair)
    geometry = dress.padded(maker, head.geometry)
    who = brows.grown(maker, maker.identity(name, geometry, head.skin, eye or head.eye))
    if lender:
        who = hair_transfer.worn(maker, who, lender)
    return dress.dressed(maker, who, lender or identity.load(complete.PLAIN))


def fitted(maker: Maker, table: PointPlaces, people: PointShapes, photos: list[Photo]) -> FaceFit:
    """The face's points, poses and lenses, in the size that the irises tell."""
    return irises.sized(fit.fit(maker, table, people, [photo.view for photo in photos]), photos)
