"""The values that flow through `render`: decoder -> Mesh, Gaussians -> Renderer -> picture.

World: millimetres, +x is the subject's left, +y is up, +z is forward out of the face.
Camera: OpenCV convention, x right, y down, z into the scene. Quaternions are wxyz.
"""

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from sensors.types import InputError

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Ints = NDArray[np.int32]
Shorts = NDArray[np.uint16]
U32, U64 = NDArray[np.uint32], NDArray[np.uint64]

AHEAD = np.array([[0, 0, 1], [0, 0, 1]], np.float32)  # gaze of both eyes
Density = Literal["16k", "32k", "65k"]  # Gaussians on a head, without its hair
DENSITY: Density = "65k"  # of a head that has the machine for itself
SHARED_DENSITY: Density = "32k"  # of one that is sent to a page, drawn for two eyes, or not alone
DEFAULT_BACKGROUND = (0.16, 0.16, 0.16)


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh of the head."""

    vertices: NDArray[np.float32]  # [V, 3] mm
    faces: NDArray[np.int32]  # [F, 3] indices into vertices


# Arrays of Gaussians, and the shape of a row.
FIELDS: dict[str, tuple[int, ...]] = {
    "means": (3,),
    "quats": (4,),
    "scales": (3,),
    "opacities": (),
    "colors": (3,),
}


@dataclass(frozen=True)
class Shine:
    """What the first M Gaussians of a cloud mirror (`render/splats/shine.py`)."""

    weights: NDArray[np.float32]  # [M, 4] of each lamp's light
    roughness: NDArray[np.float32]  # [M] 0..1
    lamps: NDArray[np.float32]  # [4, 3] linear light


@dataclass(frozen=True)
class Gaussians:
    """A cloud of coloured 3D Gaussians, in world space."""

    means: NDArray[np.float32]  # [N, 3] mm
    quats: NDArray[np.float32]  # [N, 4] wxyz, any non-zero length
    scales: NDArray[np.float32]  # [N, 3] mm, standard deviations along the local axes
    opacities: NDArray[np.float32]  # [N] 0..1
    colors: NDArray[np.float32]  # [N, 3] 0..1, sRGB values; blending is done in these values
    shine: Shine | None = None  # on top of the colours: it depends on the viewer

    def __len__(self) -> int:
        return len(self.means)

    def check(self) -> None:
        """Raise InputError unless every array has the shape stated above."""
        n = len(self.means)
        for name, row in FIELDS.items():
            shape, got = (n, *row), getattr(self, name).shape
            if got != shape:
                raise InputError(
                    f"Gaussians.{name}: expected shape {list(shape)}, got {list(got)}; "
                    f"give one row a Gaussian ({n} means)"
                )


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion."""

    viewmat: NDArray[np.float64]  # [4, 4] world to camera
    K: NDArray[np.float64]  # [3, 3] px; pixel centres lie at +0.5
    width: int  # px
    height: int  # px
    near_mm: float = 1.0  # Gaussians whose centre is nearer than this are not drawn
    background: tuple[float, float, float] = DEFAULT_BACKGROUND  # 0..1, sRGB values

    @property
    def position(self) -> NDArray[np.float64]:  # [3] mm
        """Where the viewer is."""
        return -self.viewmat[:3, :3].T @ self.viewmat[:3, 3]


class Renderer(Protocol):
    """Draws Gaussians; the GL renderers and the numpy reference all satisfy this."""

    @property
    def name(self) -> str:
        """What draws, for reports, e.g. "quads on llvmpipe (...)"."""
        ...

    @property
    def dropped(self) -> int:
        """Gaussians of the last draw that are NaN, infinite, without size or transparent."""
        ...

    def draw(self, gaussians: Gaussians, camera: Camera) -> None:
        """Draw one picture; its size is that of the camera."""
        ...

    def read_rgba(self) -> NDArray[np.uint8]:
        """Return the last picture [H, W, 4], top row first; valid until the next draw."""
        ...

    def close(self) -> None:
        """Free everything; may be called twice."""
        ...
