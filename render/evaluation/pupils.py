"""Gaze error of the drawn pupils, measured in the picture and not in the vertices."""

import numpy as np

from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.decoder.posing import outward
from render.evaluation.judge import SIZE_PX, eye_camera
from render.types import Gaussians, Renderer

NEAR = 0.075  # of the picture: the pupil is looked for this near its middle, inside the iris' rim
DARKEST = 27  # percent of the pixels there
CORNEA_MM, DISTANCE_MM = 16.6, 900.0


def error_deg(decoder: Decoder, renderer: Renderer, who: Identity) -> float:
    """How far the pupils of someone whose pupils should point ahead are off, the worse eye."""
    worst, inward = 0.0, np.stack([outward(1), outward(0)])
    _, cloud = decoder.decode(np.zeros(256, np.float32), inward, who)
    for eye, rows in enumerate(of.ball for of in decoder.eyes):
        cut = Gaussians(
            cloud.means[rows], cloud.quats[rows], cloud.scales[rows], cloud.opacities[rows],
            cloud.colors[rows],
        )  # fmt: skip
        camera = eye_camera(who.eye_centers[eye])
        renderer.draw(cut, camera)
        picture = renderer.read_rgba()[..., :3].astype(np.float32).mean(2)
        y, x = np.mgrid[:SIZE_PX, :SIZE_PX] + 0.5 - SIZE_PX / 2
        near = np.hypot(x, y) < NEAR * SIZE_PX
        dark = near & (picture <= np.percentile(picture[near], DARKEST))
        shift = np.hypot(x[dark].mean(), y[dark].mean())
        mm = shift / camera.K[0, 0] * (DISTANCE_MM - CORNEA_MM)
        worst = max(worst, float(np.degrees(mm / CORNEA_MM)))
    return worst
