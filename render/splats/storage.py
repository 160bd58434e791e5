"""GL storage buffers and shader sources of the splat renderers."""

from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import NDArray

from sensors.types import InputError

if TYPE_CHECKING:
    import moderngl

SHADERS = Path(__file__).parents[1] / "shaders"


def splat_shader(name: str, version: int) -> str:
    """The source of a shader that unpacks splats, for a version of GLSL."""
    parts = [(SHADERS / part).read_text() for part in ("splat.glsl", name)]
    return "\n".join((f"#version {version}", *parts))


class GrowingBuffer:
    """A storage buffer that is allocated anew only when it must grow."""

    def __init__(self, gl: "moderngl.Context") -> None:
        self._gl, self._limit = gl, int(gl.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        self.buffer = gl.buffer(reserve=1024, dynamic=True)

    def reserve(self, num_bytes: int) -> None:
        if num_bytes > self.buffer.size:
            if num_bytes > self._limit:
                raise InputError(
                    f"GL buffer: expected at most {self._limit} bytes, got {num_bytes}; "
                    "draw fewer Gaussians or a smaller picture"
                )
            self.buffer.release()
            self.buffer = self._gl.buffer(
                reserve=min(num_bytes * 5 // 4, self._limit), dynamic=True
            )

    def write(self, array: NDArray) -> None:
        self.reserve(array.nbytes)
        self.buffer.write(array)

    def read(self, array: NDArray) -> None:
        self.buffer.read_into(array, size=array.nbytes)

    def bind(self, binding: int) -> None:
        self.buffer.bind_to_storage_buffer(binding)
