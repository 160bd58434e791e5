"""The tables of the motion rules: what each phone asks of jaw, lips and tongue (JALI's rules).

p b m close the lips, f v touch the teeth, sibilants narrow the jaw, rounded phones pucker; the
tongue rises for t d n l s z, shows for th, and bunches for k g. All 0..1 of the full gesture.
The jaw's column lies between JALI's guess and a least-squares fit of these rules to GRID's tracked
jaw (838 aligned clips of s1): t k g l s hardly close it. That tracker also calls rounded and
closing lips a closed jaw; p b m w uw keep it half as open as a vowel, and move the lips more.
"""

GESTURES = (
    "jaw", "funnel", "pucker", "stretch", "lower", "upper", "shrug", "tip", "back", "out",
)  # fmt: skip
REST = dict.fromkeys(GESTURES, 0.0)
SHAPES: dict[str, dict[str, float]] = {
    **{p: {"jaw": 0.35} for p in ("p", "b", "m")},
    **{p: {"jaw": 0.18, "upper": 0.25} for p in ("f", "v")},
    **{p: {"jaw": 0.2, "stretch": 0.85, "lower": 0.75, "upper": 0.35, "tip": 0.7} for p in "sz"},
    **{
        p: {"jaw": 0.26, "funnel": 0.8, "lower": 0.3, "upper": 0.3, "tip": 0.6}
        for p in ("sh", "zh", "ch", "jh")
    },
    "t": {"jaw": 0.45, "lower": 0.45, "tip": 1.0},
    **{p: {"jaw": 0.37, "lower": 0.45, "tip": 1.0} for p in ("d", "n")},
    **{p: {"jaw": 0.22, "lower": 0.5, "tip": 0.5, "out": 0.5} for p in ("th", "dh")},
    "l": {"jaw": 0.45, "lower": 0.5, "tip": 1.0},
    **{p: {"jaw": 0.38, "lower": 0.25, "back": 1.0} for p in ("k", "g", "ng")},
    "hh": {"jaw": 0.26, "lower": 0.25},
    "r": {"jaw": 0.25, "funnel": 0.55, "pucker": 0.2, "tip": 0.4, "back": 0.3},
    "w": {"jaw": 0.28, "pucker": 0.95, "funnel": 0.2, "back": 0.5},
    "y": {"jaw": 0.32, "stretch": 0.7, "lower": 0.3, "tip": 0.3},
    "aa": {"jaw": 1.0, "lower": 0.35, "upper": 0.2},
    "ae": {"jaw": 0.95, "stretch": 0.65, "lower": 0.5, "upper": 0.3},
    "ah": {"jaw": 0.8, "lower": 0.35, "upper": 0.1},
    "ao": {"jaw": 0.8, "funnel": 0.45, "pucker": 0.15},
    "aw": {"jaw": 0.87, "funnel": 0.35, "pucker": 0.25},
    "ax": {"jaw": 0.6, "lower": 0.25},
    "ay": {"jaw": 0.95, "stretch": 0.3, "lower": 0.4, "upper": 0.2},
    "eh": {"jaw": 0.88, "stretch": 0.65, "lower": 0.45, "upper": 0.15},
    "er": {"jaw": 0.6, "funnel": 0.5, "pucker": 0.15, "tip": 0.3},
    "ey": {"jaw": 0.78, "stretch": 0.75, "lower": 0.45, "upper": 0.15},
    "ih": {"jaw": 0.55, "stretch": 0.65, "lower": 0.35},
    "iy": {"jaw": 0.55, "stretch": 0.9, "lower": 0.5, "upper": 0.15, "tip": 0.2},
    "ow": {"jaw": 0.68, "funnel": 0.4, "pucker": 0.6, "back": 0.3},
    "oy": {"jaw": 0.79, "funnel": 0.45, "pucker": 0.45},
    "uh": {"jaw": 0.55, "funnel": 0.35, "pucker": 0.4, "back": 0.3},
    "uw": {"jaw": 0.4, "pucker": 0.9, "funnel": 0.25, "back": 0.4},
}
# How strongly a phone insists on a gesture, against 1 for one that does not shape it (every phone
# pulls to neutral, else tracks stick), and how far its reach is stretched: lip rounding spreads,
# the jaw follows syllables.
INSIST = {"funnel": 2.5, "pucker": 2.5, "tip": 2.0, "back": 2.0, "out": 2.0}
REACH = {"jaw": 0.7, "funnel": 1.3, "pucker": 1.3, "tip": 0.7, "back": 0.8, "out": 0.6}
# A full gesture in rig units: {channel: weight}; rules.py makes the jaw, closures.py contacts.
GESTURE_RIG: dict[str, dict[str, float]] = {
    "funnel": {"mouthFunnel": 0.42},
    "pucker": {"mouthPucker": 0.55, "mouthFunnel": 0.08},
    "stretch": {
        "mouthStretch_L": 0.4,
        "mouthStretch_R": 0.4,
        "mouthDimple_L": 0.12,
        "mouthDimple_R": 0.12,
    },
    "lower": {"mouthLowerDown_L": 0.32, "mouthLowerDown_R": 0.32},
    "upper": {"mouthUpperUp_L": 0.24, "mouthUpperUp_R": 0.24},
    "shrug": {"mouthShrugLower": 0.2},
}
TONGUE_GESTURES = ("out", "tip", "back")  # in the order of channels.TONGUE_NAMES
# The lower lip on the upper teeth: this pose meets them within 0.8 mm on every shipped face.
TOUCH_POSE = {
    "jawOpen": 0.09,
    "mouthRollLower": 0.55,
    "mouthUpperUp_L": 0.15,
    "mouthUpperUp_R": 0.15,
}
