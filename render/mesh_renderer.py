"""Textured mesh renderer: the reference pictures that Gaussians are fitted to and judged by.

Draws at twice the size and averages: edges are smooth and the picture is that of a sharp lens.
Gaussians are blended in stored (gamma) values, so the averaging happens there too.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import lighting
from render.contexts import GLContext
from render.lighting import STUDIO, Lighting
from render.mesh_parts import LASHES, Parts
from render.types import Camera

SHADERS = Path(__file__).parent / "shaders"
OVERSAMPLE = 2
FAR_MM = 4000.0
FIELDS = (("position", 3), ("normal", 3), ("uv", 2), ("color", 3), ("light_seen", 2), ("kind", 1))
Floats = NDArray[np.float32]


def clip_matrix(camera: Camera, near: float = 50.0, far: float = FAR_MM) -> NDArray[np.float64]:
    """World to OpenGL clip space [4, 4]; rows of the picture run downwards as in the camera."""
    K, w, h = camera.K, camera.width, camera.height
    clip = np.zeros((4, 4))
    clip[0, 0], clip[0, 2] = 2 * K[0, 0] / w, 2 * K[0, 2] / w - 1
    clip[1, 1], clip[1, 2] = 2 * K[1, 1] / h, 2 * K[1, 2] / h - 1
    clip[2, 2], clip[2, 3] = (far + near) / (far - near), -2 * far * near / (far - near)
    clip[3, 2] = 1.0
    return clip @ camera.viewmat


class MeshRenderer:
    """Draws one topology with any vertices, textures and lights."""

    def __init__(self, context: GLContext, parts: Parts) -> None:
        self._context, self._gl, self.parts = context, context.gl, parts
        context.activate()
        self._program = self._gl.program(
            vertex_shader=(SHADERS / "mesh.vert.glsl").read_text(),
            fragment_shader=(SHADERS / "mesh.frag.glsl").read_text(),
        )
        floats = sum(count for _, count in FIELDS)
        self._corners = np.zeros((len(parts.vertex), floats), np.float32)
        self._corners[:, 6:8] = parts.uv
        self._corners[:, 13] = parts.kind
        self._buffer = self._gl.buffer(reserve=self._corners.nbytes, dynamic=True)
        layout = [(self._buffer, " ".join(f"{n}f" for _, n in FIELDS), *(f for f, _ in FIELDS))]
        self._opaque, self._lashes = (
            self._gl.vertex_array(self._program, layout, self._gl.buffer(faces.tobytes()))
            if len(faces)
            else None
            for faces in (parts.opaque, parts.lashes)
        )
        self._textures: dict[str, Any] = {}
        self._target: Any = None
        for name, direction in zip(
            ("to_key", "to_fill", "to_rim", "to_half", "wrap"),
            (lighting.KEY, lighting.FILL, lighting.RIM, lighting.HALF, lighting.WRAP),
            strict=True,
        ):
            self._program[name] = tuple(float(v) for v in direction)
        self._program["bounce"] = lighting.BOUNCE

    def set_texture(self, name: str, image: Floats) -> None:
        """`name`: skin, eye or lashes; image [H, W, 3] 0..1, top row first."""
        if name in self._textures:
            self._textures[name].release()
        data = np.ascontiguousarray(np.rint(image[::-1] * 255).astype(np.uint8))
        texture = self._gl.texture((data.shape[1], data.shape[0]), data.shape[2], data.tobytes())
        texture.build_mipmaps()
        texture.anisotropy = 4.0
        self._textures[name] = texture

    def draw(
        self,
        vertices: Floats,  # [V, 3] mm
        normals: Floats,  # [V, 3] unit
        colors: Floats,  # [V, 3] of what has no texture; gain of the texture's colour elsewhere
        light_seen: Floats,  # [V, 2] shares of the sky and of the key light
        camera: Camera,
        lights: Lighting = STUDIO,
    ) -> NDArray[np.uint8]:  # [H, W, 3]
        """One picture over the camera's background."""
        self._context.activate()
        gl, rows, corners = self._gl, self.parts.vertex, self._corners
        corners[:, 0:3], corners[:, 3:6] = vertices[rows], normals[rows]
        corners[:, 8:11], corners[:, 11:13] = colors[rows], light_seen[rows]
        corners[self.parts.kind == LASHES, 8:11] = 0.05
        self._buffer.write(corners)
        for unit, name in enumerate(("skin", "eye", "lashes")):
            self._textures[name].use(unit)
            self._program[name] = unit
        for name in ("key", "fill", "rim", "sky", "ground"):
            self._program[f"light_{name}"] = getattr(lights, name)
        self._program["transform"] = tuple(clip_matrix(camera).T.astype(np.float32).ravel())
        size = (camera.width * OVERSAMPLE, camera.height * OVERSAMPLE)
        if self._target is None or self._target.size != size:
            self._target = gl.framebuffer([gl.texture(size, 4)], gl.depth_renderbuffer(size))
        self._target.use()
        self._target.clear(*camera.background, 1.0)
        gl.enable_only(gl.DEPTH_TEST)
        if self._opaque:
            self._opaque.render()
        if self._lashes:
            gl.enable(gl.BLEND)
            gl.blend_func = gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA
            self._target.depth_mask = False
            self._lashes.render()
            self._target.depth_mask = True
        gl.disable(gl.BLEND | gl.DEPTH_TEST)
        fine = np.frombuffer(self._target.read(components=3, alignment=1), np.uint8)
        fine = fine.reshape(camera.height, OVERSAMPLE, camera.width, OVERSAMPLE, 3)
        return np.rint(fine.mean((1, 3), dtype=np.float32)).astype(np.uint8)
