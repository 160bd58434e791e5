"""Photometric fit: how everyone's Gaussians read their colours from a person's textures.

Reference pictures of many people, expressions, views and lights come from the mesh renderer. Sizes
and opacities leave no holes by design (`render/decoder/cover.py`), so a picture is linear in the
colours, and what is fitted is universal: how much of the sharp and of the blurred textures
Gaussians take on the face, on the eyes and elsewhere. A person never seen gets fitted Gaussians
too. One core, minutes.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from tqdm import tqdm

from render import lighting
from render.avatars import textures
from render.cameras import portrait
from render.decoder import density, mesh_parts, surface
from render.decoder.cover import cover
from render.gl.contexts import create_context
from render.gl.mesh_renderer import MeshRenderer
from render.gl.occlusion import Occlusion
from render.lighting import Lighting, developed, exposed
from render.splats import shine
from render.training.data import people
from render.training.fitting import splatter
from render.training.fitting.coverage import mirrors, reach
from render.training.fitting.resume import write
from render.training.fitting.truth import Truth
from render.training.fitting.wardrobe import Wardrobe
from render.training.geometry.anchors import Anchors, plain, uv
from render.training.geometry.anchors import surface as make_surface
from render.training.geometry.assembly import Assembly
from render.types import Camera, Floats, Gaussians, Shine

SIZE_PX, CROP_PX = 768, 320
VIEWS = 3  # of each person
SIDE_SHARE = 0.2  # of the views lie anywhere around the head, the others in front
WIDTH, OPACITY = 1.0, 0.98  # of the widths that places were given
FIRST = (0.5, 0.5, 0.0, 0.0)  # of the levels of a texture
# Factors of the widths: on the face, where a layer below closes the gaps, and elsewhere on it.
NARROW, FACE = 0.40, 0.86
ROUNDS, RIDGE = 4, 1e-4
# Least squares would rather blur than err: the blends go further the same way, until the detail of
# a picture has the energy of its truth.
PLAIN, SHARPER = np.array([0.0, 1.0, 0.0, 0.0]), 3.0


@dataclass(frozen=True)
class Fitted:
    """Per Gaussian."""

    widths: Floats  # [N] mm
    opacities: Floats  # [N]
    mixing: Floats  # [N, LEVELS] weights of the blurred levels of a texture
    gloss: Floats  # [N] weight of mirrored light
    roughness: Floats  # [N]


@dataclass(frozen=True)
class ReferenceView:
    """One reference picture; a Gaussian's colour is developed(albedo^2 light + mirrored)."""

    levels: Floats  # [N, LEVELS, 3] what its person's textures offer
    shares: csr_array  # [P, N] of the pixels
    light: Floats  # [N, 3] linear, on white
    mirrored: Floats  # [N, 3] linear
    picture: Floats  # [P, 3] 0..1, less the background's share


class Studio:
    """Makes views of virtual people."""

    def __init__(
        self, assembly: Assembly, anchors: Anchors, truth: Truth, wardrobe: Wardrobe
    ) -> None:
        self._assembly, self._anchors, self._truth = assembly, anchors, truth
        self._wardrobe = wardrobe
        face, context = assembly.face, create_context()
        parts = mesh_parts.build(face.faces, face.uv_faces, face.uv, assembly.kinds)
        self._renderer = MeshRenderer(context, parts)
        self._renderer.set_texture("relief", wardrobe.relief_map)
        self._occlusion = Occlusion(context, assembly.solid)
        bare = make_surface(assembly, anchors)
        widths = np.maximum(bare.scales * WIDTH, reach(assembly, anchors))
        kinds, r = assembly.kinds[anchors.triangles], face.regions
        lips = np.concatenate([r["lips"], r["inner_mouth_lip_roll"]])
        edges = np.concatenate([r["eyelids"], lips])
        rest = assembly.posing.rest(face.neutral)
        thick = density.thick(bare, rest.geometry, kinds, r["narrow_face"], edges)
        reached = face.faces[anchors.triangles]
        near, lids = (np.isin(reached, r[k]).any(1) for k in ("narrow_face", "eyelids"))
        near &= (kinds == mesh_parts.SKIN) & ~thick & ~lids
        widths[thick] *= NARROW
        widths[near] *= FACE
        bare = replace(bare, scales=widths)
        self.widths = bare.scales
        self.opacities = np.full(len(kinds), OPACITY, np.float32)
        widths, self._shown = cover(
            *(bare, self.opacities, kinds, r["eyelids"], lips, r["narrow_face"], thick),
            *(assembly.posing, rest.geometry),
        )
        self.surface = replace(bare, scales=widths)
        self.gloss, self.roughness = mirrors(assembly, anchors, wardrobe)
        on_face = np.isin(face.faces[anchors.triangles], r["narrow_face"]).all(1)
        eyes = kinds == mesh_parts.EYE
        self.groups = np.select([on_face & ~eyes, eyes], [1, 2], 0)  # that read alike

    def views(self, seed: int, rng: np.random.Generator) -> list[ReferenceView]:
        """Some expressions of a person, each seen from somewhere in some light."""
        assembly, truth, posing = self._assembly, self._truth, self._assembly.posing
        person = people.draw(assembly.face, seed)
        rest = posing.rest(people.neutral(assembly.face, person))
        skin, eye = self._wardrobe.texture(person), self._wardrobe.eye(person.eye)
        self._renderer.set_texture("skin", skin)
        self._renderer.set_texture("eye", eye)
        levels = textures.levels(
            assembly.kinds[self._anchors.triangles], uv(assembly, self._anchors),
            plain(assembly, self._anchors), skin, eye,
        )  # fmt: skip
        whole = self._occlusion(rest.geometry, assembly.normals(rest.geometry))
        samples = rng.permutation(np.flatnonzero(truth.seeds == seed))[:VIEWS]
        out = []
        for index in samples:
            vertices = posing.pose(truth.rig[index], truth.gaze[index], rest)
            seen = whole.copy()
            seen[:, :2] = truth.seen[index].astype(np.float32) / 255
            lights = list(lighting.LIGHTINGS.values())[rng.integers(len(lighting.LIGHTINGS))]
            out.append(self._view(vertices, seen, levels, camera(rng), lights))
        return out

    def _view(
        self, vertices: Floats, seen: Floats, levels: Floats, camera: Camera, lights: Lighting
    ) -> ReferenceView:
        self._assembly.light_mouth(seen)
        shown = self._assembly.normals(vertices), self._assembly.colors, seen
        picture = self._renderer.draw(vertices, *shown, camera, lights)
        head, count = self.surface, len(self.widths)
        placed = surface.SkinGaussians(
            *(np.empty((count, k), np.float32) for k in (3, 4, 3, 3)),
            shine=np.empty((count, 4), np.float32),
        )
        of_used = np.ascontiguousarray(seen[head.used].T)
        posed = head.posed(vertices, head.at_rest(vertices))
        carried, black = head.light(vertices, of_used, posed, lights), np.zeros_like(placed.means)
        for make in head.gaussians(carried, posed, black, self.gloss, placed):
            make()
        rims = head.interpolate @ of_used[2:].T
        placed.shine[:, 2:] = lighting.SHEEN * self.gloss[:, None] * rims
        light = head.interpolate @ carried[:, surface.LIGHT]
        lobes = Shine(placed.shine, self.roughness, lights.colors)
        cloud = Gaussians(*placed[:3], self._shown, placed.colors, lobes)
        mirrored = exposed(shine.colors_from(cloud, camera.position))
        facing = surface.normals_of(placed.quats)
        facing /= np.linalg.norm(facing, axis=1, keepdims=True) + 1e-9
        shares, left = splatter.shares(
            *(placed.means, facing, placed.scales[:, 0], float(surface.FLATNESS)),
            *(self._shown, camera),
        )
        behind = left[:, None] * np.array(camera.background, np.float32)
        target = picture.reshape(-1, 3).astype(np.float32) / 255 - behind
        return ReferenceView(levels, shares, light, mirrored, target.astype(np.float32))


def camera(rng: np.random.Generator) -> Camera:
    """A part of a portrait, mostly of the face."""
    if rng.random() < SIDE_SHARE:
        yaw, pitch = rng.uniform(-180, 180), rng.uniform(-15, 40)
    else:
        yaw, pitch = rng.uniform(-35, 35), rng.uniform(-15, 20)
    whole = portrait(SIZE_PX, SIZE_PX, float(yaw), float(pitch))
    middle = (0.5 * SIZE_PX, 0.46 * SIZE_PX)
    corner = np.rint(rng.normal(middle, 0.13 * SIZE_PX) - 0.5 * CROP_PX)
    left, top = np.clip(corner, 0, SIZE_PX - CROP_PX)
    K = whole.K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    return replace(whole, K=K, width=CROP_PX, height=CROP_PX)


def load(studio: Studio, seeds: list[int], seed: int, path: Path) -> Fitted:
    """The fit, from `path` if it was made before."""
    if not path.exists():
        made = vars(run(studio, seeds, seed))
        write(path, lambda draft: np.savez(draft, **made))
    with np.load(path, allow_pickle=False) as z:
        return Fitted(**{name: z[name] for name in z.files})


def run(studio: Studio, seeds: list[int], seed: int) -> Fitted:
    """Take the pictures, then fit to all of them at once: Gauss-Newton, one blend a group."""
    views: list[ReferenceView] = []
    for person in tqdm(seeds, desc="pictures", unit="person"):
        views += studio.views(person, np.random.default_rng((seed, person)))
    groups = studio.groups
    blends = np.tile(np.array(FIRST, np.float64), (groups.max() + 1, 1))
    for _ in range(ROUNDS):
        system, sides = np.zeros((*blends.shape, *blends.shape)), np.zeros(blends.shape)
        error = []
        for view in views:
            hessian, slope, left = linearised(view, blends, groups)
            system += hessian
            sides += slope
            error.append(left)
        print(f"fit: {-10 * np.log10(np.mean(error)):.2f} dB", flush=True)
        blends += solved(system, sides)
    blends = PLAIN + SHARPER * (blends - PLAIN)
    mixing = blends[groups].astype(np.float32)
    return Fitted(studio.widths, studio.opacities, mixing, studio.gloss, studio.roughness)


def linearised(
    view: ReferenceView,
    blends: NDArray[np.float64],  # [G, LEVELS]
    groups: NDArray[np.intp],  # [N]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """The normal equations of a view: [G, LEVELS, G, LEVELS], [G, LEVELS]; mean squared error."""
    albedo = np.einsum("nl,nlc->nc", blends[groups].astype(np.float32), view.levels)
    inside = (albedo > 0) & (albedo < 1)
    albedo = albedo.clip(0, 1)
    linear = albedo**2 * view.light + view.mirrored
    step = 1e-3 * (linear + 1e-2)
    colors = developed(linear)
    slope = (developed(linear + step) - colors) / step * 2 * albedo * view.light * inside
    residual = view.picture - view.shares @ colors
    columns = []
    for group in range(len(blends)):
        of_group = (groups == group).astype(np.float32)[:, None]
        for level in range(blends.shape[1]):
            columns.append((view.shares @ (slope * view.levels[:, level] * of_group)).ravel())
    moved = np.stack(columns, 1).astype(np.float64)
    shape = (*blends.shape, *blends.shape)
    sides = (moved.T @ residual.ravel()).reshape(blends.shape)
    return (moved.T @ moved).reshape(shape), sides, float((residual**2).mean())


def solved(
    system: NDArray[np.float64],  # [G, LEVELS, G, LEVELS]
    sides: NDArray[np.float64],  # [G, LEVELS]
) -> NDArray[np.float64]:  # [G, LEVELS]
    """The step; weights of a group still sum to 1, so that nobody gets darker."""
    count, levels = sides.shape
    free = np.eye(levels)[:, 1:] - np.eye(levels)[:, :1]  # [LEVELS, LEVELS - 1]
    spread = np.kron(np.eye(count), free)
    small = spread.T @ system.reshape(count * levels, -1) @ spread
    small += np.eye(len(small)) * RIDGE * np.trace(small) / len(small)
    return (spread @ np.linalg.solve(small, spread.T @ sides.ravel())).reshape(count, levels)
