"""The splat renderer alone: speed by number of Gaussians and size, against the other technique.

Both draw the same avatar, split or thinned to the number of Gaussians, one after the
other in every round, so that a busy machine slows them alike: the ratios hold where the
milliseconds do not. Best and median of the rounds are told.
"""

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.terminal.thresholds import at_least, at_most

if TYPE_CHECKING:
    from render.decoder.decoder import Decoder
    from render.decoder.identity import Identity
    from render.types import Camera, Gaussians, Renderer

CASES = ((16_384, 512), (32_768, 512), (65_536, 512), (65_536, 1024))  # Gaussians, px
THRESHOLDS_MS = {(32_768, 512): 10.0, (65_536, 512): 12.0, (65_536, 1024): 22.0}
ROUNDS = 20
MIN_PSNR_DB = 58.0
ANGLES = ((0, 0), (30, 0), (-30, 0), (15, 12), (-15, -12))  # yaw, pitch of the cameras, degrees
FRAMES = 20  # pictures that are compared with the reference


def measure_render(avatar: str) -> dict[str, Any]:
    """The report holds metrics and thresholds."""
    from tqdm import tqdm

    from app.terminal.console import console, numbers
    from render import cameras
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.gl.contexts import create_context
    from render.splats.renderer import create_renderer, wrap_context
    from render.types import AHEAD

    decoder, who = Decoder.load(), identity.load(avatar)
    ours = create_renderer()
    renderers = {
        "ours": ours,
        "quads": wrap_context(create_context(), "quads"),
    }
    _, cloud = decoder.decode(np.zeros(256, np.float32), AHEAD, who)
    metrics: dict[str, float] = {}
    table = numbers("Gaussians", "px", *(f"{name} ms" for name in renderers), "quads / ours")
    for count, size in tqdm(CASES, unit="case", disable=None):
        scene, camera = resample(cloud, count), cameras.portrait(size, size)
        times = race(renderers, scene, camera)
        key = f"{count // 1024}k_{size}"
        for name, (best, median) in times.items():
            metrics |= {f"{name}_{key}_best_ms": best, f"{name}_{key}_p50_ms": median}
        ratio = times["quads"][0] / times["ours"][0]
        cells = (f"{best:.1f} ({median:.1f})" for best, median in times.values())
        table.add_row(str(count), str(size), *cells, f"{ratio:.2f}")
    metrics["psnr_worst_db"] = worst_psnr_db(ours, avatar)
    for renderer in renderers.values():
        renderer.close()
    console().print(table)
    thresholds = [
        at_most(f"ours_{n // 1024}k_{px}_p50_ms", metrics[f"ours_{n // 1024}k_{px}_p50_ms"], limit)
        for (n, px), limit in THRESHOLDS_MS.items()
    ]
    thresholds.append(at_least("psnr_worst_db", metrics["psnr_worst_db"], MIN_PSNR_DB))
    return {"renderer": ours.name, "avatar": avatar, "metrics": metrics, "bars": thresholds}


def race(
    renderers: "dict[str, Renderer]", scene: "Gaussians", camera: "Camera"
) -> dict[str, tuple[float, float]]:
    """Best and median wall time of a frame, drawn and read back, in ms, by name."""
    times: dict[str, list[float]] = {name: [] for name in renderers}
    for round_index in range(ROUNDS + 2):
        for name, renderer in renderers.items():
            fresh = replace(scene)  # known Gaussians would not be uploaded again
            start = time.perf_counter()
            renderer.draw(fresh, camera)
            renderer.read_rgba()
            if round_index >= 2:  # the first rounds compile and allocate
                times[name].append(1e3 * (time.perf_counter() - start))
    return {name: (min(t), float(np.median(t))) for name, t in times.items()}


def resample(cloud: "Gaussians", count: int) -> "Gaussians":
    """The same head with `count` Gaussians: the largest split in two, or a random part, grown."""
    from render.types import Gaussians

    rng = np.random.default_rng(0)
    arrays = [cloud.means, cloud.quats, cloud.scales, cloud.opacities, cloud.colors]
    if len(cloud) > count:
        keep = np.sort(rng.permutation(len(cloud))[:count])
        means, quats, scales, opacities, colors = (a[keep] for a in arrays)
        scales = scales * np.float32(np.sqrt(len(cloud) / count))
        return Gaussians(means, quats, scales, opacities, colors)
    while len(arrays[0]) < count:
        means, scales = arrays[0], arrays[2]
        large = np.argsort(-scales.max(axis=1), kind="stable")[: count - len(means)]
        arrays = [np.concatenate([a, a[large]]) for a in arrays]
        halves = np.concatenate([large, np.arange(len(means), len(arrays[0]))])
        shift = rng.normal(0.0, 0.5, (len(halves), 3)) * arrays[2][halves].max(axis=1)[:, None]
        arrays[0][halves] += shift.astype(np.float32)
        arrays[2][halves] *= np.float32(np.sqrt(0.5))
    means, quats, scales, opacities, colors = arrays
    return Gaussians(means, quats, scales, opacities, colors)


def worst_psnr_db(renderer: "Renderer", avatar: str) -> float:
    """The worst of FRAMES pictures of the demo's faces from five views against the reference."""
    from render import cameras
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.splats.reference import ReferenceRenderer

    decoder, who, reference = Decoder.load(), identity.load(avatar), ReferenceRenderer()
    rng, worst = np.random.default_rng(0), np.inf
    for index in range(FRAMES):
        cloud = random_face(rng, decoder, who)
        yaw, pitch = ANGLES[index % len(ANGLES)]
        distance = (400.0, 800.0, 1600.0)[index % 3]  # near and far
        camera = cameras.portrait(512, 512, yaw_deg=yaw, pitch_deg=pitch, distance_mm=distance)
        renderer.draw(cloud, camera)
        reference.draw(cloud, camera)
        error = renderer.read_rgba() - 255.0 * reference.read_float()
        worst = min(worst, float(10.0 * np.log10(255.0**2 / np.mean(error**2))))
    return worst


def random_face(rng: np.random.Generator, decoder: "Decoder", who: "Identity") -> "Gaussians":
    """A fifth of the rig's controls pulled, eyes turned, decoded."""
    rig = rng.uniform(0.0, 0.7, len(decoder.rig_names)) * (rng.random(len(decoder.rig_names)) < 0.2)
    gaze = np.array([[0.1 * rng.normal(), 0.1 * rng.normal(), 1.0]] * 2, np.float32)
    gaze /= np.linalg.norm(gaze, axis=1, keepdims=True)
    return decoder.decode(decoder.encode(rig.astype(np.float32)), gaze, who)[1]
