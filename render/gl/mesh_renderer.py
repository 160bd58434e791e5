"""Textured mesh renderer: the reference pictures that Gaussians are fitted to and judged by.

Draws at twice the size and averages: edges are smooth and the picture is that of a sharp lens.
Gaussians are blended in stored (gamma) values, so the averaging happens there too.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import lighting, wrinkles
from render.decoder import lines
from render.decoder.mesh_parts import Parts
from render.gl.contexts import GLContext, free
from render.lighting import STUDIO, Lighting
from render.types import Camera, Floats

SHADERS = Path(__file__).parents[1] / "shaders"
OVERSAMPLE = 2
FAR_MM = 4000.0
FIELDS = (("position", 3), ("normal", 3), ("uv", 2), ("color", 3), ("seen", 4), ("kind", 1))


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
        self._corners[:, 15] = parts.kind
        self._buffer = self._gl.buffer(reserve=self._corners.nbytes, dynamic=True)
        layout = [(self._buffer, " ".join(f"{n}f" for _, n in FIELDS), *(f for f, _ in FIELDS))]
        self._opaque = self._gl.vertex_array(
            self._program, layout, self._gl.buffer(parts.opaque.tobytes())
        )
        self._textures: dict[str, Any] = {}
        self._target: Any = None
        for name, values in (
            ("towards", lighting.TOWARDS),
            ("half_widths", lighting.HALF_WIDTHS),
            ("wrap", lighting.WRAP),
            ("bleed", lighting.BLEED),
            ("bounce", lighting.BOUNCE),
            ("film", lighting.FILM),
            ("sheen", lighting.SHEEN),
            ("across", wrinkles.ACROSS_MM),
            ("fold_tint", wrinkles.TINT),
            ("lid_shade", lines.SHADE),
            ("lid_reach", lines.SHADE_MM),
        ):
            self._program[name].write(np.ascontiguousarray(values, np.float32).tobytes())  # pyright: ignore[reportAttributeAccessIssue]
        self.set_texture("wrinkles", np.zeros((8, 8, 4), np.float32))
        self.set_texture("relief", np.tile(np.array([0, 0.4, 0.5], np.float32), (8, 8, 1)))

    def set_texture(self, name: str, image: Floats) -> None:
        """`name`: skin, eye, relief or wrinkles; image [H, W, 3], wrinkles [H, W, 4], top row
        first: 0..1, relief and wrinkles as they are."""
        if name in self._textures:
            self._textures[name].release()
        half = name in ("relief", "wrinkles")
        rows = image[::-1].astype(np.float16) if half else np.rint(image[::-1] * 255).astype("u1")
        texture = self._gl.texture(
            rows.shape[1::-1], rows.shape[2], np.ascontiguousarray(rows).tobytes(),
            dtype="f2" if half else "f1", alignment=1,
        )  # fmt: skip
        texture.build_mipmaps()
        texture.anisotropy = 4.0
        self._textures[name] = texture

    def draw(
        self,
        vertices: Floats,  # [V, 3] mm
        normals: Floats,  # [V, 3] unit
        colors: Floats,  # [V, 3] of what has no texture; gain of the texture's colour elsewhere
        seen: Floats,  # [V, 4] shares of the sky, of the key light and the rims
        camera: Camera,
        lights: Lighting = STUDIO,
        mirrors: bool = True,  # else everything is matte
        folds: Floats | None = None,  # [8] see wrinkles.amounts
        lids: list[Floats] | None = None,  # Line.opening of both eyes, left first: they shade these
    ) -> NDArray[np.uint8]:  # [H, W, 3]
        """One picture over the camera's background."""
        self._context.activate()
        gl, rows, corners = self._gl, self.parts.vertex, self._corners
        corners[:, 0:3], corners[:, 3:6] = vertices[rows], normals[rows]
        corners[:, 8:11], corners[:, 11:15] = colors[rows], seen[rows]
        self._buffer.write(corners)
        for unit, name in enumerate(("skin", "eye", "relief", "wrinkles")):
            self._textures[name].use(unit)
            self._program[name] = unit
        self._program["lamps"].write(lights.colors.tobytes())  # pyright: ignore[reportAttributeAccessIssue]
        self._program["sky"], self._program["ground"] = lights.sky, lights.ground
        self._program["mirrors"], self._program["lidded"] = mirrors, lids is not None
        most = np.zeros(8, np.float32) if folds is None else folds
        self._program["folds"].write(most.tobytes())  # pyright: ignore[reportAttributeAccessIssue]
        if lids is not None:
            self._program["lids"].write(np.concatenate(lids).tobytes())  # pyright: ignore[reportAttributeAccessIssue]
        self._program["viewer"] = tuple(camera.position)
        self._program["transform"] = tuple(clip_matrix(camera).T.astype(np.float32).ravel())
        size = (camera.width * OVERSAMPLE, camera.height * OVERSAMPLE)
        old = self._target
        if old is None or old.size != size:
            self._target = gl.framebuffer([gl.texture(size, 4)], gl.depth_renderbuffer(size))
            if old is not None:
                free(old)
        self._target.use()
        self._target.clear(*camera.background, 1.0)
        gl.enable_only(gl.DEPTH_TEST)
        self._opaque.render()
        gl.disable(gl.DEPTH_TEST)
        fine = np.frombuffer(self._target.read(components=3, alignment=1), np.uint8)
        fine = fine.reshape(camera.height, OVERSAMPLE, camera.width, OVERSAMPLE, 3)
        return np.rint(fine.mean((1, 3), dtype=np.float32)).astype(np.uint8)
