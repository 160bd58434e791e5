"""The commands: options only; each builds settings and passes those down."""
