"""Textures of people: what skins, relief and eyes give together, each made once and kept."""

from functools import cached_property
from pathlib import Path

import numpy as np

from render.training.data.face_data import FaceData
from render.training.data.people import VirtualPerson
from render.training.fitting.resume import write
from render.training.look import eyes, places, relief, skin, wrinkles
from render.training.look.places import SIZE
from render.types import Floats


class Wardrobe:
    """Keeps in `folder` what takes long."""

    def __init__(self, face: FaceData, folder: Path) -> None:
        self._face, self._folder = face, folder
        self._skins: dict[str, Floats] = {}
        self._grains: dict[str, Floats] = {}
        self._eyes: dict[str, Floats] = {}

    @cached_property
    def places(self) -> places.Places:
        return places.build(self._face)

    @cached_property
    def relief(self) -> relief.Relief:
        path = self._folder / "relief.npz"
        if not path.exists():
            made = relief.build(self._face, self.places)
            kept = {k: v.astype(np.float16) for k, v in vars(made).items()}
            write(path, lambda draft: np.savez(draft, **kept))  # pyright: ignore[reportArgumentType] (stub)
        with np.load(path, allow_pickle=False) as z:
            return relief.Relief(**{k: z[k].astype(np.float32) for k in z.files})

    @cached_property
    def relief_map(self) -> Floats:  # [SIZE, SIZE, 3]
        """Height in mm, oil and roughness: for the mesh renderer."""
        return np.stack([self.relief.height, self.relief.oil, self.relief.rough], -1)

    @cached_property
    def wrinkles(self) -> Floats:  # [SIZE, SIZE, 4]
        """See look/wrinkles.py."""
        return wrinkles.maps(self.places)

    def clean(self, name: str) -> Floats:  # [SIZE, 2 SIZE, 3] linear
        """A stored skin without what was painted on it."""
        if name not in self._skins:
            path = self._folder / f"cleaned_{Path(name).stem}.npy"
            if not path.exists():
                made = skin.cleaned(self._face, name, self.places).astype(np.float16)
                write(path, lambda draft: np.save(draft, made))
            self._skins[name] = np.load(path)
        return self._skins[name].astype(np.float32)

    def grain(self, name: str) -> Floats:  # [SIZE, SIZE, 3]
        """Pores and mottling of a Reom skin; 1 without its picture."""
        if name not in self._grains:
            path = self._folder / f"grain_{name}.npy"
            if not path.exists():
                laid = skin.reom(self._face, name)
                made = np.ones((SIZE, SIZE, 3)) if laid is None else skin.detail(laid, self.places)
                write(path, lambda draft: np.save(draft, made.astype(np.float16)))
            self._grains[name] = np.load(path)
        return self._grains[name].astype(np.float32)

    def texture(self, person: VirtualPerson) -> Floats:  # [SIZE, 2 SIZE, 3] stored, 0..1
        """The skin atlas of a person."""
        first, second = person.skins
        out = self.clean(first)
        if person.mix > 0:
            out = out + np.float32(person.mix) * (self.clean(second) - out)
        out = out * person.tone**2
        front = out[:, :SIZE]
        dark = float(np.median(front[SIZE // 3 : SIZE // 2] @ skin.LUMINANCE)) < skin.DARK
        grain = self.grain("Dark" if dark else "Light")
        out[:, :SIZE] = skin.painted(front, grain, person.skin, self.places, self.relief)
        return np.sqrt(np.clip(out, 0, 1))

    def eye(self, name: str) -> Floats:  # [512, 512, 3] stored
        if name not in self._eyes:
            path = self._folder / f"iris_{name}.npy"
            if not path.exists():
                made = eyes.picture(self._face, name)
                write(path, lambda draft: np.save(draft, made))
            self._eyes[name] = np.load(path)
        return self._eyes[name]
