"""The headset's process, started by XrSink."""

from pathlib import Path
from typing import TYPE_CHECKING

from app.process import child
from app.xr.link import XrInfo, XrMemory
from sensors.clock import MonotonicClock
from sensors.types import InputError

if TYPE_CHECKING:
    from app.xr.runtimes.protocol import Runtime
    from app.xr.scene import Scene
    from render.gl.contexts import GLContext

NICENESS = 10  # where the CPU draws, the tick goes first


def main() -> None:
    """Show the head until the run ends; errors are left in the shared memory."""
    given = child.begin()
    memory, info = XrMemory(given.memories[0]), XrInfo(**given.info)
    status = memory.status

    def wanted() -> bool:
        return not status["ending"] and given.parent_lives()

    def make_scene(context: "GLContext") -> "Scene":
        from app.xr.scene import Scene

        scene = Scene(context, info, lambda: memory.text("avatar"))
        if context.software:
            child.lower_priority(NICENESS)
        return scene

    try:
        from app.xr.loop import XrLoop

        clock = MonotonicClock()
        XrLoop(_runtime(info, clock), memory, make_scene, clock, wanted).run()
    except InputError as error:
        status["error"] = str(error).encode()[:400]
        raise SystemExit(2) from None


def _runtime(info: XrInfo, clock: MonotonicClock) -> "Runtime":
    headless = info.mode == "headless"
    if info.standin is None:
        from app.xr.runtimes.openxr import OpenXrRuntime

        return OpenXrRuntime(headless, clock)
    from app.xr.runtimes.standin import StandInRuntime
    from render.gl.contexts import create_context

    context = None if headless else create_context()
    is_there, (width, height) = Path(info.standin).exists, info.standin_px
    return StandInRuntime(clock, context=context, size=(width, height), is_there=is_there)


if __name__ == "__main__":
    main()
