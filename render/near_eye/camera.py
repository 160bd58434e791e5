"""The headset's two eye cameras, simulated: infrared pictures of the eyes from a few centimetres.

Draws the decoder's mesh around each eye with its own shading: skin in infrared, an eyeball with
cornea, iris, pupil and the mirror images of the lamps, lashes and brows; then the camera's lens
and noise. Truth is exact: gaze and lids are what was drawn. Off the live path: the capture stage
and tests use it. The right eye is drawn as a mirrored left eye and flipped at the end.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from render.decoder.decoder import Decoder
from render.decoder.identity import Identity
from render.gl.contexts import GLContext, create_context
from render.near_eye import parts, primitives
from render.near_eye.look import MAX_LEDS, Look
from render.near_eye.sensor import expose
from render.types import AHEAD, Floats

if TYPE_CHECKING:
    import moderngl

SIZE_PX = 400
EYEBALL_MM = 15.0  # of the face data: its lids lie on a ball of this radius
SHUT_GAIN = 0.2  # the rig's eyeBlink leaves a slit of a millimetre: this closes it
SHADERS = Path(__file__).parents[1] / "shaders"


class EyePair(NamedTuple):
    """One moment, left eye first."""

    pictures: NDArray[np.uint8]  # [2, size_px, size_px]
    lids: Floats  # [2] opening: 0 shut, 1 as at rest


@dataclass(frozen=True)
class Wearer:
    """One person in one headset: what stays the same over a clip."""

    identity: Identity
    look: Look
    skins: tuple[parts.EyeSkin, parts.EyeSkin]
    strands: tuple[parts.Lashes, parts.Lashes]


class NearEye:
    """Both eye cameras; holds the GL programs. One at a time in a process."""

    def __init__(self, decoder: Decoder, backend: str = "auto", size_px: int = SIZE_PX) -> None:
        self.decoder = decoder
        self.size_px = size_px  # smaller ones are much cheaper, for whoever shrinks them anyway
        self.context: GLContext = create_context(backend)
        gl = self.context.gl
        vertex = (SHADERS / "near_eye.vert.glsl").read_text()
        common = (SHADERS / "near_eye_common.glsl").read_text()
        self.programs: dict[str, moderngl.Program] = {
            name: gl.program(vertex, common + (SHADERS / f"near_eye_{name}.frag.glsl").read_text())
            for name in ("skin", "ball", "hair")
        }
        self.target = gl.framebuffer(
            [gl.texture((size_px, size_px), 1, dtype="f4")],
            gl.depth_renderbuffer((size_px, size_px)),
        )
        self.ball = self._buffer("ball", *primitives.sphere(EYEBALL_MM))
        self.grains = gl.texture(
            (primitives.GRAIN_PX, primitives.GRAIN_PX), 4, primitives.grain_texture().tobytes()
        )
        self.grains.filter = (gl.LINEAR, gl.LINEAR)

    def close(self) -> None:
        """Free the context; may be called twice."""
        self.context.gl.release()

    def wear(self, identity: Identity, look: Look, rng: np.random.Generator) -> Wearer:
        """Put the headset on somebody: cut the skin around both eyes and grow lashes and brows."""
        decoder = self.decoder
        rest = decoder.encode(np.zeros(len(decoder.rig_names), np.float32))
        neutral = np.asarray(decoder.vertices(rest, AHEAD, identity))
        regions = decoder.regions
        skins = [
            parts.eye_skin(
                neutral, decoder.faces, identity.eye_centers[eye], eye,
                regions["eyelids"], regions["brows"], rng,
            )
            for eye in range(2)
        ]  # fmt: skip
        hair = [
            parts.Lashes.draw(skin, look.lashes, look.lash_length, look.lash_curl, rng)
            for skin in skins
        ]
        return Wearer(identity, look, (skins[0], skins[1]), (hair[0], hair[1]))

    def draw(
        self,
        wearer: Wearer,
        rig: Floats,  # [53] in the order of decoder.rig_names
        gaze: Floats,  # [2, 3] unit vectors in the head's frame
        rng: np.random.Generator,
        look: Look | None = None,  # of this moment; default: the wearer's
    ) -> EyePair:
        """Both pictures and how far the lids are open."""
        look = look or wearer.look
        code = self.decoder.encode(self._shutting(rig))
        vertices = np.asarray(self.decoder.vertices(code, gaze, wearer.identity))
        pictures = np.empty((2, self.size_px, self.size_px), np.uint8)
        lids = np.empty(2, np.float32)
        for eye in range(2):
            skin = wearer.skins[eye]
            posed = skin.posed(vertices)
            margins = skin.margins(posed)
            lids[eye] = skin.opening(margins)
            direction = gaze[eye] * np.array([skin.side, 1, 1], np.float32)
            light = self._light(skin, posed, margins, wearer.strands[eye], direction, look)
            picture = expose(light, look, rng)
            pictures[eye] = picture if eye == 0 else picture[:, ::-1]
        return EyePair(pictures, lids)

    def _shutting(self, rig: Floats) -> Floats:
        rig = rig.astype(np.float32).copy()
        for k, name in enumerate(self.decoder.rig_names):
            if name.startswith("eyeBlink"):
                rig[k] *= 1 + SHUT_GAIN * rig[k] ** 2
        return rig

    def _light(
        self,
        skin: parts.EyeSkin,
        posed: Floats,
        margins: tuple[Floats, Floats],
        strands: parts.Lashes,
        gaze: Floats,
        look: Look,
    ) -> Floats:  # [size_px, size_px] linear
        gl = self.context.gl
        self.context.activate()
        self.target.use()
        self.target.clear(look.backdrop, 0, 0, 1, depth=1.0)
        view, eye = primitives.camera(look)
        surface = parts.normals(posed, skin.faces)
        self._common(view, eye, look)
        self.grains.use(0)
        gl.enable_only(gl.DEPTH_TEST)
        self._skin_uniforms(look)
        rows = np.concatenate([posed, surface, skin.rest], 1).astype(np.float32)
        self._draw_now("skin", rows, skin.faces)
        self._ball_uniforms(gaze, margins, look)
        self.ball.render()
        gl.enable(gl.BLEND)
        gl.blend_func = gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA
        self.target.depth_mask = False
        pixel_mm = 2 * look.distance * np.tan(np.radians(look.view_deg) / 2) / self.size_px
        brow = parts.brow_curves(skin, posed, surface, look.brow_hairs)
        curves = np.concatenate([strands.curves(margins), brow])
        hairs = parts.ribbons(curves, eye, look.lash_width, look.lash_shade, pixel_mm)
        self._draw_now("hair", hairs)
        self.target.depth_mask = True
        raw = np.frombuffer(self.target.read(components=1, dtype="f4"), np.float32)
        return raw.reshape(self.size_px, self.size_px)[::-1].astype(np.float32)

    def _common(self, view: Floats, eye: Floats, look: Look) -> None:
        lamps = np.zeros((MAX_LEDS, 3), np.float32)
        lamps[: len(look.leds)] = look.leds
        power = 900.0 / len(look.leds)
        for program in self.programs.values():
            _set(program, "to_clip", view.T.tobytes())
            _set(program, "camera", tuple(eye.tolist()))
            _set(program, "leds", lamps.tobytes())
            _set(program, "num_leds", len(look.leds))
            _set(program, "led_power", power)
            _set(program, "seed", look.seed)

    def _skin_uniforms(self, look: Look) -> None:
        program = self.programs["skin"]
        _set(program, "albedo", look.albedo)
        _set(program, "gloss", look.gloss)
        _set(program, "pores", look.pores)
        _set(program, "crease", (-12.5, -1.5, 10.0, 0.35))

    def _ball_uniforms(self, gaze: Floats, margins: tuple[Floats, Floats], look: Look) -> None:
        program = self.programs["ball"]
        across = np.cross(np.array([0, 1, 0], np.float32), gaze)
        _set(program, "gaze", tuple(gaze.tolist()))
        _set(program, "across", tuple((across / np.linalg.norm(across)).tolist()))
        _set(program, "radius", EYEBALL_MM)
        _set(program, "iris", look.iris)
        _set(program, "pupil", min(look.pupil, look.iris - 1.2))
        _set(program, "tones", (look.sclera_tone, look.iris_tone, look.pupil_tone, look.limbus))
        _set(program, "fibres", look.fibres)
        _set(program, "upper", tuple(margins[0][0].tolist()))
        _set(program, "lower", tuple(margins[1][0].tolist()))

    def _buffer(self, name: str, rows: Floats, faces: NDArray[np.int32] | None = None) -> Any:
        gl, program = self.context.gl, self.programs[name]
        names = [n for n in ("in_place", "in_normal", "in_rest") if n in program]
        layout = " ".join(
            "3f" if n in program else "3x4" for n in ("in_place", "in_normal", "in_rest")
        )
        values = gl.buffer(np.ascontiguousarray(rows, "f4").tobytes())
        index = gl.buffer(faces.astype("i4").tobytes()) if faces is not None else None
        array = gl.vertex_array(program, [(values, layout, *names)], index)
        array.extra = [buffer for buffer in (values, index) if buffer]
        return array

    def _draw_now(self, name: str, rows: Floats, faces: NDArray[np.int32] | None = None) -> None:
        array = self._buffer(name, rows, faces)
        array.render()
        for part in (array, *array.extra):  # an array does not free what it draws
            part.release()


def _set(program: Any, name: str, value: Any) -> None:
    """Set a uniform; the compiler drops those that a program does not use."""
    if name in program:
        if isinstance(value, bytes):
            program[name].write(value)
        else:
            program[name].value = value
