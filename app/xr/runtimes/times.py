"""XrNow: this moment on the runtime's clock, which need not be the system's monotonic one."""

import ctypes
import time
from collections.abc import Callable, Sequence
from typing import Any

from app.xr.runtimes.calls import library
from sensors.types import NS, Clock

TIMESPEC = "XR_KHR_convert_timespec_time"
COUNTER = "XR_KHR_win32_convert_performance_counter_time"
TIMES = (TIMESPEC, COUNTER)
FUNCTIONS = {
    TIMESPEC: "xrConvertTimespecTimeToTimeKHR",
    COUNTER: "xrConvertWin32PerformanceCounterToTimeKHR",
}


class Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class XrNow:
    """Without either extension, the time of the newest frame stands in for now."""

    def __init__(self, instance: Any, names: Sequence[str], clock: Clock) -> None:
        """`names`: the extensions of the instance."""
        self.frame_time = 0  # XR time at which the newest frame will be seen
        self._handle, self._clock = ctypes.cast(instance, ctypes.c_void_p), clock
        self._kind = next((name for name in TIMES if name in names), "")
        self._convert: Callable[..., int] | None = None
        if self._kind:
            xr = library()
            address = xr.get_instance_proc_addr(instance, FUNCTIONS[self._kind])
            form = ctypes.CFUNCTYPE(
                ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.POINTER(ctypes.c_int64)
            )
            self._convert = form(ctypes.cast(address, ctypes.c_void_p).value or 0)

    def __call__(self) -> tuple[int, int]:
        """Now in ns of our clock, and on the runtime's; 0 there while it is not known."""
        now_ns, found = self._clock.now_ns(), ctypes.c_int64()
        if self._convert is None:
            return now_ns, self.frame_time
        result = self._convert(self._handle, ctypes.byref(self._system_time()), found)
        return now_ns, found.value if result >= 0 else self.frame_time

    def _system_time(self) -> "ctypes.Structure | ctypes.c_int64":
        if self._kind == TIMESPEC:
            return Timespec(*divmod(time.monotonic_ns(), NS))
        count = ctypes.c_int64()
        kernel: Any = getattr(ctypes, "windll").kernel32  # noqa: B009
        kernel.QueryPerformanceCounter(ctypes.byref(count))
        return count
