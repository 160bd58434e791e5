"""Visibility of the sky and of the key light from each vertex, by depth maps from many sides.

The slow truth (about a second a face); the decoder learns to predict its change.
"""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import lighting
from render.gl.contexts import GLContext
from render.lighting import Lamp
from render.types import Floats

SHADERS = Path(__file__).parents[1] / "shaders"
SIZE_PX = 384
SPAN_MM = 400.0
CENTRE_MM = np.array([0.0, -20.0, 20.0])
OFFSET_MM = 1.2  # from the surface, along the normal: a vertex does not shade itself
SKY_DIRECTIONS, KEY_DIRECTIONS, RIM_DIRECTIONS = 44, 16, 6
DEPTH_MARGIN = np.float32(1e-3)

VERTEX = """#version 330
in vec3 position; uniform mat4 transform; out float depth;
void main() { gl_Position = transform * vec4(position, 1.0); depth = gl_Position.z; }"""
FRAGMENT = """#version 330
in float depth; out float value; void main() { value = depth; }"""


def sky_directions() -> NDArray[np.float64]:  # [S, 3] unit, even on the sphere
    index = np.arange(SKY_DIRECTIONS) + 0.5
    y, turn = 1 - 2 * index / SKY_DIRECTIONS, index * np.pi * (3 - 5**0.5)
    ring = np.sqrt(1 - y * y)
    return np.stack([ring * np.cos(turn), y, ring * np.sin(turn)], 1)


def lamp_directions(lamp: Lamp) -> NDArray[np.float64]:  # [K, 3] unit, over a soft box
    towards = lamp.towards.astype(np.float64)
    across = np.cross(towards, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    count = KEY_DIRECTIONS if lamp is lighting.KEY else RIM_DIRECTIONS
    index = np.arange(count) + 0.5
    radius, turn = lamp.half_width * np.sqrt(index / count), index * np.pi * (3 - 5**0.5)
    offset = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(across, towards)
    soft = towards + radius[:, None] * offset
    return soft / np.linalg.norm(soft, axis=1, keepdims=True)


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
        shadowing = (lighting.KEY, lighting.RIM_LEFT, lighting.RIM_RIGHT)
        self._groups = [sky_directions(), *(lamp_directions(lamp) for lamp in shadowing)]

    def __call__(
        self,
        vertices: Floats,  # [V, 3] mm
        normals: Floats,  # [V, 3] unit
        cover: Floats | None = None,  # [T, 3, 3] mm: further triangles that cast shadow, e.g. hair
        points: tuple[Floats, Floats] | None = None,  # judge these places and normals instead
        offset_mm: float = OFFSET_MM,
        columns: int = 4,
    ) -> Floats:  # [V, columns] shares that are seen, 0..1: sky, key light, rims left and right
        solid, faces = vertices, self._faces
        if cover is not None:
            solid = np.concatenate([vertices, cover.reshape(-1, 3)])
            extra = np.arange(len(vertices), len(solid), dtype=np.int32).reshape(-1, 3)
            faces = np.concatenate([faces, extra])
        start, normals = (vertices, normals) if points is None else points
        ends = (start + offset_mm * normals).astype(np.float32)
        out = np.empty((len(start), columns), np.float32)
        with self._uploaded(solid, faces) as array:
            for column, group in enumerate(self._groups[:columns]):
                seen = weight = np.zeros(len(start), np.float32)
                for direction in group.astype(np.float32):
                    facing = np.maximum(normals @ direction, 0) if column == 0 else np.float32(1)
                    weight = weight + facing
                    seen = seen + facing * self._visible(array, direction, ends)
                out[:, column] = seen / np.maximum(weight, 1e-6)
        return out

    def from_sides(
        self, vertices: Floats, normals: Floats, directions: NDArray[np.floating]
    ) -> Floats:  # [V, 3] mm, [V, 3] unit, [D, 3] unit -> [V, D] 0..1
        """Whether vertices are seen from each of these directions."""
        ends = (vertices + OFFSET_MM * normals).astype(np.float32)
        with self._uploaded(vertices, self._faces) as array:
            sides = [self._visible(array, side, ends) for side in directions.astype(np.float32)]
        return np.stack(sides, 1)

    @contextmanager
    def _uploaded(self, vertices: Floats, faces: NDArray[np.int32]) -> Generator[Any]:
        """A mesh that `_visible` draws."""
        self._context.activate()
        gl = self._gl
        buffer = gl.buffer(np.ascontiguousarray(vertices, np.float32).tobytes())
        index = gl.buffer(np.ascontiguousarray(faces, np.int32).tobytes())
        array = gl.vertex_array(self._program, [(buffer, "3f", "position")], index)
        gl.enable_only(gl.DEPTH_TEST)  # others leave blending on
        self._target.use()
        try:
            yield array
        finally:
            gl.disable(gl.DEPTH_TEST)
            for thing in (array, buffer, index):
                thing.release()

    def _visible(self, array, direction, ends: Floats) -> Floats:  # type: ignore[no-untyped-def]
        """[n] 0..1: how many of the four pixels around a place lie behind it."""
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
        at = (clip[:, :2] * np.float32(0.5) + np.float32(0.5)) * SIZE_PX - np.float32(0.5)
        at = at.clip(0, SIZE_PX - 1.001)
        corner = at.astype(np.int32)
        x, y = (at - corner).T
        first, depth = corner[:, 1] * SIZE_PX + corner[:, 0], clip[:, 2] - DEPTH_MARGIN
        near, far = (
            (1 - x) * (nearest[row] >= depth) + x * (nearest[row + 1] >= depth)
            for row in (first, first + SIZE_PX)
        )
        return (1 - y) * near + y * far
