"""Loops of the mesh half of the decoder, compiled by numba as those of `render/kernels.py` are."""

# pyright: reportUntypedFunctionDecorator=false
import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]


@njit(cache=True, nogil=True, error_model="numpy")
def blend(
    rest: Floats,  # [V, 3] mm
    starts: Ints,  # [V + 1] where each vertex's shapes begin
    shapes: NDArray[np.uint8],  # [E]
    moves: Floats,  # [E, 3] mm at full activation
    rig: Floats,  # [R]
    out: Floats,  # -> [V, 3] mm
) -> None:
    for v in range(len(rest)):
        x, y, z = np.float32(0), np.float32(0), np.float32(0)
        for e in range(starts[v], starts[v + 1]):
            weight = rig[shapes[e]]
            x += weight * moves[e, 0]
            y += weight * moves[e, 1]
            z += weight * moves[e, 2]
        out[v, 0], out[v, 1], out[v, 2] = rest[v, 0] + x, rest[v, 1] + y, rest[v, 2] + z


@njit(cache=True, nogil=True, error_model="numpy")
def measure_gaps(
    vertices: Floats,  # [V, 3] mm
    upper: Ints,  # [P] vertices that face ...
    lower: Ints,  # [P] ... these
    nearest: Ints,  # [C, K] pairs
    out: Floats,  # -> [C] mm, the smallest of the pairs
) -> None:
    for c in range(len(nearest)):
        smallest = np.float32(np.inf)
        for pair in nearest[c]:
            smallest = min(smallest, vertices[upper[pair], 1] - vertices[lower[pair], 1])
        out[c] = smallest


@njit(cache=True, nogil=True, error_model="numpy")
def move_apart(
    vertices: Floats,  # [V, 3] mm, changed in place
    members: Ints,  # [M] vertices
    shares: Floats,  # [M]
    first: Ints,  # [M] the column before each member, and ...
    between: Floats,  # [M] ... how far it is towards the next: 0..1
    by: Floats,  # [C] mm
) -> None:
    for m in range(len(members)):
        low, high = by[first[m]], by[first[m] + 1]
        vertices[members[m], 1] += shares[m] * (low + between[m] * (high - low))


@njit(cache=True, nogil=True, error_model="numpy")
def push_out(
    vertices: Floats,  # [V, 3] mm, changed in place
    members: Ints,  # [M] vertices
    reach: Floats,  # [M] mm from the centre below which they may not come
    center: Floats,  # [3] mm
) -> None:
    for m in range(len(members)):
        v = members[m]
        x = vertices[v, 0] - center[0]
        y = vertices[v, 1] - center[1]
        z = vertices[v, 2] - center[2]
        distance = np.sqrt(x * x + y * y + z * z)
        if distance < reach[m]:
            scale = reach[m] / distance
            vertices[v, 0] = center[0] + x * scale
            vertices[v, 1] = center[1] + y * scale
            vertices[v, 2] = center[2] + z * scale
