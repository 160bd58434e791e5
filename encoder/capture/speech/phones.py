"""Phones: the names that every engine's speech is told in, and how IPA maps to them.

A phone is ARPABET as flite prints it; sounds of other languages take the nearest mouth shape.
"""

from dataclasses import dataclass, field

import numpy as np

# index 0 is silence
_NAMES = (
    "pau aa ae ah ao aw ax ay b ch d dh eh er ey f g hh ih iy jh k l m n ng ow oy p r s sh t th "
    "uh uw v w y z zh"
)
PHONES: tuple[str, ...] = tuple(_NAMES.split())
PHONE_INDEX = {phone: index for index, phone in enumerate(PHONES)}
LIP_CLOSING = ("p", "b", "m")
TEETH_TOUCHING = ("f", "v")
VOWELS = (
    "aa", "ae", "ah", "ao", "aw", "ax", "ay", "eh", "er", "ey", "ih", "iy", "ow", "oy", "uh", "uw",
)  # fmt: skip
# Festival's names that flite does not use.
_SAME = {"h#": "pau", "brth": "pau", "axr": "er", "dx": "d", "em": "m", "en": "n", "el": "l"}
_SAME |= {"nx": "n", "hv": "hh", "ssil": "pau", "sil": "pau"}

_IPA = (
    "tʃ:ch dʒ:jh tɕ:ch dʑ:jh ts:s dz:z tʂ:ch pf:f aɪ:ay aʊ:aw oʊ:ow əʊ:ow ɔɪ:oy ɔø:oy eɪ:ey ɑː:aa "
    "ɔː:ao iː:iy uː:uw ɜː:er əl:l ɪə:ih eə:eh ʊə:uh aː:aa eː:ey oː:ow yː:uw øː:uh ɛː:eh œː:er "
    "ɑ:aa æ:ae ʌ:ah ɐ:ax ə:ax ɔ:ao ɒ:aa ɛ:eh e:eh ɚ:er ɝ:er ɜ:er ɪ:ih i:iy ᵻ:ih ɨ:ih ɯ:uh ɤ:ah "
    "ʊ:uh u:uw ʉ:uw ʏ:uh y:uw ø:uh œ:er ɵ:uh o:ow a:aa ɶ:ae b:b β:b d:d ɖ:d ð:dh f:f ɸ:f ɡ:g g:g "
    "ɢ:g h:hh ħ:hh ɦ:hh x:k χ:k ɣ:g ç:sh j:y ʝ:y k:k q:k c:k ɟ:g l:l ɫ:l ɭ:l ʎ:l ɬ:l m:m ɱ:m n:n "
    "ɲ:n ɳ:n ŋ:ng p:p ɹ:r r:r ɾ:d ʀ:r ʁ:r ɻ:r ɽ:r ʔ:pau s:s ʃ:sh ʂ:sh ɕ:sh t:t ʈ:t θ:th v:v ʋ:v "
    "w:w ʍ:w ɥ:w z:z ʒ:zh ʐ:zh ʑ:zh"
)
_IPA_TO_PHONE = {symbol: phone for symbol, _, phone in (p.partition(":") for p in _IPA.split())}


@dataclass(frozen=True)
class Phone:
    """One phone of a spoken clip; times in seconds from the first sample."""

    name: str  # one of PHONES
    start: float
    end: float


@dataclass(frozen=True)
class Speech:
    """Sound and the phones that cover it in order."""

    audio: np.ndarray  # [n] float32 -1..1 at 48 kHz
    phones: list[Phone] = field(default_factory=list)


def from_ipa(symbol: str) -> str:
    """The phone of an IPA symbol with its marks; "" for marks alone, "pau" for what is unknown."""
    plain = "".join(c for c in symbol if c not in "ˈˌ̪̩̃ʲʰ̯̥͡")
    if symbol and not plain:
        return ""
    for length in (2, 1):
        if plain[:length] in _IPA_TO_PHONE:
            return _IPA_TO_PHONE[plain[:length]]
    return "pau"


def from_festival(name: str) -> str:
    """The phone of a name in flite's or festival's set."""
    name = _SAME.get(name, name)
    return name if name in PHONE_INDEX else "pau"


def pack_phones(phones: list[Phone]) -> np.ndarray:
    """-> [P, 3] float32: index in PHONES, start and end in seconds."""
    rows = [(PHONE_INDEX[p.name], p.start, p.end) for p in phones]
    return np.array(rows, np.float32).reshape(-1, 3)


def unpack_phones(rows: np.ndarray) -> list[Phone]:
    """[P, 3] -> phones."""
    return [Phone(PHONES[int(i)], float(a), float(b)) for i, a, b in rows]
