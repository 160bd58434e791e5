"""The driving loop and what it reads and writes: stages, controls, emotion, tape, background."""
