"""How much of the sky and of the key light each vertex sees: depth pictures from many sides.

The slow truth (about a second a face); the decoder learns to predict its change.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from render import lighting
from render.contexts import GLContext

SHADERS = Path(__file__).parent / "shaders"
SIZE_PX = 320
SPAN_MM = 400.0
CENTRE_MM = np.array([0.0, -20.0, 20.0])
OFFSET_MM = 1.2  # from the surface, along the normal: a vertex does not shade itself
SKY_DIRECTIONS, KEY_DIRECTIONS = 44, 12
KEY_SPREAD = 0.16  # tangent of the key light's half width: it is a soft box, not a point
Floats = NDArray[np.float32]

VERTEX = """#version 430
in vec3 position; uniform mat4 transform; out float depth;
void main() { gl_Position = transform * vec4(position, 1.0); depth = gl_Position.z; }"""
FRAGMENT = """#version 430
in float depth; out float value; void main() { value = depth; }"""


def directions() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors towards the sky [S, 3] (even on the sphere) and the key light [K, 3]."""
    index = np.arange(SKY_DIRECTIONS) + 0.5
    y, turn = 1 - 2 * index / SKY_DIRECTIONS, index * np.pi * (3 - 5**0.5)
    ring = np.sqrt(1 - y * y)
    sky = np.stack([ring * np.cos(turn), y, ring * np.sin(turn)], 1)
    key = lighting.KEY.astype(np.float64)
    across = np.cross(key, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    index = np.arange(KEY_DIRECTIONS) + 0.5
    radius, turn = KEY_SPREAD * np.sqrt(index / KEY_DIRECTIONS), index * np.pi * (3 - 5**0.5)
    offset = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(across, key)
    soft = key + radius[:, None] * offset
    return sky, soft / np.linalg.norm(soft, axis=1, keepdims=True)


class Occlusion:
    """Casts rays by drawing depth from every direction; occluders are triangles of the mesh."""

    def __init__(self, context: GLContext, faces: NDArray[np.int32]) -> None:
        self._context, gl = context, context.gl
        context.activate()
        self._gl, self._num_faces = gl, len(faces)
        self._program = gl.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._faces = faces
        self._target = gl.framebuffer(
            [gl.texture((SIZE_PX, SIZE_PX), 1, dtype="f4")],
            gl.depth_renderbuffer((SIZE_PX, SIZE_PX)),
        )
        self._sky, self._key = directions()

    def __call__(
        self,
        vertices: Floats,  # [V, 3] mm
        normals: Floats,  # [V, 3] unit
        cover: Floats | None = None,  # [T, 3, 3] mm: further triangles that cast shadow, e.g. hair
        points: tuple[Floats, Floats] | None = None,  # judge these places and normals instead
        offset_mm: float = OFFSET_MM,
    ) -> Floats:  # [V, 2] shares of the sky and of the key light that are seen, 0..1
        self._context.activate()
        gl = self._gl
        solid, faces = vertices, self._faces
        if cover is not None:
            solid = np.concatenate([vertices, cover.reshape(-1, 3)])
            extra = np.arange(len(vertices), len(solid), dtype=np.int32).reshape(-1, 3)
            faces = np.concatenate([faces, extra])
        buffer = gl.buffer(np.ascontiguousarray(solid, np.float32).tobytes())
        index = gl.buffer(np.ascontiguousarray(faces, np.int32).tobytes())
        array = gl.vertex_array(self._program, [(buffer, "3f", "position")], index)
        start, normals = (vertices, normals) if points is None else points
        ends = (start + offset_mm * normals).astype(np.float32)
        gl.enable_only(gl.DEPTH_TEST)  # others leave blending on
        self._target.use()
        seen, weight = np.zeros((2, len(start), 2), np.float32)
        for column, group in enumerate((self._sky, self._key)):
            for direction in group:
                facing = np.maximum(normals @ direction.astype(np.float32), 0)
                if column == 1:
                    facing = np.ones_like(facing)
                weight[:, column] += facing
                seen[:, column] += facing * self._visible(array, direction, ends)
        gl.disable(gl.DEPTH_TEST)
        for thing in (array, buffer, index):
            thing.release()
        return (seen / np.maximum(weight, 1e-6)).astype(np.float32)

    def _visible(self, array, direction, ends: Floats) -> NDArray[np.bool_]:
        side = np.cross(direction, (0.0, 1.0, 0.01))
        side /= np.linalg.norm(side)
        rows = np.stack([side, np.cross(side, direction), -direction]) * (2 / SPAN_MM)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rows, -rows @ CENTRE_MM
        self._program["transform"] = tuple(matrix.T.astype(np.float32).ravel())
        self._target.clear(4.0, depth=1.0)
        array.render()
        nearest = np.frombuffer(self._target.read(components=1, dtype="f4"), np.float32)
        clip = ends @ matrix[:3, :3].T.astype(np.float32) + matrix[:3, 3].astype(np.float32)
        pixel = ((clip[:, :2] * 0.5 + 0.5) * SIZE_PX).astype(np.int32)
        inside = ((pixel >= 0) & (pixel < SIZE_PX)).all(1)
        pixel = pixel.clip(0, SIZE_PX - 1)
        return ~inside | (clip[:, 2] <= nearest[pixel[:, 1] * SIZE_PX + pixel[:, 0]] + 1e-3)
