"""The decoder's face as numbers for the capture: its lips and teeth, and the check on vertices."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from encoder.capture.motion.contacts import LipGeometry, TeethGeometry

Floats = NDArray[np.float32]
# Teeth in the face data's order of vertices, where the decoder names no such sets.
TEETH_UPPER, TEETH_LOWER = np.arange(17_039, 19_247), np.arange(19_247, 21_451)


def every_face() -> tuple[Callable[[Floats], list[Floats]], dict[str, NDArray[np.int32]]]:
    """rig [53] -> the vertices of every shipped avatar, looking ahead; and the vertex sets."""
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files
    from render.types import AHEAD

    decoder = Decoder.load()
    people = [identity.load(name) for name in avatar_files.shipped()]

    def vertices(rig: Floats) -> list[Floats]:
        code = decoder.encode(rig.astype(np.float32))
        return [decoder.vertices(code, AHEAD, who) for who in people]

    return vertices, decoder.regions


def lips() -> "LipGeometry":
    """The lips of all shipped avatars, as the capture's contacts need them."""
    from encoder.capture.motion.contacts import lip_geometry

    vertices, regions = every_face()
    return lip_geometry(vertices, regions["lips_upper"], regions["lips_lower"])


def teeth() -> "TeethGeometry":
    """Lower lips and upper teeth of all shipped avatars."""
    from encoder.capture.motion.contacts import teeth_geometry

    vertices, regions = every_face()
    return teeth_geometry(vertices, regions["lips_lower"], regions.get("teeth_upper", TEETH_UPPER))


def gaps_on_vertices(geometry: "LipGeometry", rigs: Floats) -> tuple[float, float]:
    """Check the geometry's gaps of rigs [T, 53] on the decoder's own vertices.

    -> mm: how far it is off, at most, where lips are apart; and the widest true gap of lips that it
    calls shut, which the decoder keeps from crossing.
    """
    vertices, _ = every_face()
    off, shut = 0.0, 0.0
    for rig, said in zip(rigs, geometry.gap_mm(rigs), strict=True):
        gap = max(geometry.gap_on(face) for face in vertices(rig))
        if said > 0:
            off = max(off, abs(gap - float(said)))
        else:
            shut = max(shut, gap)
    return off, shut
