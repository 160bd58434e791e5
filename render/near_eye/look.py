"""How one pair of near-eye pictures is taken: the headset's cameras and lamps, and the eye's looks.

All values of the left eye; the right eye is its mirror image. Drawn anew for each subject, and
shaken a little (`slipped`) as a headset moves on a head.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from render.decoder.identity import Identity
from render.decoder.posing import Rest

MAX_LEDS = 8


@dataclass(frozen=True)
class Look:
    """Lengths in mm from the centre of the eyeball, +x outwards, +y up, +z forward."""

    # camera
    outward_deg: float  # how far the camera sits to the temple's side
    below_deg: float
    distance: float  # to what it looks at
    target: tuple[float, float, float]
    view_deg: float
    roll_deg: float
    # lamps
    leds: tuple[tuple[float, float, float], ...]
    # the eye
    pupil: float  # radius
    iris: float  # radius
    sclera_tone: float
    iris_tone: float
    pupil_tone: float  # above 0.2 in the bright-pupil effect
    limbus: float
    fibres: float
    seed: float
    # skin and hair
    albedo: float
    gloss: float
    pores: float
    lash_length: float
    lash_curl: float
    lashes: int
    lash_shade: float
    lash_width: float
    brow_hairs: int
    # sensor
    exposure: float  # mean grey level aimed at
    gamma: float
    blur_px: float
    noise: float
    vignette: float
    motion_px: float
    reflections: int  # of glasses
    backdrop: float

    @staticmethod
    def draw(rng: np.random.Generator) -> "Look":
        """A headset on a person."""
        u = rng.uniform
        count, ring = int(rng.integers(4, MAX_LEDS + 1)), u(13, 24)
        angles = np.arange(count) * 2 * np.pi / count + u(0, 6.28)
        plane = u(26, 44)
        leds = [
            (ring * np.cos(a) + u(-2, 2), ring * np.sin(a) + u(-2, 2), plane + u(-3, 3))
            for a in angles
        ]
        side = rng.random() < 0.3  # else from below
        outward, below = (u(18, 42), u(-8, 18)) if side else (u(-14, 20), u(10, 40))
        distance = u(34, 62)
        span = u(34, 56)  # mm across the picture, at the target
        return Look(
            outward_deg=outward, below_deg=below, distance=distance,
            target=(u(-2, 3), u(-3, 4), 13.0),
            view_deg=float(np.degrees(2 * np.arctan(span / 2 / distance))), roll_deg=u(-6, 6),
            leds=tuple((float(x), float(y), float(z)) for x, y, z in leds),
            pupil=u(1.7, 4.6), iris=u(6.7, 7.7),
            sclera_tone=u(0.55, 1.15), iris_tone=u(0.2, 0.62),
            pupil_tone=u(0.25, 0.8) if rng.random() < 0.08 else u(0.01, 0.05),
            limbus=u(0.25, 0.8), fibres=u(0.15, 0.7), seed=u(0, 0.9),
            albedo=u(0.38, 0.8), gloss=u(0.02, 0.5), pores=u(0.3, 1.2),
            lash_length=u(5.5, 10.5), lash_curl=u(0.2, 0.9), lashes=int(rng.integers(50, 130)),
            lash_shade=u(0.02, 0.18), lash_width=u(0.12, 0.24),
            brow_hairs=int(rng.integers(150, 650)),
            exposure=u(65, 150), gamma=u(0.6, 1.0), blur_px=u(0.5, 1.7), noise=u(0.8, 5.0),
            vignette=u(0.05, 0.6), motion_px=u(2, 9) if rng.random() < 0.08 else 0.0,
            reflections=int(rng.integers(1, 4)) if rng.random() < 0.12 else 0,
            backdrop=u(0.0, 0.06),
        )  # fmt: skip

    def slipped(self, rng: np.random.Generator) -> "Look":
        """The same headset a moment later: slip up to 1.5 mm, tilt, light and focus."""
        n = rng.normal
        x, y, z = self.target
        return replace(
            self,
            target=(x + n(0, 0.7), y + n(0, 0.7), z),
            roll_deg=self.roll_deg + n(0, 1.0),
            outward_deg=self.outward_deg + n(0, 0.8),
            below_deg=self.below_deg + n(0, 0.8),
            pupil=float(np.clip(self.pupil + n(0, 0.5), 1.3, 5.2)),
            exposure=self.exposure * float(np.exp(n(0, 0.06))),
            motion_px=float(rng.uniform(2, 9)) if rng.random() < 0.06 else 0.0,
        )


def varied(people: Sequence[Identity], rng: np.random.Generator) -> Identity:
    """Somebody new: a mixture of people, stretched and dented by a millimetre or two."""
    weights = 1.3 * rng.dirichlet(np.full(len(people), 0.7)) - 0.3 / len(people)

    def mixed(parts: Sequence[NDArray[np.floating]]) -> NDArray[np.float32]:
        return np.tensordot(weights, np.stack(parts), 1).astype(np.float32)

    waves = rng.normal(0, 0.11, (5, 3))  # one wave is about 60 mm long
    phases, sizes = rng.uniform(0, 6.28, 5), rng.normal(0, 0.7, (5, 3))

    def moved(points: NDArray[np.floating]) -> NDArray[np.float32]:
        mirrored = np.abs(points) * [1, 0, 0] + points * [0, 1, 1]  # both sides alike
        shift = np.sin(mirrored @ waves.T + phases) @ sizes
        shift[:, 0] *= np.sign(points[:, 0])
        return (points + shift).astype(np.float32)

    rests = [p.rest for p in people]
    rest = Rest(
        geometry=moved(mixed([r.geometry for r in rests])),
        eye_centers=moved(mixed([r.eye_centers for r in rests])),
        reach=(mixed([r.reach[0] for r in rests]), mixed([r.reach[1] for r in rests])),
        shut=mixed([r.shut for r in rests]),
    )
    return replace(people[0], name="varied", rest=rest)
