"""Colours, fonts and spacing of the window: dark, quiet, one accent."""

from typing import Any, NamedTuple

from imgui_bundle import ImVec2, ImVec4, imgui

TEXT = (0.91, 0.92, 0.94, 1.0)
MUTED = (0.56, 0.59, 0.65, 1.0)
PANEL = (0.075, 0.082, 0.094, 1.0)
RAISED = (0.125, 0.137, 0.157, 1.0)
HOVERED = (0.176, 0.192, 0.220, 1.0)
LINE = (1.0, 1.0, 1.0, 0.07)
ACCENT = (0.27, 0.70, 0.93, 1.0)
GOOD = (0.30, 0.78, 0.55, 1.0)
WARN = (0.96, 0.72, 0.27, 1.0)
ALERT = (0.94, 0.33, 0.34, 1.0)
CLEAR = (0.0, 0.0, 0.0, 0.0)
# One colour a stage, in the order of app.drive.stages.STAGES (without "tick").
STAGE_COLORS = (
    (0.42, 0.47, 0.55, 1.0),
    (0.27, 0.70, 0.93, 1.0),
    (0.36, 0.84, 0.80, 1.0),
    (0.60, 0.84, 0.45, 1.0),
    (0.55, 0.50, 0.95, 1.0),
    (0.96, 0.72, 0.27, 1.0),
    (0.94, 0.47, 0.36, 1.0),
    (0.86, 0.45, 0.72, 1.0),
    (0.70, 0.74, 0.80, 1.0),
)
TITLE_PX, TEXT_PX, SMALL_PX, ICON_PX = 22.0, 15.5, 13.0, 18.0


class Fonts(NamedTuple):
    text: Any
    bold: Any  # both carry the icons of Font Awesome 6


def load_fonts() -> Fonts:
    """Roboto with icons, from the files that imgui-bundle ships."""
    from pathlib import Path

    import imgui_bundle

    folder = Path(imgui_bundle.__file__).parent / "assets" / "fonts"
    atlas, fonts = imgui.get_io().fonts, list[Any]()
    for name in ("Regular", "Bold"):
        font = atlas.add_font_from_file_ttf(str(folder / "Roboto" / f"Roboto-{name}.ttf"), TEXT_PX)
        merge = imgui.ImFontConfig()
        merge.merge_mode = True
        icons = str(folder / "Font_Awesome_6_Free-Solid-900.otf")
        atlas.add_font_from_file_ttf(icons, TEXT_PX * 0.9, merge)
        fonts.append(font)
    return Fonts(*fonts)


def set_style(scale: float) -> None:
    """Apply the look once; `scale` is the display's, 1 for 96 dpi."""
    style, colors = imgui.get_style(), imgui.Col_
    style.window_padding = ImVec2(20, 18)
    style.frame_padding = ImVec2(10, 7)
    style.item_spacing = ImVec2(8, 8)
    style.item_inner_spacing = ImVec2(8, 6)
    style.window_rounding = 0.0
    style.child_rounding = style.popup_rounding = 10.0
    style.frame_rounding = style.grab_rounding = 7.0
    style.window_border_size = style.frame_border_size = style.popup_border_size = 0.0
    style.scrollbar_size = 10.0
    style.scale_all_sizes(scale)
    style.font_scale_dpi = scale
    for where, color in {
        colors.text: TEXT,
        colors.text_disabled: MUTED,
        colors.window_bg: PANEL,
        colors.popup_bg: (0.10, 0.11, 0.125, 0.99),
        colors.frame_bg: RAISED,
        colors.frame_bg_hovered: HOVERED,
        colors.frame_bg_active: HOVERED,
        colors.button: RAISED,
        colors.button_hovered: HOVERED,
        colors.button_active: (0.22, 0.24, 0.27, 1.0),
        colors.header: RAISED,
        colors.header_hovered: HOVERED,
        colors.header_active: HOVERED,
        colors.check_mark: ACCENT,
        colors.separator: LINE,
        colors.scrollbar_bg: CLEAR,
        colors.nav_cursor: ACCENT,
    }.items():
        style.set_color_(where, ImVec4(*color))
