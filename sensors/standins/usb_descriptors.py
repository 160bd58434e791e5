"""Descriptors of the stand-in USB camera: one MJPEG format of one size, an extension unit."""

import struct

from sensors.cameras.usb.extension import UNIT

ENDPOINT, CLOCK_HZ = 0x81, 1_000_000
# pyusb's names of the fields of each descriptor, in the order of the bytes.
DEVICE_FIELDS = (
    "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 "
    "idVendor idProduct bcdDevice iManufacturer iProduct iSerialNumber bNumConfigurations"
)
CONFIGURATION_FIELDS = (
    "bLength bDescriptorType wTotalLength bNumInterfaces bConfigurationValue iConfiguration "
    "bmAttributes bMaxPower"
)
INTERFACE_FIELDS = (
    "bLength bDescriptorType bInterfaceNumber bAlternateSetting bNumEndpoints bInterfaceClass "
    "bInterfaceSubClass bInterfaceProtocol iInterface"
)
ENDPOINT_FIELDS = "bLength bDescriptorType bEndpointAddress bmAttributes wMaxPacketSize bInterval"


def configuration_descriptor(width: int, height: int, rate_hz: float) -> bytes:
    """One MJPEG format of one size on a bulk endpoint, and an extension unit."""
    interval = int(1e7 / rate_hz)
    control = bytes([9, 4, 0, 0, 0, 0x0E, 1, 0, 0])
    control += struct.pack("<BBBHHIBB", 13, 0x24, 1, 0x0110, 40, CLOCK_HZ, 1, 1)
    control += bytes([27, 0x24, 6, UNIT]) + bytes(16) + bytes([1, 1, 1, 1, 0x02, 0, 0])
    video = bytes([9, 4, 1, 0, 1, 0x0E, 2, 0, 0])
    video += bytes([14, 0x24, 1, 1, 55, 0, ENDPOINT, 0, 2, 0, 0, 0, 1, 0])
    video += bytes([11, 0x24, 6, 1, 1, 1, 1, 0, 0, 0, 0])
    video += struct.pack(
        "<BBBBBHHIIIIBI", 30, 0x24, 7, 1, 0, width, height, 0, 0, 0, interval, 1, interval
    )
    video += struct.pack("<BBBBHB", 7, 5, ENDPOINT, 2, 512, 0)
    total = 9 + len(control) + len(video)
    return struct.pack("<BBHBBBBB", 9, 2, total, 2, 1, 0, 0x80, 250) + control + video
