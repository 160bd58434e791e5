"""The sidebar: who is driven, what is heard and seen, what a tick costs, how it is shown."""

from typing import Any

import numpy as np
from imgui_bundle import ImVec2, ImVec2Like, imgui
from imgui_bundle import icons_fontawesome_6 as icons
from numpy.typing import NDArray

from app.drive.background import FILLS
from app.window.panels import parts, theme, timing
from app.window.panels.eyes import Marks, frame_corners
from app.window.state.history import SILENCE_DB
from app.window.state.layout import Rect
from app.window.state.window_state import State
from sensors.types import EYE_NAMES

AUTOMATIC = "as heard"  # no emotion is chosen
EYE_MARK, EYE_RAY = theme.GOOD, theme.ACCENT
EYE_DRAWING_MM, IRIS_MM, PUPIL_MM = 17.0, 5.6, 2.4  # height of the strip; radii


def draw(
    state: State,
    fonts: theme.Fonts,
    rect: Rect,
    eye_textures: list[Any],  # imgui texture references, left eye first
    marks: list[Marks] | None,  # left eye first
) -> None:
    with parts.area("sidebar", rect, background=True):
        _who(state, fonts)
        _sound(state, fonts)
        _eyes(state, fonts, eye_textures, marks)
        timing.draw(state, fonts)
        _view(state, fonts)


def _who(state: State, fonts: theme.Fonts) -> None:
    info, controls = state.info, state.controls
    full = imgui.get_content_region_avail().x
    gap = imgui.get_style().item_spacing.x
    width = (full - gap) / 2 if info.emotions else full
    left = imgui.get_cursor_pos_x()
    parts.heading("Avatar", fonts, first=True)
    if info.emotions:
        imgui.same_line(left + width + gap)
        parts.heading("Emotion", fonts, first=True)
    # Only what a person has changed is written: others write the controls, too.
    label = state.label
    if (chosen := parts.pick("avatar", label, state.labels, width)) != label:
        controls["avatar"] = state.labels.index(chosen)
    if info.emotions:
        imgui.same_line()
        names = (AUTOMATIC, *state.emotions)
        emotion = names[int(controls["emotion"]) + 1]
        if (chosen := parts.pick("emotion", emotion, names, width)) != emotion:
            controls["emotion"] = names.index(chosen) - 1
        if 0 <= controls["emotion"] < len(info.emotions):
            before = float(controls["intensity"])
            if (intensity := parts.slider("intensity", before)) != before:
                controls["intensity"] = intensity


def _sound(state: State, fonts: theme.Fonts) -> None:
    history, is_muted = state.history, bool(state.controls["muted"])
    silent = history.level_db <= SILENCE_DB
    note = "muted" if is_muted else "silence" if silent else f"{history.level_db:.0f} dB"
    parts.heading("Microphone" if state.info.live else "Sound", fonts, note)
    level, peak = (1.0 - x / SILENCE_DB for x in (history.level_db, history.peak_db))
    parts.meter(level, peak, is_muted)


def _eyes(state: State, fonts: theme.Fonts, textures: list[Any], marks: list[Marks] | None) -> None:
    history = state.history
    parts.heading("Eyes", fonts, "" if history.has_eyes else "no eye cameras: synthesised gaze")
    gap = imgui.get_style().item_spacing.x
    side = (imgui.get_content_region_avail().x - gap) / 2
    # As the head faces us its left eye is on our right, unless the view is mirrored.
    order = (0, 1) if state.mirror else (1, 0)
    for place, eye in enumerate(order):
        if place:
            imgui.same_line()
        imgui.begin_group()
        mark = marks[eye] if marks else None
        _eye_picture(state, eye, side, textures[eye], mark)
        with parts.font(fonts.text, theme.SMALL_PX):
            imgui.text(EYE_NAMES[eye].capitalize())
            text = f"lid {mark.opening:.0%}" if mark else ""
            imgui.same_line(side - imgui.calc_text_size(text).x)
            parts.muted(text)
            if mark:
                parts.muted(f"{mark.yaw_deg:+.0f}\u00b0 yaw   {mark.pitch_deg:+.0f}\u00b0 pitch")
        imgui.end_group()


def _eye_picture(state: State, eye: int, side: float, texture: Any, mark: Marks | None) -> None:
    corner, paint = imgui.get_cursor_screen_pos(), imgui.get_window_draw_list()
    scale = imgui.get_style().font_scale_dpi
    end = ImVec2(corner.x + side, corner.y + side)
    radius = 8 * scale
    paint.add_rect_filled(corner, end, parts.rgba(theme.RAISED), radius)
    seen, valid = state.history.eyes_age_ms[eye] >= 0, bool(state.history.eyes_valid[eye])
    if seen:
        left, right = (1.0, 0.0) if state.mirror else (0.0, 1.0)
        tint = parts.rgba((1.0, 1.0, 1.0, 1.0 if valid else 0.35))
        paint.add_image_rounded(
            texture, corner, end, ImVec2(left, 0), ImVec2(right, 1), tint, radius
        )
        _eye_frame(state.history.eye_frames[eye], state.mirror, corner, side)
    if mark is not None:
        _eye_drawing(mark, state.mirror, corner, side)
    if seen and not valid:
        text = f"{state.history.eyes_age_ms[eye]:.0f} ms old"
        paint.add_text(ImVec2(corner.x + 10, corner.y + 8), parts.rgba(theme.WARN), text)
    imgui.dummy(ImVec2(side, side))


def _eye_frame(frame: NDArray[np.float32], mirror: bool, corner: ImVec2, side: float) -> None:
    """The part of the picture that the eye encoder looks at; green while it sees an eye."""
    if frame[2] <= 0:
        return
    paint, scale = imgui.get_window_draw_list(), imgui.get_style().font_scale_dpi
    lines: list[ImVec2Like] = [
        ImVec2(corner.x + side * (1 - x if mirror else x), corner.y + side * y)
        for x, y in frame_corners(frame).tolist()
    ]
    color = theme.GOOD if frame[4] >= 0.5 else theme.WARN
    paint.push_clip_rect(corner, ImVec2(corner.x + side, corner.y + side), True)
    paint.add_polyline(lines, parts.rgba(color, 0.8), 1.2 * scale, imgui.ImDrawFlags_.closed)
    paint.pop_clip_rect()


def _eye_drawing(mark: Marks, mirror: bool, corner: ImVec2, side: float) -> None:
    """The head's own eye, in a strip at the foot of the picture."""
    paint, scale = imgui.get_window_draw_list(), imgui.get_style().font_scale_dpi
    height = 0.32 * side
    top, end = corner.y + side - height, ImVec2(corner.x + side, corner.y + side)
    foot = imgui.ImDrawFlags_.round_bottom
    strip = ImVec2(corner.x, top)
    paint.add_rect_filled(strip, end, parts.rgba(theme.PANEL, 0.72), 8 * scale, foot)
    per_mm = height / EYE_DRAWING_MM
    middle = ImVec2(corner.x + side / 2, top + height / 2)

    def place(mm: NDArray[np.float64]) -> ImVec2:
        x = -mm[0] if mirror else mm[0]
        return ImVec2(middle.x + x * per_mm, middle.y + mm[1] * per_mm)

    lids: list[ImVec2Like] = [place(mm) for mm in mark.lids]
    paint.add_concave_poly_filled(lids, parts.rgba(theme.TEXT, 0.10))
    upper, lower = place(mark.lids.min(0)).y, place(mark.lids.max(0)).y
    paint.push_clip_rect(ImVec2(corner.x, upper), ImVec2(end.x, lower), True)
    pupil = place(mark.pupil)
    paint.add_circle_filled(pupil, IRIS_MM * per_mm, parts.rgba(EYE_RAY, 0.45), 32)
    paint.add_circle_filled(pupil, PUPIL_MM * per_mm, parts.rgba(EYE_RAY), 24)
    paint.pop_clip_rect()
    paint.add_polyline(lids, parts.rgba(EYE_MARK, 0.95), 1.6 * scale, imgui.ImDrawFlags_.closed)


def _view(state: State, fonts: theme.Fonts) -> None:
    parts.heading("View", fonts, f"{state.hz:.0f} Hz, head in {state.draw_ms:.0f} ms")
    scale = imgui.get_style().font_scale_dpi
    paint = imgui.get_window_draw_list()
    names = (*FILLS, "custom")
    gap = imgui.get_style().item_spacing.x
    width = (imgui.get_content_region_avail().x - gap * (len(names) - 1)) / len(names)
    for place, name in enumerate(names):
        if place:
            imgui.same_line()
        corner, size = imgui.get_cursor_screen_pos(), ImVec2(width, 26 * scale)
        if imgui.invisible_button(name, size):
            state.background = name
            if name == "custom":
                imgui.open_popup("colour")
        imgui.set_item_tooltip(name.capitalize())
        end = ImVec2(corner.x + size.x, corner.y + size.y)
        _swatch(state, name, corner, end)
        if state.background == name:
            paint.add_rect(corner, end, parts.rgba(theme.ACCENT), 6 * scale, 2 * scale)
    if imgui.begin_popup("colour"):
        _, color = imgui.color_picker3("##colour", list(state.custom))
        state.custom = (color[0], color[1], color[2])
        imgui.end_popup()
    state.mirror = parts.switch("Mirror", state.mirror)
    state.motion.smooth = parts.switch("Smooth motion", state.motion.smooth)


def _swatch(state: State, name: str, corner: ImVec2, end: ImVec2) -> None:
    paint, scale = imgui.get_window_draw_list(), imgui.get_style().font_scale_dpi
    color = FILLS.get(name, (*state.custom, 1.0))
    radius, middle = 6 * scale, ImVec2((corner.x + end.x) / 2, (corner.y + end.y) / 2)
    if name == "transparent":
        paint.add_rect_filled(corner, end, parts.rgba((0.45, 0.45, 0.45, 1.0)), radius)
        light = parts.rgba((0.7, 0.7, 0.7, 1.0))
        paint.add_rect_filled(corner, middle, light, radius, imgui.ImDrawFlags_.round_top_left)
        corners = imgui.ImDrawFlags_.round_bottom_right
        paint.add_rect_filled(middle, end, light, radius, corners)
    elif color == "studio":
        paint.add_rect_filled(corner, end, parts.rgba((0.14, 0.15, 0.17, 1.0)), radius)
        paint.add_circle_filled(middle, 7 * scale, parts.rgba((0.27, 0.29, 0.32, 1.0)), 24)
    else:
        paint.add_rect_filled(corner, end, parts.rgba(color), radius)
    if name == "custom":
        size = imgui.calc_text_size(icons.ICON_FA_DROPLET)
        at = ImVec2(middle.x - size.x / 2, middle.y - size.y / 2)
        paint.add_text(at, parts.rgba(theme.TEXT), icons.ICON_FA_DROPLET)
