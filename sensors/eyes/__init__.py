"""Eye cameras: one protocol for USB, V4L2, HTTP, serial and recorded pictures."""
