"""Thousands of pictures of random avatars, sizes and cameras: no GL error, nothing leaks."""

import ctypes
import os
from typing import Any

import numpy as np

from app.terminal.thresholds import at_most

PICTURES = 10_000
WARM_UP = 1_000  # buffers grow to the largest picture, caches fill
POOL = 24  # decoded faces that the pictures draw from


def measure_pictures() -> dict[str, Any]:
    """The report holds metrics and thresholds."""
    import psutil
    from tqdm import tqdm

    from app.bench.render import random_face
    from render import cameras
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files
    from render.gl.contexts import create_context
    from render.splats.renderer import wrap_context

    rng, decoder = np.random.default_rng(0), Decoder.load()
    people = [identity.load(name) for name in avatar_files.shipped()]
    pool = [random_face(rng, decoder, people[i % len(people)]) for i in range(POOL)]
    context = create_context()
    renderer = wrap_context(context)
    process = psutil.Process(os.getpid())
    start_mb, start_objects = 0.0, 0
    errors = 0
    for index in tqdm(range(PICTURES), unit="picture", disable=None):
        if index == WARM_UP:
            start_mb, start_objects = process.memory_info().rss / 2**20, count_gl_objects()
        width, height = (int(2 * n) for n in rng.integers(16, 256, 2))
        camera = cameras.portrait(
            width,
            height,
            yaw_deg=float(rng.uniform(-90, 90)),
            pitch_deg=float(rng.uniform(-40, 40)),
            distance_mm=float(rng.uniform(200, 2000)),
        )
        renderer.draw(pool[rng.integers(POOL)], camera)
        try:
            renderer.read_rgba()
        except RuntimeError:
            errors += 1
    growth_mb = process.memory_info().rss / 2**20 - start_mb
    objects = count_gl_objects() - start_objects
    renderer.close()
    metrics = {
        "pictures": PICTURES,
        "gl_errors": errors,
        "memory_growth_mb": round(growth_mb, 2),
        "gl_objects_growth": objects,
    }
    thresholds = [
        at_most("gl_errors", errors, 0),
        at_most("memory_growth_mb", growth_mb, 16.0),
        at_most("gl_objects_growth", objects, 0),
    ]
    return {"renderer": renderer.name, "metrics": metrics, "bars": thresholds}


def count_gl_objects() -> int:
    """Living buffers, textures, framebuffers, vertex arrays and programs of this context."""
    gl = ctypes.CDLL("libGL.so.1")  # dispatches to the current context, whatever made it
    kinds = (gl.glIsBuffer, gl.glIsTexture, gl.glIsFramebuffer, gl.glIsVertexArray, gl.glIsProgram)
    return sum(bool(is_kind(name)) for is_kind in kinds for name in range(1, 4096))
