"""Small pieces of the panels: headings, switches, meters; drawn with Dear ImGui."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Any

from imgui_bundle import ImVec2, ImVec4, imgui

from app.window.panels import theme
from app.window.state.layout import Rect

Color = tuple[float, float, float, float]


def rgba(color: Color, alpha: float = 1.0) -> int:
    """A colour as draw lists want it."""
    return imgui.get_color_u32(ImVec4(*color[:3], color[3] * alpha))


@contextmanager
def area(name: str, rect: Rect, background: bool = False) -> Generator[None]:
    """A fixed piece of the window to draw in."""
    flags = imgui.WindowFlags_
    kind = flags.no_decoration | flags.no_move | flags.no_saved_settings | flags.no_nav
    kind |= flags.no_bring_to_front_on_focus
    if not background:
        kind |= flags.no_background
    imgui.set_next_window_pos(ImVec2(rect.x, rect.y))
    imgui.set_next_window_size(ImVec2(rect.width, rect.height))
    imgui.begin(name, None, kind)
    try:
        yield
    finally:
        imgui.end()


@contextmanager
def font(face: Any, size: float) -> Generator[None]:
    imgui.push_font(face, size)
    try:
        yield
    finally:
        imgui.pop_font()


def muted(text: str) -> None:
    imgui.text_colored(ImVec4(*theme.MUTED), text)


def heading(text: str, fonts: theme.Fonts, note: str = "", first: bool = False) -> None:
    """A section's title, with a note at the right edge."""
    if not first:
        imgui.dummy(ImVec2(0, 7 * imgui.get_style().font_scale_dpi))
    with font(fonts.bold, theme.SMALL_PX):
        muted(text.upper())
    if note:
        with font(fonts.text, theme.SMALL_PX):
            imgui.same_line()
            right_align(note)
            muted(note)


def right_align(text: str) -> None:
    """Put the cursor where `text` ends at the right edge."""
    left = imgui.get_content_region_avail().x - imgui.calc_text_size(text).x
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + max(left, 0))


def pick(label: str, chosen: str, names: Sequence[str], width: float) -> str:
    """A list to choose from; returns the name that is chosen."""
    imgui.set_next_item_width(width)
    if imgui.begin_combo(f"##{label}", chosen.capitalize()):
        for name in names:
            clicked, _ = imgui.selectable(name.capitalize(), name == chosen)
            if clicked:
                chosen = name
        imgui.end_combo()
    return chosen


def slider(label: str, value: float) -> float:
    """A slider over the full width, 0..1, with a percentage."""
    imgui.set_next_item_width(imgui.get_content_region_avail().x)
    moved, percent = imgui.slider_float(f"##{label}", 100 * value, 0, 100, f"{label} %.0f%%")
    return min(max(percent / 100, 0.0), 1.0) if moved else value


def switch(label: str, on: bool) -> bool:
    """A label with a switch at the right edge; returns its state after this picture."""
    scale = imgui.get_style().font_scale_dpi
    width, height = 34 * scale, 19 * scale
    imgui.align_text_to_frame_padding()
    imgui.text(label)
    imgui.same_line()
    left = imgui.get_content_region_avail().x - width
    imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + left)
    imgui.push_id(label)
    corner = imgui.get_cursor_screen_pos()
    top = corner.y + (imgui.get_frame_height() - height) / 2
    if imgui.invisible_button("switch", ImVec2(width, imgui.get_frame_height())):
        on = not on
    hovered = imgui.is_item_hovered()
    imgui.pop_id()
    draw = imgui.get_window_draw_list()
    track = theme.ACCENT if on else (theme.HOVERED if hovered else theme.RAISED)
    radius = height / 2
    draw.add_rect_filled(
        ImVec2(corner.x, top), ImVec2(corner.x + width, top + height), rgba(track), radius
    )
    knob = corner.x + (width - radius if on else radius)
    color = theme.TEXT if on else theme.MUTED
    draw.add_circle_filled(ImVec2(knob, top + radius), radius - 3 * scale, rgba(color), 24)
    return on


def meter(level: float, peak: float, dead: bool) -> None:
    """A level bar, 0..1, with the peak as a tick; grey when nothing counts."""
    scale = imgui.get_style().font_scale_dpi
    corner, width = imgui.get_cursor_screen_pos(), imgui.get_content_region_avail().x
    height, draw = 10 * scale, imgui.get_window_draw_list()
    end = ImVec2(corner.x + width, corner.y + height)
    draw.add_rect_filled(corner, end, rgba(theme.RAISED), height / 2)
    if dead:
        imgui.dummy(ImVec2(width, height))
        return
    # Green up to -18 dB, amber to -6 dB, red above: each part clipped to what is lit.
    for start, stop, color in (
        (0.0, 0.7, theme.GOOD),
        (0.7, 0.9, theme.WARN),
        (0.9, 1.0, theme.ALERT),
    ):
        lit = min(level, stop)
        if lit > start:
            draw.push_clip_rect(
                ImVec2(corner.x + start * width, corner.y),
                ImVec2(corner.x + lit * width, end.y),
                True,
            )
            draw.add_rect_filled(corner, end, rgba(color), height / 2)
            draw.pop_clip_rect()
    if peak > 0.01:
        x = corner.x + min(peak, 1.0) * (width - 3 * scale)
        draw.add_rect_filled(
            ImVec2(x, corner.y), ImVec2(x + 2.5 * scale, end.y), rgba(theme.TEXT, 0.8)
        )
    imgui.dummy(ImVec2(width, height))
