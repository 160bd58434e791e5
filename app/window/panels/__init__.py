"""The panels of the window, drawn with Dear ImGui."""
