"""Which headset camera is behind a USB vendor and product number."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Profile:
    name: str
    note: str  # note for the user
    vive_commands: bool = False  # the stream must be switched on through its extension unit


PROFILES = {
    (0x35BD, 0x0202): Profile("Bigscreen Beyond 2e eye tracker", "800 x 400, both eyes"),
    (0x0BB4, 0x0321): Profile(
        "VIVE Facial Tracker", "lower face, two half-width views of 200 x 400", vive_commands=True
    ),
}
VENDORS = {0x303A: Profile("ESP32 camera, perhaps OpenIris", "one eye")}


def profile(vendor: int, product: int) -> Profile | None:
    return PROFILES.get((vendor, product)) or VENDORS.get(vendor)


def udev_rule(vendor: int, product: int) -> str:
    """One line for /etc/udev/rules.d that lets the person at the screen use the device."""
    return (
        f'SUBSYSTEM=="usb", ATTR{{idVendor}}=="{vendor:04x}", ATTR{{idProduct}}=="{product:04x}", '
        'TAG+="uaccess", MODE="0660"'
    )
