"""A view turns a driven frame into a picture: decoder, identity and renderer of one avatar."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from encoder.types import DrivenFrame
from render.decoder import identity
from render.decoder.decoder import EXPRESSION_DIM, Decoder
from render.decoder.identity import Identity
from render.types import AHEAD, Camera, Gaussians, Renderer
from sensors.types import HeadPose, InputError

TURNED = HeadPose(quat=(0.96, 0.0, 0.28, 0.0))  # goes all the ways that a head at rest spares
Timer = Callable[[str], AbstractContextManager[object]]


class View(Protocol):
    """What the loop draws with; a window of another process and a headset need none."""

    renderer_name: str

    def warm_up(self) -> None:
        """Compile what is compiled on first use, before the clock starts."""
        ...

    def draw(self, driven: DrivenFrame, timer: Timer) -> NDArray[np.uint8]:
        """The picture [H, W, 4]; `timer` gets the stages decode, draw and readback."""
        ...

    def show(self, avatar: str) -> None:
        """Draw this avatar from now on."""
        ...

    def close(self) -> None: ...


class PortraitView:
    """One fixed camera before the head."""

    def __init__(
        self,
        decoder: Decoder,
        who: Identity,
        renderer: Renderer,
        camera: Camera,
        around: Callable[[Gaussians], Gaussians] | None = None,  # who else is drawn
    ) -> None:
        self._decoder, self._identity, self._around = decoder, who, around
        self._renderer, self._camera = renderer, camera
        self._shown: str = who.name  # or the file that was asked for
        self.renderer_name = renderer.name

    def warm_up(self) -> None:
        face = np.zeros(EXPRESSION_DIM, np.float32)
        driven = DrivenFrame(0, 0, face, AHEAD, head=TURNED, breath=0.5)
        self.draw(driven, lambda _: nullcontext())

    def draw(self, driven: DrivenFrame, timer: Timer) -> NDArray[np.uint8]:
        with timer("decode"):
            _, gaussians = self._decoder.decode(
                driven.expression,
                driven.gaze,
                self._identity,
                driven.head,
                driven.breath,
                reuse=True,
            )
            if self._around is not None:
                gaussians = self._around(gaussians)
        with timer("draw"):
            self._renderer.draw(gaussians, self._camera)
        with timer("readback"):
            return self._renderer.read_rgba()

    def show(self, avatar: str) -> None:
        if avatar != self._shown:
            self._shown = avatar
            with suppress(InputError, OSError):  # the old one stays, as at window and page
                self._identity = identity.load(avatar)

    def close(self) -> None:
        self._renderer.close()
