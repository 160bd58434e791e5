"""What the screen tells of a call: who hears you, and how each partner's line is."""

from app.call.core.call import Call
from app.call.core.partner import Partner
from app.call.wire import agreement
from sensors.types import NS, SAMPLE_RATE


def delay_ms(call: Call, partner: Partner, now_ns: int) -> float | None:
    """From the partner's mouth to our ear, and to our eye, which are shown together; both sound
    cards come on top. None before the clocks have been compared."""
    hello = partner.hello
    if hello is None or not partner.timeline.started or not hello.origin_ns:
        return None
    clocks = agreement.clock_difference_ns(call.hello, hello, partner.hello_ns)
    if clocks is None:
        return None
    said_ns = hello.origin_ns + partner.timeline.media_at(now_ns) * NS / SAMPLE_RATE
    return (now_ns + clocks[0] - said_ns) / 1e6


def status_lines(call: Call, now_ns: int) -> list[str]:
    """Lines for window and terminal, the own state first."""
    hellos = [p.hello for p in call.partners.values() if p.hello is not None]
    heard = agreement.heard_by(call.hello, hellos)
    own = [f"heard by {heard} of {len(hellos)}" if hellos else "nobody is here yet"]
    if call.hello.muted:
        own.append("muted")
    if call.hello.eyes_muted:
        own.append("eyes muted")
    if call.may_record():
        own.append("RECORDING, everybody agreed")
    elif call.hello.records:
        own.append("asks to record")
    lines = [", ".join(own)]
    for partner in call.partners.values():
        hello = partner.hello
        if hello is None:
            continue
        parts = [hello.name]
        if not hello.accepted:
            parts.append("has not accepted yet")
        if hello.muted:
            parts.append("muted")
        if hello.records:
            parts.append("asks to record" if not call.hello.may_record else "records")
        delay = delay_ms(call, partner, now_ns)
        if delay is not None:
            parts.append(f"{delay:.0f} ms")
        counts = partner.voice.counts
        due = counts.played + counts.concealed
        if due and counts.concealed:
            parts.append(f"{100 * counts.concealed / due:.1f} % of the sound concealed")
        lines.append(", ".join(parts))
    return lines
