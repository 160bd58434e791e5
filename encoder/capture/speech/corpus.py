"""Texts for the rule-made voices: English from templates, other languages for tests.

Millions of different sentences; a text belongs to one split for ever, by its checksum.
"""

import zlib

import numpy as np

_SLOTS: dict[str, str] = {
    "who": "my mother|Bob|Pamela|the baker|our neighbour|a farmer|Vivian|the woman in the blue "
    "coat|Felix|your brother|the captain|George|Phoebe|an old friend|the young teacher|Matthew|"
    "nobody|everybody|Mum|Papa|the postman|Charlotte",
    "did": "bought|painted|moved|found|brought home|imagined|wrapped up|forgot|fixed|measured|"
    "promised|watched|opened|put away|borrowed|described|lost|chose|carried|shared|photographed|"
    "gave away|pushed|washed",
    "what": "a pepper mill|five purple umbrellas|the wooden boat|a very small map|many warm "
    "blankets|the broken bicycle|his favourite book|some fresh bread|a bowl of mushrooms|the old "
    "piano|two yellow envelopes|her paper lamp|a big bag of apples|the measuring tape|a beautiful "
    "violin|three heavy boxes|the empty jam jar|a cup of coffee|fifty maps of Africa|the whole "
    "thing|one thousand postcards|a shiny watch",
    "where": "by the river|near the museum|above the village|at the back of the shop|in the "
    "middle of March|behind the white house|on the way to work|over the bridge|before breakfast|"
    "under the table|from a place far away|on a busy Thursday|at half past four|in the south of "
    "France|between two meetings|after the show|with both hands|last summer",
    "how": "quietly|perfectly|for a while|without a word|with pleasure|very slowly|again and "
    "again|by mistake|much too early|as usual|obviously|happily|all of a sudden|together",
    "thing": "weather|problem|programme|movie|voice|machine|picture|garden|water|question|"
    "television|book|job|room|moment|phone|journey|music|beach|other one|bathroom|chair",
    "like": "wonderful|awful|impossible|funny|far too loud|brown and blue|a bit strange|heavier "
    "than before|almost finished|usually fine|bigger than mine|very useful|on the move|just "
    "about right|open to everyone|cheaper now|terribly slow|famous",
    "verb": "move|help|call|leave|come home|show me|look at this|give up|push the button|think "
    "about it|choose another|join us|play outside|believe me|wait for me|pay for it|stop|speak "
    "up|measure it twice|have a bite",
    "word": "probably|maybe|honestly|well|of course|by the way|look|oh|yes|no|however|please|"
    "actually|you know|hmm|fine|wow|listen|remember",
    "number": "one|two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|fourteen|twenty "
    "two|fifty five|ninety six|a hundred and seven|four thousand",
    "letter": "A|B|C|D|E|F|G|H|I|J|K|L|M|N|O|P|Q|R|S|T|U|V|X|Y|Z",
    "name": "Emma|Oliver|Sophia|Bill|Maggie|Philip|Zoe|Hugh|Amber|Joshua|Beth|Umberto|Eve",
}
_TEMPLATES = (
    "{who} {did} {what} {where}.",
    "{word}, {who} {did} {what} {how}.",
    "{who} and {who} {did} {what}, and the {thing} was {like}.",
    "Why is the {thing} so {like}?",
    "Could you {verb}, {name}?",
    "The {thing} is {like}, but the {thing} is {like}.",
    "{word}. I think {who} {did} {what}.",
    "{number}, {number}, {number}, {number}.",
    "Please {verb} {where}, or {verb}.",
    "Did {who} really say that the {thing} is {like}?",
    "We {did} {what}; they {did} {what}.",
    "{name}, {name} and {name} will {verb} {how}.",
    "If the {thing} is {like}, we {verb}.",
    "{letter}, {letter}, {letter}, {number}, {letter}.",
    "Oh {word}! {verb}, {verb}!",
    "It was {like} when {who} {did} {what}.",
    "There are {number} people {where}, and {number} of them {verb}.",
    "I have never seen {what} like that {where}.",
    "{word}, put {number} and {number} together, then {verb}.",
    "My {thing} was {like}. Then, {how}, {who} {did} {what}.",
    "{who} told {name} to {verb}, {name} told {who} to {verb}.",
    "What a {like} {thing}!",
    "{word}.",
    "{number} of us {did} {what} {how}, {where}.",
)


_OPENERS = ("So", "Well", "You know", "I mean", "Anyway", "Um", "Right", "Actually", "Okay", "Yes")
_JOINERS = (
    ", and then ", ", but ", ", because ", ", so ", ", and, um, ", ", which means ", ", although ",
    ", you know, ", ", and I remember that ", ", or maybe ",
)  # fmt: skip
_CLAUSES = (
    "{who} {did} {what} {where}",
    "the {thing} was {like}",
    "we {did} {what} {how}",
    "I never {did} {what}",
    "you could {verb} {where}",
    "there were {number} people {where}",
    "it felt {like}",
    "{who} {did} {what}",
    "my {thing} is {like}",
    "they always {verb} {where}",
    "I wanted to {verb}",
)


def split_of(text: str) -> str:
    """ "test" for about a tenth of all texts, "train" for the rest."""
    return "test" if zlib.crc32(text.encode()) % 10 == 0 else "train"


def sentences(count: int, seed: int, split: str | None = None) -> list[str]:
    """`count` sentences (of one split, if named); the same seed gives the same ones."""
    rng = np.random.default_rng(seed)
    result: list[str] = []
    while len(result) < count:
        text = _fill(_TEMPLATES[rng.integers(len(_TEMPLATES))], rng)
        if split in (None, split_of(text)):
            result.append(text)
    return result


def freeform(count: int, seed: int, split: str | None = None) -> list[str]:
    """`count` runs of two to four joined clauses, as people talk."""
    rng = np.random.default_rng(seed)
    result: list[str] = []
    while len(result) < count:
        text = _fill(_CLAUSES[rng.integers(len(_CLAUSES))], rng)
        if rng.random() < 0.5:
            text = f"{_OPENERS[rng.integers(len(_OPENERS))]}, {_inner(text)}"
        for _ in range(rng.integers(1, 4)):
            clause = _fill(_CLAUSES[rng.integers(len(_CLAUSES))], rng)
            text += _JOINERS[rng.integers(len(_JOINERS))] + _inner(clause)
        text += "."
        if split in (None, split_of(text)):
            result.append(text)
    return result


def _inner(clause: str) -> str:
    return clause if clause.startswith("I ") else clause[0].lower() + clause[1:]


def _fill(template: str, rng: np.random.Generator) -> str:
    text = template
    while "{" in text:
        head, _, rest = text.partition("{")
        slot, _, tail = rest.partition("}")
        words = _SLOTS[slot].split("|")
        text = head + words[rng.integers(len(words))] + tail
    return text[0].upper() + text[1:]
