"""The head as a webcam of this machine, for video calls and streaming (v4l2loopback)."""

# pyright: reportMissingTypeStubs=false

from typing import Any

import numpy as np

from app.drive.sink import FrameResult, RunInfo
from sensors.types import FPS, InputError

MODPROBE = "sudo modprobe v4l2loopback exclusive_caps=1 card_label=livedrive"


class VirtualCameraSink:
    """Sends every drawn picture; where a draw was skipped, viewers keep the last one."""

    def __init__(self, device: str | None, backend: str | None = None) -> None:
        """`device` is like /dev/video10; None takes the first loopback device. `backend` is one of
        pyvirtualcam's; None takes the system's."""
        try:
            import pyvirtualcam
        except ImportError as error:
            raise InputError(
                f"--virtual-camera: expected pyvirtualcam, got {error}; "
                "run: pip install livedrive[camera]"
            ) from error
        self._library, self._device, self._backend = pyvirtualcam, device, backend
        self._camera: Any = None

    def on_start(self, info: RunInfo) -> None:
        try:
            self._camera = self._library.Camera(
                *(info.width, info.height, FPS),
                fmt=self._library.PixelFormat.RGB,
                device=self._device,
                backend=self._backend,
            )
        except RuntimeError as error:
            wanted = self._device or "a v4l2loopback device"
            raise InputError(
                f"--virtual-camera: expected {wanted}, got: {error}; "
                f"run: sudo apt install v4l2loopback-dkms && {MODPROBE}"
            ) from error

    def on_frame(self, result: FrameResult) -> None:
        if result.picture is not None:
            self._camera.send(np.ascontiguousarray(result.picture[..., :3]))

    def close(self) -> None:
        self._camera.close()
