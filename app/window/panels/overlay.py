"""Overlay on the head: its name, the run's state, the toolbar, a short message, the help."""

from imgui_bundle import ImVec2, imgui
from imgui_bundle import icons_fontawesome_6 as icons

from app.window.panels import parts, theme
from app.window.state.actions import ACTIONS, MOUSE, Action
from app.window.state.layout import Layout, Rect, toolbar_button
from app.window.state.window_state import State
from sensors.types import FPS


def title(state: State, fonts: theme.Fonts, rect: Rect) -> None:
    draw, scale = imgui.get_background_draw_list(), imgui.get_style().font_scale_dpi
    size = theme.TITLE_PX * scale
    name = state.label.capitalize()
    draw.add_text(fonts.bold, size, ImVec2(rect.x, rect.y), parts.rgba(theme.TEXT), name)
    passed = clock(state.history.frames)
    if state.info.frames:
        passed += f" of {clock(state.info.frames)}"
    below = ImVec2(rect.x, rect.y + size * 1.25)
    text = f"{state.info.title}   {passed}"
    draw.add_text(fonts.text, theme.TEXT_PX * scale, below, parts.rgba(theme.MUTED), text)


def status(state: State, fonts: theme.Fonts, rect: Rect) -> None:
    """Chips at the upper right: recording, muted."""
    chips: list[tuple[str, parts.Color]] = []
    if state.controls["recording"]:
        passed = clock(state.history.frames - state.recording_from)
        chips.append((f"{icons.ICON_FA_CIRCLE}  {passed}", theme.ALERT))
    if state.controls["muted"]:
        chips.append((f"{icons.ICON_FA_MICROPHONE_SLASH}  muted", theme.WARN))
    draw, scale, right = imgui.get_background_draw_list(), _scale(), rect.right
    for text, color in chips:
        width = float(imgui.calc_text_size(text).x) + 24 * scale
        height = 30 * scale
        corner, end = ImVec2(right - width, rect.y), ImVec2(right, rect.y + height)
        draw.add_rect_filled(corner, end, parts.rgba(theme.PANEL, 0.85), height / 2)
        at = ImVec2(corner.x + 12 * scale, rect.y + (height - theme.TEXT_PX * scale) / 2 - scale)
        draw.add_text(fonts.text, theme.TEXT_PX * scale, at, parts.rgba(color), text)
        right -= width + 8 * scale


def call(lines: list[str], fonts: theme.Fonts, below: Rect) -> None:
    """Under the title: who is in the call, and how well it goes."""
    draw, size = imgui.get_background_draw_list(), theme.TEXT_PX * _scale()
    for row, line in enumerate(lines):
        at = ImVec2(below.x, below.y + (3.2 + 1.4 * row) * size)
        color = theme.ALERT if line.startswith("RECORDING") or "records" in line else theme.TEXT
        draw.add_text(fonts.text, size, at, parts.rgba(color), line)


def toolbar(
    state: State, fonts: theme.Fonts, layout: Layout, actions: tuple[Action, ...]
) -> list[str]:
    """Draw the buttons; return the names of those that were clicked."""
    clicked: list[str] = []
    scale, rect = _scale(), layout.toolbar
    imgui.push_style_var(imgui.StyleVar_.window_padding, ImVec2(0, 0))
    with parts.area("toolbar", rect), parts.font(fonts.text, theme.ICON_PX):
        draw = imgui.get_window_draw_list()
        end = ImVec2(rect.right, rect.bottom)
        draw.add_rect_filled(ImVec2(rect.x, rect.y), end, parts.rgba(theme.PANEL, 0.88), 16 * scale)
        for place, action in enumerate(actions):
            if _button(state, action, toolbar_button(rect, place, scale)):
                clicked.append(action.name)
    imgui.pop_style_var()
    return clicked


def _button(state: State, action: Action, area: Rect) -> bool:
    draw, scale = imgui.get_window_draw_list(), _scale()
    imgui.set_cursor_screen_pos(ImVec2(area.x, area.y))
    hit = imgui.invisible_button(action.name, ImVec2(area.width, area.height))
    icon, color, on = action.icon, theme.TEXT, False
    if action.name == "mute" and state.controls["muted"]:
        icon, color, on = icons.ICON_FA_MICROPHONE_SLASH, theme.WARN, True
    elif action.name == "record":
        color, on = theme.ALERT, bool(state.controls["recording"])
        icon = icons.ICON_FA_STOP if on else icon
    elif action.name in ("mirror", "panels", "help"):
        on = bool(getattr(state, action.name))
        color = theme.ACCENT if on else theme.TEXT
    if on or imgui.is_item_hovered():
        shade = theme.HOVERED if imgui.is_item_hovered() else theme.RAISED
        end = ImVec2(area.right, area.bottom)
        draw.add_rect_filled(ImVec2(area.x, area.y), end, parts.rgba(shade), 10 * scale)
    size = imgui.calc_text_size(icon)
    at = ImVec2(area.x + (area.width - size.x) / 2, area.y + (area.height - size.y) / 2)
    draw.add_text(at, parts.rgba(color), icon)
    if imgui.is_item_hovered():
        imgui.push_style_var(imgui.StyleVar_.window_padding, ImVec2(12 * scale, 8 * scale))
        above = ImVec2(area.x + area.width / 2, area.y - 14 * scale)
        imgui.set_next_window_pos(above, imgui.Cond_.always, ImVec2(0.5, 1.0))
        with parts.font(None, theme.TEXT_PX):
            imgui.set_tooltip(f"{action.label}  ({action.key_name})")
        imgui.pop_style_var()
    return bool(hit)


def toast(state: State, fonts: theme.Fonts, rect: Rect) -> None:
    if state.toast_left_s <= 0:
        return
    state.toast_left_s -= imgui.get_io().delta_time
    alpha = min(1.0, state.toast_left_s / 0.4)
    draw, scale = imgui.get_background_draw_list(), _scale()
    size = theme.TEXT_PX * scale
    width = min(float(imgui.calc_text_size(state.toast).x) + 36 * scale, rect.width)
    x = rect.x + (rect.width - width) / 2
    end = ImVec2(x + width, rect.bottom)
    draw.add_rect_filled(
        ImVec2(x, rect.y), end, parts.rgba(theme.PANEL, 0.9 * alpha), rect.height / 2
    )
    at = ImVec2(x + 18 * scale, rect.y + (rect.height - size) / 2 - scale)
    draw.push_clip_rect(ImVec2(x, rect.y), ImVec2(end.x - 18 * scale, end.y))
    draw.add_text(fonts.text, size, at, parts.rgba(theme.TEXT, alpha), state.toast)
    draw.pop_clip_rect()


def help_page(state: State, fonts: theme.Fonts, view: Rect) -> None:
    """Keys and mouse, in the middle of the view."""
    scale, flags = _scale(), imgui.WindowFlags_
    middle = ImVec2(view.x + view.width / 2, view.y + view.height / 2)
    imgui.set_next_window_pos(middle, imgui.Cond_.always, ImVec2(0.5, 0.5))
    imgui.set_next_window_bg_alpha(0.96)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, 14 * scale)
    imgui.push_style_var(imgui.StyleVar_.window_padding, ImVec2(30 * scale, 26 * scale))
    kind = flags.no_decoration | flags.no_move | flags.no_saved_settings | flags.no_nav
    imgui.begin("help", None, kind | flags.always_auto_resize)
    with parts.font(fonts.bold, theme.TITLE_PX):
        imgui.text("Help")
    actions = [a for a in ACTIONS if a.name != "record" or state.info.can_record]
    keys = [(a.key_name, a.label) for a in actions]
    imgui.begin_group()
    _rows("Keys", keys, 96 * scale, fonts)
    imgui.end_group()
    imgui.same_line(0, 48 * scale)
    imgui.begin_group()
    _rows("Mouse", list(MOUSE), 112 * scale, fonts)
    imgui.end_group()
    imgui.end()
    imgui.pop_style_var(2)


def _rows(heading: str, rows: list[tuple[str, str]], indent: float, fonts: theme.Fonts) -> None:
    """Key caps with what they do, `indent` px further right."""
    scale, draw = _scale(), imgui.get_window_draw_list()
    parts.heading(heading, fonts)
    for name, text in rows:
        corner, height = imgui.get_cursor_screen_pos(), 26 * scale
        with parts.font(fonts.text, theme.SMALL_PX):
            size = imgui.calc_text_size(name)
            width = max(float(size.x) + 16 * scale, height)
            end = ImVec2(corner.x + width, corner.y + height)
            draw.add_rect_filled(corner, end, parts.rgba(theme.RAISED), 6 * scale)
            at = ImVec2(corner.x + (width - size.x) / 2, corner.y + (height - size.y) / 2)
            draw.add_text(at, parts.rgba(theme.TEXT), name)
        size = imgui.calc_text_size(text)
        at = ImVec2(corner.x + indent, corner.y + (height - size.y) / 2)
        draw.add_text(at, parts.rgba(theme.TEXT), text)
        imgui.dummy(ImVec2(indent + size.x, height))


def clock(frames: int) -> str:
    """mm:ss of a number of frames."""
    minutes, seconds = divmod(max(frames, 0) // FPS, 60)
    return f"{minutes:02d}:{seconds:02d}"


def _scale() -> float:
    return float(imgui.get_style().font_scale_dpi)
