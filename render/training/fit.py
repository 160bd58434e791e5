"""Photometric fit of the Gaussians that everyone shares, through a differentiable splatter.

Reference pictures of many people, expressions, views and lights come from the mesh renderer. What
is fitted is universal: the width and opacity of every Gaussian, and how its colour is read from a
person's textures. So a person never seen gets fitted Gaussians too. CPU or GPU, resumable.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from tqdm import tqdm

from render import lighting, surface, textures
from render.cameras import portrait
from render.contexts import create_context
from render.mesh_parts import LASHES
from render.mesh_parts import build as build_parts
from render.mesh_renderer import MeshRenderer
from render.training import people, splatter
from render.training.anchors import Anchors, plain, uv
from render.training.anchors import surface as make_surface
from render.training.assembly import Assembly
from render.training.resume import write
from render.training.truth import Truth
from render.types import Camera

Floats = NDArray[np.float32]
SIZE_PX, CROP_PX = 512, 256
SAME_PERSON = 4  # pictures in a row: changing textures takes longer than drawing
SHELF, REUSE = 48, 3  # pictures kept, and steps for each new one
SIDE_SHARE = 0.2  # of the views lie anywhere around the head, the others in front
RATES = {"widths": 0.008, "opacities": 0.03, "mixing": 0.012}
BETAS = (0.9, 0.99)
SELDOM = 15  # pictures


@dataclass(frozen=True)
class Fitted:
    """What the fit found, per Gaussian."""

    widths: Floats  # [N] mm
    opacities: Floats  # [N]
    mixing: Floats  # [N, LEVELS] weights of the blurred levels of a texture


@dataclass(frozen=True)
class View:
    """One reference picture and everything needed to draw it with Gaussians."""

    camera: Camera
    placed: surface.Placed  # without colours
    light: Floats  # [N, 4] linear red, green, blue on a white surface; shine
    stretch: Floats  # [N] of the widths
    picture: Floats  # [H, W, 3] 0..1


class Studio:
    """Makes views of virtual people; textures of a person are read once."""

    def __init__(self, assembly: Assembly, anchors: Anchors, truth: Truth, cache: Path) -> None:
        self._assembly, self._anchors, self._truth, self._cache = assembly, anchors, truth, cache
        face = assembly.face
        parts = build_parts(face.faces, face.uv_faces, face.uv, assembly.kinds)
        self._renderer = MeshRenderer(create_context(), parts)
        lashes = face.image("eyelash_alpha.png")
        self._renderer.set_texture("lashes", lashes if lashes.ndim == 3 else lashes[..., None])
        self.surface = make_surface(assembly, anchors)
        self.faint = torch.from_numpy(
            assembly.kinds[anchors.triangles] == LASHES
        )  # start as good as transparent
        self._dressed: int | None = None

    @property
    def num_people(self) -> int:
        return len(np.unique(self._truth.seeds))

    def seed(self, index: int) -> int:
        """Who a sample shows."""
        return int(self._truth.seeds[index])

    def levels(self, seed: int) -> Floats:  # [N, LEVELS, 3]
        path = self._cache / f"levels_{seed}.npy"
        if not path.exists():
            person, face = people.draw(self._assembly.face, seed), self._assembly.face
            skin, eye = people.texture(face, person), people.eye_texture(face, person.eye)
            kinds = self._assembly.kinds[self._anchors.triangles]
            places = uv(self._assembly, self._anchors)
            colors = plain(self._assembly, self._anchors)
            made = textures.levels(kinds, places, colors, skin, eye)
            write(path, lambda draft: np.save(draft, np.rint(made * 255).astype(np.uint8)))
        return np.load(path).astype(np.float32) / 255

    def view(self, index: int, rng: np.random.Generator) -> View:
        """A random camera and light for one sample of the truth."""
        truth, assembly = self._truth, self._assembly
        seed = int(truth.seeds[index])
        person = people.draw(assembly.face, seed)
        rest = assembly.posing.rest(people.neutral(assembly.face, person))
        vertices = assembly.posing.pose(truth.rig[index], truth.gaze[index], rest)
        seen = truth.seen[index].astype(np.float32) / 255
        if rng.random() < SIDE_SHARE:
            yaw, pitch = rng.uniform(-180, 180), rng.uniform(-15, 40)
        else:
            yaw, pitch = rng.uniform(-35, 35), rng.uniform(-15, 20)
        camera = crop(portrait(SIZE_PX, SIZE_PX, float(yaw), float(pitch)), rng)
        lights = list(lighting.LIGHTINGS.values())[rng.integers(len(lighting.LIGHTINGS))]
        if self._dressed != seed:
            self._renderer.set_texture("skin", people.texture(assembly.face, person))
            self._renderer.set_texture("eye", people.eye_texture(assembly.face, person.eye))
            self._dressed = seed
        picture = self._renderer.draw(
            vertices, assembly.normals(vertices), assembly.colors, seen, camera, lights
        )
        still = self.surface.still(vertices, lights)
        light_seen = seen[self.surface.used].T.copy()
        black = np.zeros((len(still.widths), 3), np.float32)
        placed = surface.Placed(*(np.empty((len(black), k), np.float32) for k in (3, 4, 3, 3)))
        self.surface.place(vertices, light_seen, still, black, placed, lights)
        carried, _ = self.surface.carried(vertices, light_seen, still, lights)
        light = self.surface.interpolate @ carried[:, surface.LIGHT]
        stretch = placed.scales[:, 0] / self.surface.scales
        return View(camera, placed, light, stretch, picture.astype(np.float32) / np.float32(255))


def crop(camera: Camera, rng: np.random.Generator) -> Camera:
    """A part of the picture, mostly of the face: four times as many steps in the same time."""
    middle = (0.5 * SIZE_PX, 0.46 * SIZE_PX)
    corner = np.rint(rng.normal(middle, 0.13 * SIZE_PX) - 0.5 * CROP_PX)
    left, top = np.clip(corner, 0, SIZE_PX - CROP_PX)
    K = camera.K.copy()
    K[0, 2] -= left
    K[1, 2] -= top
    return replace(camera, K=K, width=CROP_PX, height=CROP_PX)


def draw(view: View, levels: Floats, widths: Tensor, opacities: Tensor, mixing: Tensor):
    """The view's Gaussians as a picture [H, W, 3] and the number of pairs."""
    device = mixing.device
    albedo = torch.einsum("nl,nlc->nc", mixing, torch.from_numpy(levels).to(device)).clamp(0, 1)
    light = torch.from_numpy(view.light).to(device)
    colors = torch.sqrt((albedo * albedo * light[:, :3] + light[:, 3:]).clamp(1e-6, 1))
    normals = surface.faced(view.placed.quats)
    normals = normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9)
    flatness = float(surface.FLATNESS)
    flat = splatter.project(view.placed.means, normals, flatness, view.camera, str(device))
    stretched = widths * torch.from_numpy(view.stretch).to(device)
    return splatter.draw(flat, stretched, opacities, colors, view.camera)


def run(
    studio: Studio, count: int, state: Path, steps: int, seed: int, device: str = "cpu"
) -> Fitted:
    """Fit for `steps` pictures; `state` is written every 20 steps and continued from."""
    parameters = initial(studio, device)
    optimizer, done = VisibleAdam(parameters, RATES), 0
    if state.exists():
        done = optimizer.restore(torch.load(state, weights_only=True, map_location=device))
    shelf: list[tuple[int, View]] = []
    losses, bar = (
        [],
        tqdm(range(done, steps), desc="fit", unit="picture", initial=done, total=steps),
    )
    for step in bar:
        rng = np.random.default_rng((seed, step))
        group_of = np.random.default_rng((seed, step // (SAME_PERSON * REUSE)))
        if len(shelf) < SAME_PERSON or step % REUSE == 0:
            per_person = count // studio.num_people
            first = int(group_of.integers(studio.num_people)) * per_person
            index = first + int(rng.integers(per_person))
            shelf = [*shelf[-SHELF + 1 :], (index, studio.view(index, rng))]
            index, view = shelf[-1]
        else:
            index, view = shelf[rng.integers(len(shelf))]
        loss, figures = judge(view, studio.levels(studio.seed(index)), parameters)
        loss.backward()
        optimizer.step(max(0.04, 1 - step / steps))
        losses.append(figures)
        psnr, unlike, pairs = np.mean(losses[-50:], 0)
        bar.set_postfix(psnr=f"{psnr:.2f}", unlike=f"{unlike:.4f}", pairs=f"{pairs:.0f}")
        if step % 20 == 19 or step == steps - 1:
            kept = optimizer.state(step + 1)
            write(state, lambda draft, kept=kept: torch.save(kept, draft))
    settle(parameters, initial(studio, device), optimizer.seldom)
    return Fitted(*(value.detach().cpu().numpy() for value in unpack(parameters)))


@torch.no_grad()
def settle(fitted: dict[str, Tensor], first: dict[str, Tensor], seldom: Tensor) -> None:
    """What hardly any picture showed (the depths of a mouth) keeps its first values, in place."""
    for name, value in fitted.items():
        value[seldom] = first[name][seldom]


def initial(studio: Studio, device: str) -> dict[str, Tensor]:
    """Logarithms of widths, logits of opacities, weights of the textures' levels."""
    scales = torch.from_numpy(studio.surface.scales)
    mixing = torch.zeros(len(scales), textures.LEVELS)
    mixing[:, 0], mixing[:, 1] = 0.4, 0.6
    opacities = torch.where(studio.faint, -1.0, 2.5)
    first = {"widths": torch.log(scales), "opacities": opacities, "mixing": mixing}
    return {name: value.to(device).requires_grad_() for name, value in first.items()}


def unpack(parameters: dict[str, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Widths in mm, opacities, weights of the levels; these sum to 1: nobody gets darker."""
    mixing = parameters["mixing"]
    mixing = mixing + (1 - mixing.sum(1, keepdim=True)) / mixing.shape[1]
    return torch.exp(parameters["widths"]), torch.sigmoid(parameters["opacities"]), mixing


def judge(
    view: View, levels: Floats, parameters: dict[str, Tensor]
) -> tuple[Tensor, tuple[float, float, float]]:
    """The loss of one view; PSNR, 1 - SSIM and pairs for the progress line."""
    widths, opacities, mixing = unpack(parameters)
    picture, pairs = draw(view, levels, widths, opacities, mixing)
    target = torch.from_numpy(view.picture).to(picture.device)
    square = ((picture - target) ** 2).mean()
    unlike = splatter.dissimilarity(picture, target).mean()
    loss = (picture - target).abs().mean() + 2.0 * square + 0.25 * unlike
    psnr = -10 * torch.log10(square.detach() + 1e-12)
    return loss, (float(psnr), float(unlike.detach()), float(pairs))


class VisibleAdam:
    """Adam that moves only the Gaussians of the view.

    With crops most Gaussians have no gradient most of the time: plain Adam would carry them on by
    their momentum, then throw them far at the first gradient after a pause.
    """

    def __init__(self, parameters: dict[str, Tensor], rates: dict[str, float]) -> None:
        self._parameters, self._rates = parameters, rates
        self._first = {k: torch.zeros_like(v) for k, v in parameters.items()}
        self._second = {k: torch.zeros_like(v) for k, v in parameters.items()}
        self._count = torch.zeros_like(parameters["widths"], requires_grad=False)

    @torch.no_grad()
    def step(self, scale: float) -> None:
        gradient = self._parameters["widths"].grad
        assert gradient is not None
        seen = gradient != 0
        self._count[seen] += 1
        for name, value in self._parameters.items():
            g = value.grad
            assert g is not None
            shape = (-1,) + (1,) * (g.dim() - 1)
            count = self._count[seen].reshape(shape)
            first = self._first[name][seen] * BETAS[0] + (1 - BETAS[0]) * g[seen]
            second = self._second[name][seen] * BETAS[1] + (1 - BETAS[1]) * g[seen] ** 2
            self._first[name][seen], self._second[name][seen] = first, second
            ahead = first / (1 - BETAS[0] ** count)
            size = (second / (1 - BETAS[1] ** count)).sqrt() + 1e-12
            value[seen] -= scale * self._rates[name] * ahead / size
            value.grad = None

    @property
    def seldom(self) -> Tensor:
        """[N] true where too few pictures showed a Gaussian to fit it."""
        return self._count < SELDOM

    def state(self, done: int) -> dict[str, Tensor]:
        out = {"done": torch.tensor(done), "count": self._count}
        for part, values in (("value", self._parameters), ("first", self._first),
                             ("second", self._second)):  # fmt: skip
            out |= {f"{part}.{name}": value.detach() for name, value in values.items()}
        return out

    @torch.no_grad()
    def restore(self, state: dict[str, Tensor]) -> int:
        self._count.copy_(state["count"])
        for part, values in (("value", self._parameters), ("first", self._first),
                             ("second", self._second)):  # fmt: skip
            for name, value in values.items():
                value.copy_(state[f"{part}.{name}"])
        return int(state["done"])
