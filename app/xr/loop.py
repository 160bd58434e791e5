"""The headset's loop: opens a session, draws what it asks for, and opens another after a loss.

Runtime.open -> Session -> wait_frame -> Scene.draw -> end_frame
     ^------- lost: tried again -------'      head -> link -> loop of the run
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

from app.xr.budget import Budget
from app.xr.link import XrMemory
from app.xr.runtimes.protocol import (
    NoRuntimeError,
    Runtime,
    Session,
    SessionEndedError,
    SessionLostError,
)
from sensors.types import NS, Clock

if TYPE_CHECKING:
    from app.xr.scene import Scene
    from render.gl.contexts import GLContext

RETRY_NS = NS // 2  # between two tries to open a session
IDLE_NS = NS // 100  # between two looks while nothing is shown
POSE_NS = NS // 120  # between two poses where nothing is drawn
NAN = float("nan")


class XrLoop:
    """One process's headset; `run` returns when the run is over."""

    def __init__(
        self,
        runtime: Runtime,
        memory: XrMemory,
        make_scene: "Callable[[GLContext], Scene]",
        clock: Clock,
        wanted: Callable[[], bool],  # False: the run has ended
    ) -> None:
        self._runtime, self._memory, self._make_scene = runtime, memory, make_scene
        self._clock, self._wanted = clock, wanted
        self._scene: Scene | None = None
        self._tick = -1
        self._pose_ns = 0

    def run(self) -> None:
        """Raises NoRuntimeError where the very first session cannot be had and never will be."""
        status = self._memory.status
        while self._wanted():
            try:
                self._serve()
            except SessionLostError as error:
                self._tell(str(error))
                self._clock.sleep_until_ns(self._clock.now_ns() + RETRY_NS)
            except SessionEndedError as error:
                status["ended"] = True
                self._tell(str(error))
                break
        if self._scene is not None:
            self._scene.close()

    def _serve(self) -> None:
        """One session, from its opening to its loss or to the end of the run."""
        status, session = self._memory.status, self._open()
        try:
            status["runtime"] = session.name.encode()[:100]
            status["width"], status["height"] = session.size
            scene = self._scene_for(session)
            self._tell("")
            budget = Budget()
            while self._wanted():
                shows = session.showing()
                status["state"] = session.state.encode()
                if shows and scene is not None:
                    self._frame(session, scene, budget)
                else:
                    self._clock.sleep_until_ns(
                        self._clock.now_ns() + (IDLE_NS if scene else POSE_NS)
                    )
                self._post_head(session)
        except SessionLostError:
            status["losses"] += 1
            raise
        finally:
            session.close()

    def _open(self) -> Session:
        try:
            return self._runtime.open()
        except NoRuntimeError as error:
            if not self._memory.status["ready"]:
                raise
            raise SessionLostError(str(error)) from None

    def _scene_for(self, session: Session) -> "Scene | None":
        if session.context is None:
            return None
        if self._scene is None:
            self._scene = self._make_scene(session.context)
        self._scene.forget_place()
        return self._scene

    def _frame(self, session: Session, scene: "Scene", budget: Budget) -> None:
        status = self._memory.status
        frame = session.wait_frame()
        ticks = self._memory.ticks.after(self._tick)
        if ticks:
            self._tick = int(ticks[-1]["number"])
            scene.take(ticks)
        began_ns = self._clock.now_ns()
        try:
            if frame.eyes is not None:
                scene.draw(session, frame.eyes, began_ns, budget.share)
        finally:
            session.end_frame()
        if frame.eyes is not None:
            cost_ns = self._clock.now_ns() - began_ns
            budget.spent(cost_ns, frame.period_ns)
            status["frames"] += 1
            status["share"] = budget.share
            status["draw_ms"] += (cost_ns / 1e6 - status["draw_ms"]) * 0.1

    def _post_head(self, session: Session) -> None:
        now_ns = self._clock.now_ns()
        if now_ns < self._pose_ns:
            return
        self._pose_ns = max(self._pose_ns + POSE_NS, now_ns)
        head = session.head()
        if head is None:
            return
        self._memory.poses.post(
            t_ns=head.t_ns,
            position=head.position,
            xyzw=head.xyzw,
            tracked=head.tracked,
            gaze=head.gaze or (NAN, NAN, NAN),
            face=head.face or NAN,
        )
        self._memory.status["poses"] += 1

    def _tell(self, problem: str) -> None:
        self._memory.status["problem"] = problem.encode()[:200]
        self._memory.status["ready"] = True
