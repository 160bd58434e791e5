"""Devices made of software: what tests, `bench` and readers without hardware connect to.

Each speaks the real protocol to the real library (PulseAudio, HTTP, a serial line, USB requests).
"""
