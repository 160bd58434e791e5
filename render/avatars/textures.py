"""Colours from pictures: files, bilinear look-ups, blurred levels of a texture at the anchors."""

import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, minimum_filter
from scipy.sparse import csr_array

from render.decoder import mesh_parts
from render.types import Floats
from sensors import files
from sensors.types import InputError

SKIN_SIGMAS = (0.7, 2.0, 4.0, 8.0)  # texels of the skin atlas (2048 x 1024)
EYE_SIGMAS = (0.7, 1.5, 3.0, 6.0)  # texels of an eye's picture
LEVELS = len(SKIN_SIGMAS)
SIZE = 512  # texels of a side of half the atlas: about what a scan or a photograph shows


@contextmanager
def opened(path: Path, what: str) -> Generator[Any]:
    """The image of a file of somebody's, for PIL to decode in the block. Raises InputError where it
    is none, is cut off or too large; `what` was expected: a photograph."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings(), files.open_regular(path) as file:
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # of half the limit
            with Image.open(file) as image:
                yield image
    except (FileNotFoundError, InputError):
        raise
    except Image.DecompressionBombError:
        most = 2 * (Image.MAX_IMAGE_PIXELS or 0) // 1_000_000
        raise InputError(
            f"{path}: expected at most {most} million pixels, got more; scale it down"
        ) from None
    except (
        *(UnidentifiedImageError, SyntaxError),
        *(ValueError, OSError, EOFError, TypeError, KeyError),
    ) as error:
        if "truncated" in str(error).lower():
            raise InputError(
                f"{path}: expected a whole picture, got one that is cut off; copy it again"
            ) from None
        text = "another kind of file" if isinstance(error, UnidentifiedImageError) else error
        raise InputError(
            f"{path}: expected {what}, got {text}; save it as JPEG or PNG"[:400]
        ) from None


def rgb(image: Any) -> Any:
    """PIL clips 16 bits of grey to white; here they are scaled to 8."""
    from PIL import Image

    if image.mode == "I" or image.mode.startswith("I;16"):
        image = Image.fromarray((np.asarray(image) / 257).clip(0, 255).astype(np.uint8))
    return image.convert("RGB")


def sample(image: Floats, at: Floats) -> Floats:
    """Bilinear look-up of `image` [H, W, C] at `at` [n, 2] (v up) -> [n, C]."""
    height, width = image.shape[:2]
    rows = (1 - at[:, 1] % 1.0) * height - 0.5
    columns = (at[:, 0] % 1.0) * width - 0.5
    return np.stack(
        [
            map_coordinates(image[..., c], [rows, columns], order=1, mode="nearest")
            for c in range(image.shape[-1])
        ],
        1,
    ).astype(np.float32, copy=False)


def soft(image: Floats, sigma: float) -> Floats:  # [H, W, C]
    """Blurred by so many texels."""
    return np.asarray(gaussian_filter(image, (sigma, sigma, 0), truncate=3.0), np.float32)


def sharper(image: Floats, blur: float, fine: float, gain: float) -> Floats:  # [H, W, C]
    """Blurred by some texels, and what is finer than some more of them so much stronger."""
    even = soft(image, blur)
    return np.asarray(even + (gain - 1) * (even - soft(image, fine)), np.float32)


def bounds(image: Floats, at: Floats, size: int) -> tuple[Floats, Floats]:
    """The darkest and the lightest colours [n, 3] within so many texels of `at` [n, 2]."""
    even, window = soft(image, EYE_SIGMAS[1]), (size, size, 1)
    low, high = (
        np.asarray(f(even, size=window), np.float32) for f in (minimum_filter, maximum_filter)
    )
    return sample(low, at), sample(high, at)


def levels(
    kind: NDArray[np.integer],  # [N] see mesh_parts
    at: Floats,  # [N, 2] texture coordinates
    plain: Floats,  # [N, 3] colour of what has no texture, gain of what has
    skin: Floats,  # [1024, 2048, 3]
    eye: Floats,  # [512, 512, 3]
) -> Floats:  # [N, LEVELS, 3]
    """What each anchor sees of the person's pictures, from sharp to blurred."""
    out = np.repeat(plain[:, None], LEVELS, 1)
    for which, image, sigmas, scale in (
        (mesh_parts.SKIN, skin, SKIN_SIGMAS, (0.5, 1.0)),
        (mesh_parts.EYE, eye, EYE_SIGMAS, (1.0, 1.0)),
    ):
        rows = kind == which
        place = (at[rows] * np.array(scale, np.float32)).astype(np.float32)
        for level, sigma in enumerate(sigmas):
            out[rows, level] *= sample(soft(image, sigma), place)
    return out


def at_vertices(
    skin: Floats,  # [H, 2 H, 3]
    colors: NDArray[np.uint8],  # [U, 3] of what has no texture
    uv: Floats,  # [U, 2]
    on_skin: NDArray[np.bool_],  # [U]
) -> Floats:  # [U, 3]
    """The person's skin at the vertices, coarse; everyone's colours elsewhere."""
    out = colors.astype(np.float32) / np.float32(255)
    step = max(1, skin.shape[0] // 128)
    out[on_skin] = sample(skin[::step, ::step], uv[on_skin] * np.array([0.5, 1], "f4"))
    return out


def between(uv: Floats) -> csr_array:  # [N, 2] -> [SIZE * 2 * SIZE, N]
    """What lies between places of the atlas: shares of the corners of the triangle around each
    texel, or the nearest place beyond all of them."""
    from scipy.spatial import Delaunay, KDTree

    row, column = np.indices((SIZE, SIZE)).reshape(2, -1)
    texels = np.stack([(column + 0.5) / SIZE, 1 - (row + 0.5) / SIZE], 1)
    corners, shares = np.zeros((2, SIZE, SIZE, 3), np.int32), np.zeros((2, SIZE, SIZE, 3))
    for tile in (0, 1):
        own = np.flatnonzero(np.floor(uv[:, 0]) == tile)
        places = uv[own].astype(np.float64) - np.array([tile, 0])
        mesh = Delaunay(places)
        around = mesh.find_simplex(texels)
        frame = mesh.transform[around]
        two = np.einsum("tij,tj->ti", frame[:, :2], texels - frame[:, 2])
        share = np.concatenate([two, 1 - two.sum(1, keepdims=True)], 1)
        which, out = mesh.simplices[around], (around < 0) | np.isnan(two).any(1)
        share[out] = (1, 0, 0)
        which[out, 0] = KDTree(places).query(texels[out])[1]
        corners[tile] = own[which].reshape(SIZE, SIZE, 3)
        shares[tile] = share.reshape(SIZE, SIZE, 3)
    order = (x.transpose(1, 0, 2, 3).ravel() for x in (shares, corners))  # tiles side by side
    starts = np.arange(0, 6 * SIZE * SIZE + 1, 3)
    return csr_array((*order, starts), shape=(2 * SIZE * SIZE, len(uv)))
