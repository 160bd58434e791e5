"""VRChat over OSC: VRCFaceTracking's v2 parameters and VRChat's own eye tracking.

Parameters follow VRCFaceTracking's "Unified Expressions": lids are 0 shut, 0.75 open, 1 wide; eye
directions are shares of 45 degrees, positive to the avatar's right and up. Avatars take shapes, or
what joins some of them (SmileSad, EyeY). VRChat's own eye tracking takes degrees, positive down and
to the right; its trackers take the head's position in metres and Euler angles in degrees.
"""

from collections.abc import Mapping

import numpy as np

from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.bits import BitEncoder, Bits
from app.sinks.protocols.face import NamedFace
from app.sinks.protocols.osc import Message, OscBundles
from sensors import rotation

PREFIX = "v2"
OPEN_LID = 0.75
FULL_TURN = np.radians(45.0)
SIDES = ("Left", "Right")
ACTIVE = ("EyeTrackingActive", "LipTrackingActive", "ExpressionTrackingActive")
EYE_PARAMETERS = ("EyeLeftX", "EyeLeftY", "EyeRightX", "EyeRightY", "EyeX", "EyeY")


def _sided(name: str, *sources: str) -> dict[str, dict[str, float]]:
    return {name + s: {source + s: 1.0 for source in sources} for s in SIDES}


def _quarters(name: str, source: str) -> dict[str, dict[str, float]]:
    return {f"{name}{row}{side}": {source: 1.0} for row in ("Upper", "Lower") for side in SIDES}


# What stands for the stronger of two ARKit blendshapes.
STRONGER = {
    **{f"MouthSad{s}": (f"mouthFrown{s}", f"mouthStretch{s}") for s in SIDES},
    **{f"Eye{part}": (f"eye{part}Left", f"eye{part}Right") for part in ("Squint", "Wide")},
}
SOURCES = (*ARKIT_NAMES, *STRONGER)
# v2 parameter -> weights of SOURCES; the lids also get OPEN_LID.
_SHAPES: dict[str, dict[str, float]] = {
    **{f"EyeLid{s}": {f"eyeBlink{s}": -OPEN_LID, f"eyeWide{s}": 1 - OPEN_LID} for s in SIDES},
    **_sided("EyeSquint", "eyeSquint"),
    **_sided("EyeWide", "eyeWide"),
    **_sided("BrowDown", "browDown"),
    **{f"BrowUp{s}": {f"browOuterUp{s}": 0.6, "browInnerUp": 0.4} for s in SIDES},
    **{
        f"BrowExpression{s}": {"browInnerUp": 0.5, f"browOuterUp{s}": 0.5, f"browDown{s}": -1.0}
        for s in SIDES
    },
    **_sided("BrowPinch", "browDown"),
    **_sided("BrowLowerer", "browDown"),
    **{f"BrowInnerUp{s}": {"browInnerUp": 1.0} for s in SIDES},
    **_sided("BrowOuterUp", "browOuterUp"),
    **_sided("NoseSneer", "noseSneer"),
    **_sided("CheekSquint", "cheekSquint"),
    **{f"CheekPuff{s}": {"cheekPuff": 1.0} for s in SIDES},
    **{f"CheekPuffSuck{s}": {"cheekPuff": 1.0} for s in SIDES},
    "JawOpen": {"jawOpen": 1.0},
    "JawLeft": {"jawLeft": 1.0},
    "JawRight": {"jawRight": 1.0},
    "JawForward": {"jawForward": 1.0},
    "JawX": {"jawRight": 1.0, "jawLeft": -1.0},
    "JawZ": {"jawForward": 1.0},
    "MouthClosed": {"mouthClose": 1.0},
    **_quarters("LipFunnel", "mouthFunnel"),
    **_quarters("LipPucker", "mouthPucker"),
    **{f"LipFunnel{part}": {"mouthFunnel": 1.0} for part in ("", "Upper", "Lower")},
    **{f"LipPucker{part}": {"mouthPucker": 1.0} for part in ("", "Upper", "Lower", *SIDES)},
    **{f"LipSuckUpper{s}": {"mouthRollUpper": 1.0} for s in SIDES},
    **{f"LipSuckLower{s}": {"mouthRollLower": 1.0} for s in SIDES},
    "LipSuckUpper": {"mouthRollUpper": 1.0},
    "LipSuckLower": {"mouthRollLower": 1.0},
    "LipSuck": {"mouthRollUpper": 0.5, "mouthRollLower": 0.5},
    **{
        f"LipSuckFunnel{row}{side}": {f"mouthRoll{row}": 1.0, "mouthFunnel": -1.0}
        for row in ("Upper", "Lower")
        for side in ("", *SIDES)
    },
    **{f"Mouth{row}Left": {"mouthLeft": 1.0} for row in ("Upper", "Lower")},
    **{f"Mouth{row}Right": {"mouthRight": 1.0} for row in ("Upper", "Lower")},
    **{f"Mouth{row}X": {"mouthRight": 1.0, "mouthLeft": -1.0} for row in ("", "Upper", "Lower")},
    **_sided("MouthUpperUp", "mouthUpperUp"),
    **_sided("MouthUpperDeepen", "mouthUpperUp"),
    **_sided("MouthLowerDown", "mouthLowerDown"),
    "MouthOpen": {f"mouth{part}{s}": 0.25 for part in ("UpperUp", "LowerDown") for s in SIDES},
    **_sided("MouthCornerPull", "mouthSmile"),
    **_sided("MouthCornerSlant", "mouthSmile"),
    **_sided("MouthSmile", "mouthSmile"),
    **_sided("MouthFrown", "mouthFrown"),
    **{name: {name: 1.0} for name in STRONGER},
    **{f"SmileFrown{s}": {f"mouthSmile{s}": 1.0, f"mouthFrown{s}": -1.0} for s in SIDES},
    **{f"MouthCornerY{s}": {f"mouthSmile{s}": 1.0, f"mouthFrown{s}": -1.0} for s in SIDES},
    **{f"SmileSad{s}": {f"mouthSmile{s}": 1.0, f"MouthSad{s}": -1.0} for s in SIDES},
    **_sided("MouthStretch", "mouthStretch"),
    **_sided("MouthDimple", "mouthDimple"),
    "MouthRaiserUpper": {"mouthShrugUpper": 1.0},
    "MouthRaiserLower": {"mouthShrugLower": 1.0},
    **_sided("MouthPress", "mouthPress"),
    "TongueOut": {"tongueOut": 1.0},
}
MEANS = (  # of the left and the right one
    *("EyeLid", "BrowUp", "BrowDown", "BrowInnerUp", "BrowOuterUp", "BrowExpression"),
    *("CheekSquint", "CheekPuffSuck", "NoseSneer", "MouthUpperUp", "MouthLowerDown"),
    *("MouthStretch", "MouthDimple", "MouthPress", "MouthCornerY", "SmileFrown", "SmileSad"),
)


def _mean(name: str) -> dict[str, float]:
    left, right = (_SHAPES[name + side] for side in SIDES)
    return {k: (left.get(k, 0.0) + right.get(k, 0.0)) / 2 for k in left | right}


EXPRESSIONS = _SHAPES | {name: _mean(name) for name in MEANS}
PARAMETER_NAMES = (*EYE_PARAMETERS, *EXPRESSIONS)


class VRChatEncoder:
    """Faces as datagrams. VRChat itself wants `prefix` as the avatar's maker wrote it.

    Every parameter goes out as a float; those of `bits`, by name, as bools, too. Avatars show a
    face only while they are told that it is tracked.
    """

    def __init__(self, prefix: str = PREFIX, bits: Mapping[str, Bits] | None = None) -> None:
        self._bits = BitEncoder(PARAMETER_NAMES, bits or {})
        here = f"/avatar/parameters/{prefix}"
        messages = [Message(f"{here}/{name}", num_floats=1) for name in PARAMETER_NAMES]
        messages += [Message(f"{here}/{name}", num_bools=1) for name in self._bits.names]
        above = {"/avatar/parameters", here.removesuffix("/v2")} - {here}
        active = [f"{folder}/{name}" for folder in sorted(above) for name in ACTIVE]
        messages += [Message(address, num_bools=1) for address in active]
        self._active = np.ones(len(active), np.bool_)
        messages += [Message("/tracking/eye/LeftRightPitchYaw", num_floats=4)]
        messages += [Message("/tracking/eye/EyesClosedAmount", num_floats=1)]
        head = "/tracking/trackers/head"
        messages += [Message(f"{head}/{name}", num_floats=3) for name in ("position", "rotation")]
        self._bundles = OscBundles(messages)
        self._weights = np.zeros((len(EXPRESSIONS), len(SOURCES)), np.float32)
        for row, sources in enumerate(EXPRESSIONS.values()):
            for name, weight in sources.items():
                self._weights[row, SOURCES.index(name)] = weight
        self._rest = np.array([OPEN_LID * n.startswith("EyeLid") for n in EXPRESSIONS], np.float32)
        self._stronger = [[ARKIT_NAMES.index(n) for n in pair] for pair in STRONGER.values()]
        self._blinks = [ARKIT_NAMES.index(f"eyeBlink{s}") for s in SIDES]

    def __call__(self, face: NamedFace) -> list[bytes]:
        right_up = (face.angles * np.array([-1, 1], np.float32) / FULL_TURN).clip(-1, 1)
        down_right = np.degrees(-face.angles[:, ::-1])
        shapes = np.concatenate([face.arkit, face.arkit[self._stronger].max(1)])
        expressions = self._weights @ shapes + self._rest
        parameters = np.concatenate([right_up.ravel(), right_up.mean(0), expressions])
        closed = face.arkit[self._blinks].mean()
        position, _ = rotation.to_unity(face.head)
        pitch, yaw, roll = np.degrees(rotation.to_angles(face.head.quat))
        values = [parameters, down_right.ravel(), [closed], position, [pitch, -yaw, -roll]]
        floats = np.concatenate(values, dtype=np.float32)
        bools = np.concatenate([self._bits(parameters), self._active])
        return self._bundles.fill(floats, bools)
