"""An address as a QR code on the terminal: nobody types a token in a headset or on a phone."""

import sys


def show(address: str) -> None:
    """Print it, where the output is a terminal and segno is installed; else nothing."""
    if not sys.stdout.isatty():
        return
    try:
        import segno
    except ImportError:
        return
    segno.make(address, error="l", micro=False).terminal(compact=True)
