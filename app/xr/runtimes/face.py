"""Face: what the headset itself sees of it (XR_FB_face_tracking2), to be recorded beside ours."""

import ctypes
from typing import Any

from app.xr.runtimes.calls import library, of_system
from sensors.types import FACE_DIM

FACE = "XR_FB_face_tracking2"
CONFIDENCES = 2  # of the lower and the upper face
Weights = tuple[float, ...]


def sees_faces(instance: Any, system: Any) -> bool:
    """Whether cameras of the headset that is here see the face."""
    faces = of_system(instance, system, library().SystemFaceTrackingProperties2FB())
    return bool(faces.supports_visual_face_tracking)


class Face:
    """`attach` it to a session once, then ask for `weights`; the tracker ends with its session."""

    def __init__(self, instance: Any) -> None:
        xr = library()
        address = xr.get_instance_proc_addr(instance, "xrGetFaceExpressionWeights2FB")
        self._get = ctypes.cast(address, xr.PFN_xrGetFaceExpressionWeights2FB)
        self._weights = (ctypes.c_float * FACE_DIM)()
        self._confidences = (ctypes.c_float * CONFIDENCES)()
        self._tracker: Any = None

    def attach(self, session: Any) -> None:
        xr = library()
        cameras = [xr.FaceTrackingDataSource2FB.VISUAL]  # sound is what ours goes by
        self._tracker = xr.create_face_tracker2_fb(
            session, xr.FaceTrackerCreateInfo2FB(requested_data_sources=cameras)
        )

    def weights(self, xr_time: int) -> Weights | None:
        """[70] 0..1; None while the face is not tracked."""
        xr = library()
        found = xr.FaceExpressionWeights2FB(weights=self._weights, confidences=self._confidences)
        asked = xr.FaceExpressionInfo2FB(time=xr_time)
        result = self._get(self._tracker, ctypes.byref(asked), ctypes.byref(found))
        if result < 0 or not found.is_valid:
            return None
        return tuple(min(max(weight, 0.0), 1.0) for weight in found.weights)
