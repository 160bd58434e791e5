"""The headset: the driven head life-size in stereo through OpenXR, in a process of its own."""
