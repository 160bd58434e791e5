"""What a program with OSC sends: one bundle of messages, made with python-osc."""

from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message_builder import OscMessageBuilder


def bundle(*messages: tuple[str | float, ...]) -> bytes:
    """The datagram of messages (address, value, value, ...)."""
    made = OscBundleBuilder(IMMEDIATELY)
    for address, *values in messages:
        builder = OscMessageBuilder(str(address))
        for value in values:
            builder.add_arg(value)
        made.add_content(builder.build())
    return made.build().dgram
