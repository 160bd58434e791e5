"""Avatars as files and pictures: what `livedrive avatar` does."""
