"""What a tick costs: the last ten seconds stage by stage, and what was dropped."""

import numpy as np
from imgui_bundle import ImVec2, ImVec4, imgui, implot

from app.drive.stages import STAGES
from app.window.panels import parts, theme
from app.window.state.history import KEPT
from app.window.state.window_state import State
from sensors.types import FPS

BUDGET_MS = 1000 / FPS
CEILING_MS = 42.0  # of the graph; longer ticks reach its top
SHOWN = [k for k, name in enumerate(STAGES) if name != "tick"]


def draw(state: State, fonts: theme.Fonts) -> None:
    history = state.history
    parts.heading("Tick", fonts, f"{history.tick_ms(50):.1f} ms, p99 {history.tick_ms(99):.1f} ms")
    _graph(state, fonts)
    means = history.stage_ms[-FPS:].mean(0)
    shown = [k for k in SHOWN if means[k] >= 0.05] or SHOWN[:1]
    with parts.font(fonts.text, theme.SMALL_PX):
        half = imgui.get_content_region_avail().x / 2
        paint, scale = imgui.get_window_draw_list(), imgui.get_style().font_scale_dpi
        left = imgui.get_cursor_pos_x()
        for place, k in enumerate(shown):
            if place % 2:
                imgui.same_line()
            imgui.set_cursor_pos_x(left + half * (place % 2))
            corner = imgui.get_cursor_screen_pos()
            middle = corner.y + imgui.get_text_line_height() / 2
            paint.add_circle_filled(
                ImVec2(corner.x + 4 * scale, middle), 4 * scale, parts.rgba(theme.STAGE_COLORS[k])
            )
            imgui.set_cursor_pos_x(imgui.get_cursor_pos_x() + 16 * scale)
            imgui.text(STAGES[k])
            value = f"{means[k]:.1f}"
            imgui.same_line(left + half * (place % 2 + 1) - 18 * scale - _width(value))
            parts.muted(value)
        _counters(state)


def _width(text: str) -> float:
    return float(imgui.calc_text_size(text).x)


def _counters(state: State) -> None:
    history = state.history
    for label, value in (("dropped", history.dropped), ("sound gaps", history.audio_gaps)):
        color = theme.WARN if value else theme.MUTED
        imgui.text_colored(ImVec4(*color), f"{value} {label}")
        imgui.same_line(0, 18 * imgui.get_style().font_scale_dpi)
    text = f"{state.history.frames} ticks"
    parts.right_align(text)
    parts.muted(text)


def _graph(state: State, fonts: theme.Fonts) -> None:
    scale = imgui.get_style().font_scale_dpi
    history, axes = state.history, implot.AxisFlags_
    tops = np.cumsum(history.stage_ms[:, SHOWN], axis=1)
    seconds = (np.arange(KEPT) - (KEPT - 1)) / FPS
    implot.push_style_color(implot.Col_.frame_bg, ImVec4(*theme.RAISED))
    implot.push_style_color(implot.Col_.plot_bg, ImVec4(*theme.CLEAR))
    implot.push_style_color(implot.Col_.plot_border, ImVec4(*theme.CLEAR))
    implot.push_style_color(implot.Col_.axis_grid, ImVec4(1, 1, 1, 0.08))
    implot.push_style_color(implot.Col_.axis_text, ImVec4(*theme.MUTED))
    implot.push_style_var(implot.StyleVar_.plot_padding, ImVec2(8 * scale, 8 * scale))
    with parts.font(fonts.text, theme.SMALL_PX - 1):
        flags = implot.Flags_.canvas_only | implot.Flags_.no_inputs
        if implot.begin_plot("##tick", ImVec2(-1, 140 * scale), flags):
            quiet = axes.no_tick_marks | axes.no_menus | axes.no_highlight
            implot.setup_axes("", "", quiet | axes.no_tick_labels | axes.no_grid_lines, quiet)
            implot.setup_axes_limits(float(seconds[0]), 0.0, 0.0, CEILING_MS, implot.Cond_.always)
            names = ["0", "10", "20", f"{BUDGET_MS:.0f} ms"]
            implot.setup_axis_ticks(implot.ImAxis_.y1, [0.0, 10.0, 20.0, BUDGET_MS], names)
            below = np.zeros(KEPT)
            for place, k in enumerate(SHOWN):
                top = np.ascontiguousarray(tops[:, place])
                spec = implot.Spec()
                spec.fill_color = ImVec4(*theme.STAGE_COLORS[k])
                spec.fill_alpha = 0.9
                implot.plot_shaded(f"##{k}", seconds, below, top, spec)
                below = top
            line = implot.Spec()
            line.line_color, line.line_weight = ImVec4(*theme.ALERT), 1.2 * scale
            ends = np.array([seconds[0], 0.0])
            implot.plot_line("##budget", ends, np.full(2, BUDGET_MS), line)
            implot.end_plot()
    implot.pop_style_var()
    implot.pop_style_color(5)
