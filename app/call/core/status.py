"""Status lines of a call: who hears you, and the quality of each partner's line."""

from collections.abc import Mapping

from app.call.core.call import Call
from app.call.core.partner import Partner
from app.call.wire import agreement
from app.call.wire.agreement import Hello
from sensors.types import NS, SAMPLE_RATE


def delay_ms(call: Call, partner: Partner) -> float | None:
    """From the partner's mouth to our ear, and to our eye, which are shown together; both sound
    cards come on top. As it was when something of them was last played; None before the clocks
    have been compared."""
    hello = partner.hello
    if hello is None or not partner.timeline.started or not hello.origin_ns:
        return None
    clocks = agreement.clock_difference_ns(call.hello, hello, partner.hello_ns)
    if clocks is None:
        return None
    heard_ns, media, _ = partner.timeline.anchor
    said_ns = hello.origin_ns + media * NS / SAMPLE_RATE
    return (heard_ns + clocks[0] - said_ns) / 1e6


def status_lines(call: Call, behind_ms: Mapping[str, float]) -> list[str]:
    """Lines for window and terminal, the own state first; `behind_ms`: see Seats."""
    here = call.present()
    hellos = [hello for _, hello in here]
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
    for partner, hello in here:
        parts = [hello.name, *_state_of(call, hello)]
        parts += _line(line_of(call, partner, behind_ms.get(partner.identity, 0.0)))
        lines.append(", ".join(parts))
    return lines


def told_lines(call: Call) -> list[str]:
    """What there is to know of the others where no window shows it: who has not accepted, is muted,
    records."""
    lines = ["RECORDING, everybody agreed"] if call.may_record() else []
    for _, hello in call.present():
        if parts := _state_of(call, hello):
            lines.append(", ".join([hello.name, *parts]))
    return lines


def _state_of(call: Call, hello: Hello) -> list[str]:
    records = "asks to record" if not call.hello.may_record else "records"
    known = ("has not accepted yet", not hello.accepted), ("muted", hello.muted)
    return [words for words, so in (*known, (records, hello.records)) if so]


def line_of(call: Call, partner: Partner, behind_ms: float) -> dict[str, float | None]:
    """How a partner's line is: delays in ms, shares of what was due, kb/s."""
    voice, face, counts = partner.voice.counts, partner.face, partner.counts
    due, delay = voice.played + voice.concealed, delay_ms(call, partner)
    figures = {
        "mouth_to_ear_ms": delay,
        "mouth_to_eye_ms": None if delay is None else delay + behind_ms,
        "loss": counts.loss,
        "concealed_share": voice.concealed / due if due else 0.0,
        "held_share": face.held / face.due if face.due else 0.0,
        "kbps": counts.kbps(partner.came_ns),
    }
    return {name: None if v is None else round(v, 4) for name, v in figures.items()}


def report_of(
    call: Call, behind_ms: Mapping[str, float], cpu_share: float | None = None
) -> dict[str, Mapping[str, object]]:
    """What each partner's line did, by identity; `cpu_share`: of a core, by this process."""
    everybody = (*call.left, *call.partners.values())
    report: dict[str, Mapping[str, object]] = {}
    for partner in everybody:
        hello, voice = partner.hello, partner.voice.counts
        clocks = (
            agreement.clock_difference_ns(call.hello, hello, partner.hello_ns) if hello else None
        )
        report[partner.identity] = {
            "name": partner.name,
            "round_trip_ms": round(clocks[1] / 1e6, 2) if clocks else None,
            **line_of(call, partner, behind_ms.get(partner.identity, 0.0)),
            "cpu_share": round(cpu_share / len(everybody), 4) if cpu_share is not None else None,
            "packets": partner.counts.packets,
            "refused": partner.counts.refused,
            "flooded": partner.counts.flooded,
            "recovered": voice.recovered,
            "concealed": voice.concealed,
            "jumps": voice.jumps,
        }
    return report


def _line(figures: Mapping[str, float | None]) -> list[str]:
    """The same for the screen."""
    ear, eye = figures["mouth_to_ear_ms"], figures["mouth_to_eye_ms"]
    parts = [] if ear is None or eye is None else [f"{ear:.0f} ms to the ear, {eye:.0f} to the eye"]
    for name, word in (("loss", "lost"), ("concealed_share", "concealed"), ("held_share", "held")):
        share = figures[name] or 0.0
        if share >= 0.0005:
            parts.append(f"{100 * share:.1f} % {word}")
    return [*parts, f"{figures['kbps'] or 0.0:.0f} kb/s"] if ear is not None else parts
