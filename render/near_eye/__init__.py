"""The headset's eye cameras, simulated."""
