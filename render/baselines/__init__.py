"""Renderers that `livedrive bench render` measures ours against."""
