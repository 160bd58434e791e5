"""VRChat over OSC: VRCFaceTracking's v2 parameters and VRChat's own eye tracking.

Parameters follow VRCFaceTracking's "Unified Expressions": lids are 0 shut, 0.75 open, 1 wide; eye
directions are shares of 45 degrees, positive to the avatar's right and up. VRChat's own eye
tracking takes degrees, positive down and to the right; its trackers take the head's position in
metres and Euler angles in degrees.
"""

import numpy as np
from numpy.typing import NDArray

from app.face.arkit import ARKIT_NAMES
from app.sinks.protocols.face import NamedFace
from app.sinks.protocols.osc import Message, OscBundles
from sensors import rotation

PREFIX = "v2"
OPEN_LID = 0.75
FULL_TURN = np.radians(45.0)
EYE_PARAMETERS = ("EyeLeftX", "EyeLeftY", "EyeRightX", "EyeRightY")


def _sided(name: str, *sources: str) -> dict[str, dict[str, float]]:
    return {name + s: {source + s: 1.0 for source in sources} for s in ("Left", "Right")}


def _quarters(name: str, source: str) -> dict[str, dict[str, float]]:
    return {
        f"{name}{row}{side}": {source: 1.0}
        for row in ("Upper", "Lower")
        for side in ("Left", "Right")
    }


# v2 parameter -> weights of ARKit blendshapes; the lids also get OPEN_LID.
EXPRESSIONS: dict[str, dict[str, float]] = {
    **{
        f"EyeLid{s}": {f"eyeBlink{s}": -OPEN_LID, f"eyeWide{s}": 1 - OPEN_LID}
        for s in ("Left", "Right")
    },
    **_sided("EyeSquint", "eyeSquint"),
    **_sided("BrowPinch", "browDown"),
    **_sided("BrowLowerer", "browDown"),
    **{f"BrowInnerUp{s}": {"browInnerUp": 1.0} for s in ("Left", "Right")},
    **_sided("BrowOuterUp", "browOuterUp"),
    **_sided("NoseSneer", "noseSneer"),
    **_sided("CheekSquint", "cheekSquint"),
    **{f"CheekPuff{s}": {"cheekPuff": 1.0} for s in ("Left", "Right")},
    **{f"CheekPuffSuck{s}": {"cheekPuff": 1.0} for s in ("Left", "Right")},
    "JawOpen": {"jawOpen": 1.0},
    "JawLeft": {"jawLeft": 1.0},
    "JawRight": {"jawRight": 1.0},
    "JawForward": {"jawForward": 1.0},
    "JawX": {"jawRight": 1.0, "jawLeft": -1.0},
    "JawZ": {"jawForward": 1.0},
    "MouthClosed": {"mouthClose": 1.0},
    **_quarters("LipFunnel", "mouthFunnel"),
    **_quarters("LipPucker", "mouthPucker"),
    "LipFunnel": {"mouthFunnel": 1.0},
    "LipPucker": {"mouthPucker": 1.0},
    **{f"LipSuckUpper{s}": {"mouthRollUpper": 1.0} for s in ("Left", "Right")},
    **{f"LipSuckLower{s}": {"mouthRollLower": 1.0} for s in ("Left", "Right")},
    "LipSuckUpper": {"mouthRollUpper": 1.0},
    "LipSuckLower": {"mouthRollLower": 1.0},
    **{f"Mouth{row}Left": {"mouthLeft": 1.0} for row in ("Upper", "Lower")},
    **{f"Mouth{row}Right": {"mouthRight": 1.0} for row in ("Upper", "Lower")},
    "MouthX": {"mouthRight": 1.0, "mouthLeft": -1.0},
    **_sided("MouthUpperUp", "mouthUpperUp"),
    **_sided("MouthUpperDeepen", "mouthUpperUp"),
    **_sided("MouthLowerDown", "mouthLowerDown"),
    **_sided("MouthCornerPull", "mouthSmile"),
    **_sided("MouthCornerSlant", "mouthSmile"),
    **_sided("MouthSmile", "mouthSmile"),
    **_sided("MouthFrown", "mouthFrown"),
    **_sided("MouthStretch", "mouthStretch"),
    **_sided("MouthDimple", "mouthDimple"),
    "MouthRaiserUpper": {"mouthShrugUpper": 1.0},
    "MouthRaiserLower": {"mouthShrugLower": 1.0},
    **_sided("MouthPress", "mouthPress"),
    "TongueOut": {"tongueOut": 1.0},
}


class VRChatEncoder:
    """Faces as datagrams. VRChat itself wants `prefix` as the avatar's maker wrote it."""

    def __init__(self, prefix: str = PREFIX) -> None:
        names = (*EYE_PARAMETERS, *EXPRESSIONS)
        messages: list[Message] = [(f"/avatar/parameters/{prefix}/{n}", (), 1) for n in names]
        messages += [("/tracking/eye/LeftRightPitchYaw", (), 4)]
        messages += [("/tracking/eye/EyesClosedAmount", (), 1)]
        messages += [(f"/tracking/trackers/head/{n}", (), 3) for n in ("position", "rotation")]
        self._bundles = OscBundles(messages)
        self._weights = np.zeros((len(EXPRESSIONS), len(ARKIT_NAMES)), np.float32)
        for row, sources in enumerate(EXPRESSIONS.values()):
            for name, weight in sources.items():
                self._weights[row, ARKIT_NAMES.index(name)] = weight
        self._rest = np.array([OPEN_LID * n.startswith("EyeLid") for n in EXPRESSIONS], np.float32)
        self._blinks = [ARKIT_NAMES.index(f"eyeBlink{s}") for s in ("Left", "Right")]

    def __call__(self, face: NamedFace) -> list[bytes]:
        right_up: NDArray[np.float32] = face.angles * np.array([-1, 1], np.float32)
        down_right = np.degrees(-face.angles[:, ::-1])
        parameters = self._weights @ face.arkit + self._rest
        closed = face.arkit[self._blinks].mean()
        values = [(right_up / FULL_TURN).clip(-1, 1).ravel(), parameters, down_right.ravel()]
        position, _ = rotation.to_unity(face.head)
        pitch, yaw, roll = np.degrees(rotation.to_angles(face.head.quat))
        values += [[closed], position, [pitch, -yaw, -roll]]
        return self._bundles.fill(np.concatenate(values, dtype=np.float32))
