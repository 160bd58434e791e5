"""OpenXrSession: one session of a real runtime, with a swapchain an eye."""

import contextlib
import ctypes
from math import tan
from typing import TYPE_CHECKING, Any

from app.xr.runtimes import graphics
from app.xr.runtimes.calls import library, told
from app.xr.runtimes.face import Face
from app.xr.runtimes.gaze import Gaze
from app.xr.runtimes.protocol import (
    Eye,
    Frame,
    HeadReading,
    SessionEndedError,
    SessionLostError,
)
from app.xr.runtimes.times import XrNow
from sensors.types import NS

if TYPE_CHECKING:
    import moderngl

    from render.gl.contexts import GLContext


class OpenXrSession:
    """Owns the instance, too: after a loss nothing of it is of use."""

    def __init__(
        self,
        instance: Any,
        system: Any,
        context: "GLContext | None",  # None: poses alone
        binding: Any,  # of that context
        now: XrNow,
        gaze: Gaze | None,
        face: Face | None,
    ) -> None:
        xr = self._xr = library()
        self.context, self._now, self._instance = context, now, instance
        self._gaze, self._face = gaze, face
        self.name, self.size = xr.get_instance_properties(instance).runtime_name.decode(), (0, 0)
        self.state, self.recentred = "idle", 0
        following = ctypes.cast(ctypes.pointer(binding), ctypes.c_void_p) if binding else None
        self._binding = binding  # lives as long as the session
        self._session = xr.create_session(
            instance, xr.SessionCreateInfo(system_id=system, next=following)
        )
        self._stereo = xr.ViewConfigurationType.PRIMARY_STEREO
        self._local, self._view = (
            xr.create_reference_space(self._session, xr.ReferenceSpaceCreateInfo(kind, xr.Posef()))
            for kind in (xr.ReferenceSpaceType.LOCAL, xr.ReferenceSpaceType.VIEW)
        )
        if gaze is not None:
            gaze.attach(self._session)
        if face is not None:
            face.attach(self._session)
        self._chains: list[Any] = []
        self._targets: list[list[moderngl.Framebuffer]] = []
        if context is not None:
            self._make_chains(context, system)
        self._running = False
        self._frame: Any = None  # what wait_frame gave
        self._views: Any = None
        self._drawn: list[int] = []  # eyes whose picture is being drawn

    def showing(self) -> bool:
        with told():
            while (event := self._next_event()) is not None:
                self._take(event)
        return self._running and self.context is not None

    def wait_frame(self) -> Frame:
        xr = self._xr
        with told():
            self._frame = xr.wait_frame(self._session, xr.FrameWaitInfo())
            with contextlib.suppress(xr.exception.FrameDiscarded):
                xr.begin_frame(self._session, xr.FrameBeginInfo())
            period_ns = int(self._frame.predicted_display_period)
            self._now.frame_time, self._views, self._drawn = (
                int(self._frame.predicted_display_time),
                None,
                [],
            )
            if not self._frame.should_render:
                return Frame(None, period_ns)
            state, views = xr.locate_views(
                self._session,
                xr.ViewLocateInfo(self._stereo, self._frame.predicted_display_time, self._local),
            )
            flags = xr.ViewStateFlags
            if not _has(state.view_state_flags, flags.ORIENTATION_VALID_BIT):
                return Frame(None, period_ns)
            self._views = views
            return Frame((_eye(views[0]), _eye(views[1])), period_ns)

    def target(self, eye: int) -> "moderngl.Framebuffer":
        xr, chain = self._xr, self._chains[eye]
        with told():
            index: int = xr.acquire_swapchain_image(chain, xr.SwapchainImageAcquireInfo())
            self._drawn.append(eye)
            xr.wait_swapchain_image(chain, xr.SwapchainImageWaitInfo(timeout=NS))
        assert self.context is not None
        self.context.activate()  # the runtime may have left another one current
        return self._targets[eye][index]

    def end_frame(self) -> None:
        xr = self._xr
        with told():
            if self.context is not None and self._drawn:
                self.context.gl.finish()  # the runtime may read from another context
            for eye in self._drawn:
                xr.release_swapchain_image(self._chains[eye], xr.SwapchainImageReleaseInfo())
            layers = [self._layer()] if len(self._drawn) == 2 else []
            xr.end_frame(
                self._session,
                xr.FrameEndInfo(
                    self._frame.predicted_display_time,
                    xr.EnvironmentBlendMode.OPAQUE,
                    layers=[ctypes.pointer(layer) for layer in layers],
                ),
            )

    def head(self) -> HeadReading | None:
        xr = self._xr
        now_ns, xr_time = self._now()
        if not self._running or xr_time <= 0:
            return None
        with told():
            found = xr.locate_space(self._view, self._local, xr_time)
            gaze = self._gaze.direction(self._view, xr_time) if self._gaze else None
            face = self._face.weights(xr_time) if self._face else None
        flags, place, turn = xr.SpaceLocationFlags, found.pose.position, found.pose.orientation
        if not _has(found.location_flags, flags.ORIENTATION_VALID_BIT):
            return None
        tracked = _has(found.location_flags, flags.ORIENTATION_TRACKED_BIT)
        position, xyzw = (place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w)
        return HeadReading(now_ns, position, xyzw, tracked, gaze, face)

    def close(self) -> None:
        xr = self._xr
        if self.context is not None:
            graphics.release(self.context, [each for targets in self._targets for each in targets])
        with contextlib.suppress(xr.exception.XrException):
            if self._running:
                xr.request_exit_session(self._session)
        with contextlib.suppress(xr.exception.XrException):
            xr.destroy_session(self._session)
        with contextlib.suppress(xr.exception.XrException):
            xr.destroy_instance(self._instance)

    def _make_chains(self, context: "GLContext", system: Any) -> None:
        xr = self._xr
        first, *_ = xr.enumerate_view_configuration_views(self._instance, system, self._stereo)
        self.size = first.recommended_image_rect_width, first.recommended_image_rect_height
        width, height = self.size
        usage = xr.SwapchainUsageFlags.COLOR_ATTACHMENT_BIT | xr.SwapchainUsageFlags.SAMPLED_BIT
        settings = xr.SwapchainCreateInfo(
            usage_flags=usage,
            format=graphics.choose_format(list(xr.enumerate_swapchain_formats(self._session))),
            sample_count=1,
            width=width,
            height=height,
            face_count=1,
            array_size=1,
            mip_count=1,
        )
        for _ in range(2):
            chain = xr.create_swapchain(self._session, settings)
            images = xr.enumerate_swapchain_images(chain, xr.SwapchainImageOpenGLKHR)
            self._chains.append(chain)
            self._targets.append(
                [graphics.framebuffer(context, each.image, self.size) for each in images]
            )

    def _layer(self) -> Any:
        xr, (width, height) = self._xr, self.size
        whole = xr.Rect2Di(xr.Offset2Di(0, 0), xr.Extent2Di(width, height))
        views = (xr.CompositionLayerProjectionView * 2)()
        for eye, view in enumerate(self._views):
            views[eye] = xr.CompositionLayerProjectionView(
                pose=view.pose,
                fov=view.fov,
                sub_image=xr.SwapchainSubImage(self._chains[eye], whole, 0),
            )
        return xr.CompositionLayerProjection(space=self._local, views=views)

    def _next_event(self) -> Any:
        try:
            return self._xr.poll_event(self._instance)
        except self._xr.exception.EventUnavailable:
            return None

    def _take(self, event: Any) -> None:
        xr = self._xr
        kind, kinds = xr.StructureType(event.type), xr.StructureType
        if kind == kinds.EVENT_DATA_INSTANCE_LOSS_PENDING:
            raise SessionLostError("the runtime is about to go")
        if kind == kinds.EVENT_DATA_REFERENCE_SPACE_CHANGE_PENDING:
            self.recentred += 1
        if kind != kinds.EVENT_DATA_SESSION_STATE_CHANGED:
            return
        changed: Any = xr.EventDataSessionStateChanged.from_buffer_copy(event)
        state, states = xr.SessionState(changed.state), xr.SessionState
        self.state = state.name.lower()
        if state == states.READY:
            xr.begin_session(self._session, xr.SessionBeginInfo(self._stereo))
            self._running = True
        elif state == states.STOPPING:
            self._running = False
            xr.end_session(self._session)
        elif state == states.LOSS_PENDING:
            raise SessionLostError("the runtime is about to go")
        elif state == states.EXITING:
            raise SessionEndedError("the session was ended in the headset")


def _eye(view: Any) -> Eye:
    place, turn, fov = view.pose.position, view.pose.orientation, view.fov
    tangents = (tan(-fov.angle_left), tan(fov.angle_right), tan(fov.angle_up), tan(-fov.angle_down))
    return Eye((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w), tangents)


def _has(flags: Any, bit: Any) -> bool:
    return bool(int(flags) & int(bit))
