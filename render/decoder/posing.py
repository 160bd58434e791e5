"""The mesh half of the decoder: rig activations and gaze -> vertices, for one person at rest.

Linear blendshapes, then what makes them a face: eyeballs that turn, lids that slide on them and
shut, lips that meet and never cross (`render/decoder/lines.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import asin, atan2, cos, radians, sin

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from render.decoder.kernels import contact
from render.decoder.kernels import posing as posing_kernels
from render.decoder.lines import Line, Lips, eye_radius, lid_reach, undo_crossings
from render.types import Floats, Ints

GEOMETRY_STEPS = np.float32(128)  # a millimetre; int16 reaches 256 mm
TOUCH_MM = 0.08  # gap of sealed lips and shut lids
SOFT_LIMIT = (-0.05, 1.05)  # activations beyond it are drawn in: any code is a plausible face
CLOSE_MARGIN = 0.04
CORNEA_MM = np.float32(0.8)  # of an eyeball: what stands out from its sphere by more
MOST_MM = np.float32(1.1)  # that it may stand out: a cornea of more pokes through its lid
# Pupils point so far outward of where one looks (angle kappa: 4 to 6 degrees in adults); without it
# faces seem cross-eyed. Of these the least: who looks ahead here then seems to look at the viewer.
KAPPA_DEG = 4.0
LIDS_RAD = 0.5  # of a gaze up or down that eyeLookUp and eyeLookDown follow in full
OVERSHOOT = 0.25  # how far beyond the limit an activation can get


@dataclass(frozen=True)
class Rest:
    """One person's face at rest, ready to be posed."""

    geometry: Floats  # [V, 3] mm, lips sealed
    eye_centers: Floats  # [2, 3] mm, left eye first
    reach: tuple[Floats, Floats]  # [M] mm per eye, see contact.lid_reach
    shut: Floats  # [2, C] mm that the lids open more (below 0: close more) at a full blink


@dataclass(frozen=True)
class Posing:
    """Shared by everyone; holds no state."""

    basis: csr_array  # [V * 3, R] mm at full activation
    eyeballs: tuple[Ints, Ints]  # vertex sets, left eye first
    lids: tuple[Ints, Ints]  # vertices that slide on each eyeball
    mouth: Line
    lips: Lips
    lid_lines: tuple[Line, Line]
    blinks: tuple[int, int]  # rig columns of eyeBlink, left eye first
    jaw: tuple[int, int]  # rig columns of jawOpen and of mouthClose, which only undoes it
    looks: Ints  # [2, 2] rig columns of eyeLookUp and eyeLookDown, left eye first

    def rest(self, geometry: Floats, sealed: bool = False) -> Rest:
        """A person from a neutral geometry [V, 3] mm; lips are sealed unless they are already,
        and pupils point straight ahead."""
        geometry = geometry.astype(np.float32).copy()
        if not sealed:
            for _ in range(4):
                self.mouth.open(geometry, TOUCH_MM - self.mouth.gaps(geometry))
            for eye in self.eyeballs:
                geometry[eye] = straightened(geometry[eye])
            # In the steps of avatar files: one that was saved and loaded rests where it rested.
            steps = np.rint(geometry * GEOMETRY_STEPS)
            geometry = (steps / GEOMETRY_STEPS).astype(np.float32)
        centers = np.stack([sphere_centre(geometry[eye]) for eye in self.eyeballs])
        reach = tuple(
            lid_reach(geometry, lids, c, eye_radius(geometry[eye], c))
            for lids, eye, c in zip(self.lids, self.eyeballs, centers, strict=True)
        )
        shut = np.zeros((2, len(self.lid_lines[0].columns)), np.float32)
        draft = Rest(geometry, centers, (reach[0], reach[1]), shut)
        for _ in range(4):
            posed = self._blendshapes(self.full_blink(), draft)
            for eye, line in enumerate(self.lid_lines):
                shut[eye] += TOUCH_MM - line.gaps(posed)
        return draft

    def pose(self, rig: Floats, gaze: Floats, rest: Rest) -> Floats:
        """rig [R], gaze [2, 3] unit vectors -> vertices [V, 3] mm, head at rest. Lids go up and
        down with the eyes, at least."""
        vertices = self._blendshapes(self.limited(followed(rig, gaze, self.looks)), rest)
        undo_crossings(vertices, rest.geometry, self.mouth, self.lips, self.lid_lines)
        for eye, members in enumerate(self.eyeballs):
            posing_kernels.turn_eye(
                *(
                    rest.geometry,
                    members,
                    rest.eye_centers[eye],
                    eye_rotation(gaze[eye], eye),
                    vertices,
                )
            )
        return vertices

    def openings(self, vertices: Floats) -> list[Floats]:
        """The edges of both eyes' lids, left first, see Line.opening."""
        eyes = zip(self.lid_lines, self.eyeballs, strict=True)
        return [line.opening(vertices, vertices[members]) for line, members in eyes]

    def limited(self, rig: Floats) -> Floats:  # [..., R] -> [..., R]
        """Activations as they are drawn: drawn in, and mouthClose never beyond jawOpen."""
        rig = limit(rig)
        opened, closed = self.jaw
        most = np.maximum(rig[..., opened], np.float32(0)) + np.float32(CLOSE_MARGIN)
        rig[..., closed] = np.minimum(rig[..., closed], most)
        return rig

    def _blendshapes(self, rig: Floats, rest: Rest) -> Floats:
        vertices = np.empty_like(rest.geometry)
        posing_kernels.blend(rest.geometry.reshape(-1), *self.shapes, rig, vertices.reshape(-1))
        lines = self.lid_lines[0].sides, self.lid_lines[1].sides
        shut = rest.shut * rig[list(self.blinks)].clip(0, 1)[:, None]
        contact.shut_lids(vertices, lines, shut, self.lids, rest.reach, rest.eye_centers)
        return vertices

    @cached_property
    def shapes(self) -> tuple[Ints, NDArray[np.uint8], NDArray[np.int16], np.float32]:
        """The basis by blocks of vertices: where each one's shapes begin [B + 1], these [E], how
        they move [E, WIDTH], in units of so many mm: a thousandth, half the memory to read."""
        width = posing_kernels.WIDTH
        dense = self.basis.toarray()
        moves = np.concatenate([dense, np.zeros((-len(dense) % width, dense.shape[1]), "f4")])
        moves = moves.reshape(-1, width, moves.shape[1]).transpose(0, 2, 1)
        block, shape = np.nonzero(moves.any(2))
        starts = np.searchsorted(block, np.arange(len(moves) + 1))
        unit = np.float32(np.abs(dense).max() / np.iinfo(np.int16).max)
        steps = np.rint(moves[block, shape] / unit).astype(np.int16)
        return starts.astype(np.int32), shape.astype(np.uint8), steps, unit

    @cached_property
    def tongue(self) -> Ints:
        """Vertices that the last two shapes raise."""
        return np.unique(self.basis[:, -2:].nonzero()[0] // 3).astype(np.int32)

    def full_blink(self) -> Floats:  # [R]
        """Activations that shut both eyes."""
        _, count = self.basis.shape  # pyright: ignore[reportGeneralTypeIssues] (stub: may be None)
        rig = np.zeros(count, np.float32)
        rig[list(self.blinks)] = 1
        return rig


def limit(rig: Floats) -> Floats:
    """Identity inside SOFT_LIMIT, beyond it a smooth approach to OVERSHOOT more."""
    low, high = SOFT_LIMIT
    inside = np.minimum(np.maximum(rig, np.float32(low)), np.float32(high))
    return inside + np.float32(OVERSHOOT) * np.tanh((rig - inside) / np.float32(OVERSHOOT))


def look_columns(rig_names: Sequence[str]) -> Ints:  # [2, 2] see Posing.looks
    names = [[f"eyeLook{way}_{side}" for way in ("Up", "Down")] for side in "LR"]
    return np.array([[rig_names.index(name) for name in eye] for eye in names], np.int32)


def followed(rig: Floats, gaze: Floats, looks: Ints) -> Floats:
    """[R], [2, 3] unit -> [R] whose lids go up and down with the eyes; looks: see Posing."""
    up = np.arcsin(gaze[:, 1].clip(-1, 1)) / np.float32(LIDS_RAD)
    out = rig.copy()
    out[looks] = np.maximum(rig[looks], np.stack([up, -up], 1).clip(0, 1))
    return out


def straightened(eyeball: Floats) -> Floats:  # [n, 3] mm -> [n, 3]
    """An eyeball whose cornea points straight ahead."""
    centre = sphere_centre(eyeball)
    arm = eyeball - centre
    length = np.linalg.norm(arm, axis=1)
    out = np.clip(length - np.median(length), 0, None) * (arm[:, 2] > 0)
    apex = np.clip(out - min(CORNEA_MM, 0.5 * out.max()), 0, None) @ arm
    size = np.linalg.norm(apex)
    if size == 0:
        return eyeball
    too_far = out * (1 - min(MOST_MM / out.max(), 1))
    arm = arm * (1 - too_far / length)[:, None]
    return (arm @ gaze_rotation((apex / size).astype(np.float32)) + centre).astype(np.float32)


def eye_rotation(gaze: Floats, eye: int) -> Floats:  # [3] unit, 0: left -> [3, 3]
    """Rotation of a straightened eyeball that looks along `gaze`."""
    return gaze_rotation(gaze) @ KAPPAS[eye]


def gaze_rotation(gaze: Floats) -> Floats:  # [3] unit -> [3, 3]
    """Turns straight ahead to `gaze`: yaw about y, then pitch, no roll."""
    yaw, pitch = atan2(gaze[0], gaze[2]), -asin(min(max(gaze[1], -1), 1))
    cy, sy, cp, sp = cos(yaw), sin(yaw), cos(pitch), sin(pitch)
    rows = ((cy, sy * sp, sy * cp), (0, cp, -sp), (-sy, cy * sp, cy * cp))
    return np.array(rows, np.float32)


def outward(eye: int) -> Floats:  # -> [3] unit
    """The way the pupil points of an eye that looks ahead: 0 is the left one, at +x."""
    kappa = radians(KAPPA_DEG) * (1 - 2 * eye)
    return np.array((sin(kappa), 0, cos(kappa)), np.float32)


def sphere_centre(points: Floats) -> Floats:  # [n, 3] -> [3]
    """Centre of the sphere through the back half of an eyeball's vertices."""
    back = points[points[:, 2] < points[:, 2].mean()].astype(np.float64)
    system = np.c_[2 * back, np.ones(len(back))]
    return np.linalg.lstsq(system, (back**2).sum(1), rcond=None)[0][:3].astype(np.float32)


KAPPAS = tuple(gaze_rotation(outward(eye)) for eye in range(2))
