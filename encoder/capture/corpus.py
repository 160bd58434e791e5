"""Own English sentences from templates, varied in sound: what the rule-made voices say."""

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


def sentences(count: int, seed: int) -> list[str]:
    """`count` sentences; the same seed gives the same ones."""
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(count):
        text = _TEMPLATES[rng.integers(len(_TEMPLATES))]
        while "{" in text:
            head, _, rest = text.partition("{")
            slot, _, tail = rest.partition("}")
            words = _SLOTS[slot].split("|")
            text = head + words[rng.integers(len(words))] + tail
        result.append(text[0].upper() + text[1:])
    return result
