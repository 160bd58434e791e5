"""`livedrive doctor`: is everything here that the head needs? One line a part, with the cure."""

import sys
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(kw_only=True)
class Doctor:
    """Check the installation; exit status 1 when a part is missing."""

    def run(self) -> None:
        failed = 0
        for name, check in CHECKS.items():
            try:
                print(f"ok      {name}: {check()}")
            except (OSError, ImportError, ValueError, RuntimeError) as error:
                failed += 1
                print(f"FAILED  {name}: {' '.join(str(error).split())}")
        if failed:
            raise SystemExit(1)


def _opengl() -> str:
    from render.splats.renderer import create_renderer

    renderer = create_renderer("egl" if sys.platform == "linux" else "auto")
    name = renderer.name
    renderer.close()
    return name


def _encoder() -> str:
    from encoder.inference import load_driver

    driver = load_driver()
    return f"{driver.backend.name}, condition {driver.config.condition}"


def _avatars() -> str:
    from render.decoder import identity
    from render.decoder.decoder import Decoder
    from render.decoder.learned import avatar_files

    Decoder.load()
    return ", ".join(identity.load(name).name for name in avatar_files.names())


def _photographs() -> str:
    from render.avatars.photos.shape.detector import FaceDetector
    from sensors.types import InputError

    try:
        FaceDetector().close()
    except InputError as error:
        return f"none (only avatar create --photos needs it): {error}"
    return "the detector of faces"


def _scans() -> str:
    from render.avatars.surface_scan import INSTALL

    try:
        import trimesh
    except ImportError:
        return f"none (only avatar create --geometry needs it); run: {INSTALL}"
    return f"trimesh {trimesh.__version__}"


def _video() -> str:
    import av
    from av.codec import Codec

    return f"PyAV {av.__version__}, H.264 {Codec('libx264', 'w').long_name}"


def _torch() -> str:
    import torch

    gpu = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no CUDA GPU (not needed)"
    return f"PyTorch {torch.__version__}, {gpu}"


def _microphone() -> str:
    from sensors.audio.portaudio import microphones, silence_native_messages

    silence_native_messages()
    names = [mic.name for mic in microphones()]
    if not names:
        return (
            "none found (replay needs none); plug one in, or for PulseAudio and PipeWire run: "
            "sudo apt-get install libasound2-plugins"
        )
    return ", ".join(names)


def _eye_cameras() -> str:
    from sensors.cameras.discovery import found_devices
    from sensors.cameras.table import EXAMPLES
    from sensors.types import InputError

    found = list(found_devices())
    problems = [f"{device.spec}: {device.problem}" for device in found if device.problem]
    if problems:
        raise InputError("; ".join(problems))
    return (
        ", ".join(device.spec for device in found)
        or f"none plugged in (not needed; --eyes also takes {EXAMPLES})"
    )


def _head_trackers() -> str:
    from sensors.head.spec import EXAMPLES

    return f"none needed; --head also takes {EXAMPLES}"


def _openxr() -> str:
    from app.xr.runtimes.openxr import describe
    from app.xr.runtimes.protocol import NoRuntimeError

    try:
        return describe()
    except NoRuntimeError as error:
        return f"none (only --xr needs it): {error}"


def _usb() -> str:
    from sensors.cameras.discovery import check_usb_library

    return check_usb_library()


def _programs() -> str:
    from app.sinks.table import SCHEMES

    return ", ".join(entry.example for entry in SCHEMES.values())


CHECKS: dict[str, Callable[[], str]] = {
    "OpenGL": _opengl,
    "encoder": _encoder,
    "avatars": _avatars,
    "photographs": _photographs,
    "scans": _scans,
    "video": _video,
    "torch": _torch,
    "microphone": _microphone,
    "USB": _usb,
    "eye cameras": _eye_cameras,
    "head trackers": _head_trackers,
    "OpenXR": _openxr,
    "programs to send to": _programs,
}
