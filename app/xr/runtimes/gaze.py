"""Gaze: where both eyes look, where the headset tracks them (XR_EXT_eye_gaze_interaction)."""

from typing import Any

from app.xr.runtimes.calls import library
from sensors.rotation import Vector, rotate

GAZE = "XR_EXT_eye_gaze_interaction"
PROFILE = "/interaction_profiles/ext/eye_gaze_interaction"
POSE = "/user/eyes_ext/input/gaze_ext/pose"


class Gaze:
    """An action of OpenXR; `attach` it to a session once, then ask for `direction`."""

    def __init__(self, instance: Any) -> None:
        xr = library()
        self._set = xr.create_action_set(
            instance, xr.ActionSetCreateInfo("livedrive", "livedrive", 0)
        )
        self._action = xr.create_action(
            self._set,
            xr.ActionCreateInfo(
                action_name="gaze",
                action_type=xr.ActionType.POSE_INPUT,
                localized_action_name="Gaze",
            ),
        )
        path = xr.string_to_path(instance, POSE)
        xr.suggest_interaction_profile_bindings(
            instance,
            xr.InteractionProfileSuggestedBinding(
                interaction_profile=xr.string_to_path(instance, PROFILE),
                suggested_bindings=[xr.ActionSuggestedBinding(self._action, path)],
            ),
        )
        self._session: Any = None
        self._space: Any = None

    def attach(self, session: Any) -> None:
        xr = library()
        xr.attach_session_action_sets(
            session, xr.SessionActionSetsAttachInfo(action_sets=[self._set])
        )
        self._session = session
        self._space = xr.create_action_space(session, xr.ActionSpaceCreateInfo(action=self._action))

    def direction(self, head: Any, xr_time: int) -> Vector | None:
        """Unit, in the axes of `head`, the VIEW space; None while it is not tracked."""
        xr = library()
        try:
            xr.sync_actions(
                self._session,
                xr.ActionsSyncInfo(active_action_sets=[xr.ActiveActionSet(self._set, 0)]),
            )
        except xr.exception.SessionNotFocused:
            return None
        found = xr.locate_space(self._space, head, xr_time)
        tracked = xr.SpaceLocationFlags.ORIENTATION_VALID_BIT
        tracked |= xr.SpaceLocationFlags.ORIENTATION_TRACKED_BIT
        if int(found.location_flags) & int(tracked) != int(tracked):
            return None
        turn = found.pose.orientation
        return rotate((turn.w, turn.x, turn.y, turn.z), (0.0, 0.0, -1.0))
