"""The microphone, and unbroken sound at 48 kHz."""
