"""What a person can do in the window: one table for toolbar, keys and help."""

from typing import NamedTuple

from imgui_bundle import icons_fontawesome_6 as icons
from imgui_bundle import imgui

Key = imgui.Key


class Action(NamedTuple):
    name: str
    label: str
    key: imgui.Key
    key_name: str
    icon: str = ""  # has a button in the toolbar


ACTIONS = (
    Action("mute", "Mute the sound", Key.m, "M", icons.ICON_FA_MICROPHONE),
    Action("record", "Record the session", Key.r, "R", icons.ICON_FA_CIRCLE),
    Action("recentre", "Recentre the view and the gaze", Key.c, "C", icons.ICON_FA_CROSSHAIRS),
    Action("picture", "Save a picture with alpha", Key.p, "P", icons.ICON_FA_CAMERA),
    Action("mirror", "Mirror the view", Key.x, "X", icons.ICON_FA_ARROWS_LEFT_RIGHT),
    Action("full_screen", "Full screen", Key.f11, "F11", icons.ICON_FA_EXPAND),
    Action("panels", "Show or hide the panels", Key.tab, "Tab", icons.ICON_FA_TABLE_COLUMNS),
    Action("help", "Help", Key.f1, "F1", icons.ICON_FA_QUESTION),
    Action("background", "Next background", Key.b, "B"),
    Action("emotion", "Next emotion", Key.e, "E"),
    Action("less", "Less of the emotion", Key.minus, "-"),
    Action("more", "More of the emotion", Key.equal, "="),
    Action("smooth", "Smooth motion between ticks (one tick later)", Key.s, "S"),
    Action("restart", "Start the head anew, from its first state", Key.backspace, "Backspace"),
    Action("escape", "Close the help, leave full screen", Key.escape, "Esc"),
)
MOUSE = (
    ("Drag", "Turn the head"),
    ("Wheel", "Zoom"),
    ("Right drag", "Move the head"),
    ("Double click", "Recentre"),
)


def toolbar(can_record: bool) -> tuple[Action, ...]:
    """The actions with a button, in order."""
    return tuple(a for a in ACTIONS if a.icon and (a.name != "record" or can_record))


def pressed() -> list[str]:
    """Names of the actions whose key went down since the last picture."""
    io = imgui.get_io()
    if io.want_text_input or io.key_ctrl or io.key_alt:
        return []
    return [a.name for a in ACTIONS if imgui.is_key_pressed(a.key, repeat=False)]
