// Draws the Gaussians with WebGL2: one quad each, back to front, as render/splats/quads.py does. The
// projection is that of render/splats/reference.py; all its constants are the same. Quads are vertices of
// one long list and not instances: software GL draws instances one by one.

import { position } from "./camera.js";
import { SHINE } from "./shine.js";

const WIDTH = 1024;  // texels in a row of the textures
const STILL = new Float32Array(9 * 12).map((_, k) => (k % 12 % 5 === 0 ? 1 : 0));

const VERTEX = `#version 300 es
precision highp float;
precision highp int;
precision highp usampler2D;
uniform usampler2D words;
uniform usampler2D order;  // indices of Gaussians, far to near
uniform mat4 modelView;   // millimetres to camera space, y up, looking along -z
uniform mat4 projection;
uniform vec2 size;        // px
uniform vec3 low;         // mm
uniform vec3 steps;       // mm of a position step, log2 scale of level 0, log2 scale of a level
uniform vec4 neck[27];    // rows of 9 moves, from the chest to the head at even steps
uniform vec3 eyes;        // mm, from those of the mean face to the point between them
uniform vec3 viewer;      // mm
out vec2 uv;
flat out vec4 color;

${SHINE}
const float LOW_PASS = 0.15;
const float MAX_ALPHA = 0.999;
const float STRAND = 2.0;
const float FAINTEST = 6.0;  // -log2 of the faintest alpha that is drawn
const float HALF_LOG2_E = 0.72134752;

mat3 rotation(vec3 turn) {
  float square = dot(turn, turn);
  vec3 v = 2.0 * turn / (1.0 + square);
  float w = (1.0 - square) / (1.0 + square), x = v.x, y = v.y, z = v.z;
  return mat3(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// How far a point goes with the head: render/decoder/neck.py, Neck.along.
float along(vec3 point) {
  vec3 p = point - eyes;
  float top = -62.0 - 0.45 * p.z, bottom = -152.0 - 0.36 * p.z;
  float share = clamp((p.y - bottom) / (top - bottom), 0.0, 1.0);
  share = clamp(share - clamp((abs(p.x) - 52.0) / 45.0, 0.0, 1.0) * (1.0 - share), 0.0, 1.0);
  return share * share * (3.0 - 2.0 * share);
}

ivec2 texel(int k) {
  return ivec2(k % ${WIDTH}, k / ${WIDTH});
}

void main() {
  int index = int(texelFetch(order, texel(gl_VertexID >> 2), 0).x);
  ivec2 at = texel(index);
  uvec4 word = texelFetch(words, at, 0);
  vec4 shown = vec4(word.w & 255u, word.w >> 8 & 255u, word.w >> 16 & 255u, word.w >> 24) / 255.0;
  vec3 mean = low + steps.x * vec3(word.x & 16383u, word.x >> 14 & 16383u, word.y & 16383u);
  vec3 levels = vec3(
    word.y >> 14 & 1023u, word.y >> 24 | (word.z >> 24 & 3u) << 8, word.x >> 28 | word.z >> 26 << 4);
  vec3 scale = exp2(steps.y + steps.z * vec3(word.z & 255u, word.z >> 8 & 255u, word.z >> 16 & 255u));

  float place = 8.0 * along(mean);
  int low_step = int(min(place, 7.0));
  float part = place - float(low_step);
  vec4 rows[3];
  for (int k = 0; k < 3; k++)
    rows[k] = mix(neck[3 * low_step + k], neck[3 * low_step + 3 + k], part);
  vec4 still = vec4(mean, 1.0);
  vec3 bent = vec3(dot(rows[0], still), dot(rows[1], still), dot(rows[2], still));
  mat3 bend = transpose(mat3(rows[0].xyz, rows[1].xyz, rows[2].xyz));
  vec4 point = modelView * vec4(bent, 1.0);
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // outside: nothing is drawn
  vec4 clip = projection * point;
  if (clip.w <= 0.0 || clip.z < -clip.w) return;
  float inverse = 1.0 / -point.z;
  vec2 focal = 0.5 * size * vec2(projection[0][0], projection[1][1]);
  vec2 off = vec2(projection[2][0], projection[2][1]);  // of the picture's centre, in half pictures
  vec2 reach = vec2(projection[0][0], projection[1][1]);
  vec2 slope = clamp(point.xy * inverse, (off - 1.3) / reach, (off + 1.3) / reach);

  mat3 turn = rotation(levels * (2.0 / 1023.0) - 1.0);
  mat3 axes = mat3(modelView) * bend * turn;
  axes = mat3(axes[0] * scale.x, axes[1] * scale.y, axes[2] * scale.z);
  vec3 row_x = focal.x * inverse * vec3(1.0, 0.0, slope.x) * axes;
  vec3 row_y = focal.y * inverse * vec3(0.0, 1.0, slope.y) * axes;
  float xx = dot(row_x, row_x) + LOW_PASS;
  float yy = dot(row_y, row_y) + LOW_PASS;
  float k = dot(row_x, row_y) / yy;
  // alpha = exp2(log2_opacity - u^2 - v^2) with u = p dx + q dy, v = r dy
  float p = sqrt(HALF_LOG2_E / max(xx - k * k * yy, 1e-6));
  float r = sqrt(HALF_LOG2_E / yy);
  float thickness = max(min(scale.x, scale.y), min(max(scale.x, scale.y), scale.z));
  float px = length(modelView[0].xyz) * thickness * focal.x * inverse;  // a headset's are metres
  bool strand = max(max(scale.x, scale.y), scale.z) > STRAND * thickness;
  float opacity = strand ? shown.a * sqrt(px * px / (px * px + LOW_PASS)) : shown.a;
  float log2_opacity = log2(clamp(opacity, 1e-6, MAX_ALPHA));
  if (log2_opacity < -FAINTEST) return;

  float radius = sqrt(log2_opacity + FAINTEST);
  uv = radius * vec2((gl_VertexID & 1) * 2 - 1, (gl_VertexID & 2) - 1);
  float dy = uv.y / r;
  float dx = uv.x / p + k * dy;
  vec3 view = normalize((viewer - bent) * bend);  // in the frame of the head at rest
  color = vec4(mirrored(shown.rgb, index, at, turn[2], view), log2_opacity);
  gl_Position = vec4(clip.xy / clip.w + 2.0 * vec2(dx, dy) / size, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 uv;
flat in vec4 color;
out vec4 premultiplied;
void main() {
  float power = color.a - dot(uv, uv);
  if (power < -6.0) discard;
  float alpha = exp2(power);
  premultiplied = vec4(color.rgb * alpha, alpha);
}`;

export class Splats {
  constructor(gl) {
    this.gl = gl;
    this.count = 0;
    this.neck = STILL;
    this.program = link(gl);
    this.places = Object.fromEntries(
      ["words", "order", "modelView", "projection", "size", "low", "steps", "neck", "eyes",
        "viewer", "weights", "roughness", "mirrors", "lamps", "lights", "film"]
        .map((name) => [name, gl.getUniformLocation(this.program, name)]));
    this.words = texture(gl);
    this.order = texture(gl);
    this.weights = texture(gl);
    this.roughness = texture(gl);
    this.quads = gl.createVertexArray();
    this.corners = gl.createBuffer();
  }

  // What all ticks share: their number of Gaussians, ranges [9], and what the first ones mirror.
  setBase({ count, ranges, mirrors, light, weights, roughness }) {
    Object.assign(this, { ranges, mirrors, light });
    this.rows = Math.ceil(count / WIDTH);
    this.count = 0;  // nothing is drawn until the first order has come
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.words);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32UI, WIDTH, this.rows, 0, gl.RGBA_INTEGER,
      gl.UNSIGNED_INT, null);
    gl.bindTexture(gl.TEXTURE_2D, this.order);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R32UI, WIDTH, this.rows, 0, gl.RED_INTEGER,
      gl.UNSIGNED_INT, null);
    const bytes = WIDTH * this.rows;
    gl.bindTexture(gl.TEXTURE_2D, this.weights);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8UI, WIDTH, this.rows, 0, gl.RGBA_INTEGER,
      gl.UNSIGNED_BYTE, padded(weights, Uint8Array, 4 * bytes));
    gl.bindTexture(gl.TEXTURE_2D, this.roughness);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8UI, WIDTH, this.rows, 0, gl.RED_INTEGER,
      gl.UNSIGNED_BYTE, padded(roughness, Uint8Array, bytes));
    const corners = new Uint32Array(6 * count);
    for (let k = 0; k < count; k++)
      corners.set([4 * k, 4 * k + 1, 4 * k + 2, 4 * k + 2, 4 * k + 1, 4 * k + 3], 6 * k);
    gl.bindVertexArray(this.quads);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.corners);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  // The Gaussians of a tick [4 N], or null when only the order has changed, and their order [N].
  // `neck` [9, 3, 4]: how the head is turned, or null where it rests.
  set(words, order, neck) {
    const gl = this.gl;
    this.neck = neck ?? STILL;
    if (words) {
      gl.bindTexture(gl.TEXTURE_2D, this.words);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, this.rows, gl.RGBA_INTEGER, gl.UNSIGNED_INT,
        padded(words, Uint32Array, 4 * WIDTH * this.rows));
    }
    gl.bindTexture(gl.TEXTURE_2D, this.order);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, this.rows, gl.RED_INTEGER, gl.UNSIGNED_INT,
      padded(order, Uint32Array, WIDTH * this.rows));
    this.count = order.length;
  }

  // Into the bound framebuffer's viewport of `width` x `height` px; matrices are column-major.
  draw(modelView, projection, width, height) {
    if (!this.count) return;
    const { gl, places, ranges, light } = this;
    gl.useProgram(this.program);
    gl.enable(gl.BLEND);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    for (const [unit, name] of ["words", "order", "weights", "roughness"].entries()) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, this[name]);
      gl.uniform1i(places[name], unit);
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.uniformMatrix4fv(places.modelView, false, modelView);
    gl.uniformMatrix4fv(places.projection, false, projection);
    gl.uniform2f(places.size, width, height);
    gl.uniform3f(places.low, ranges[0], ranges[1], ranges[2]);
    gl.uniform3f(places.steps, ranges[3], ranges[4], ranges[5]);
    gl.uniform4fv(places.neck, this.neck);
    gl.uniform3f(places.eyes, ranges[6], ranges[7], ranges[8]);
    gl.uniform3fv(places.viewer, position(modelView));
    gl.uniform1i(places.mirrors, this.mirrors);
    gl.uniform4fv(places.lamps, light.subarray(0, 16));
    gl.uniform3fv(places.lights, light.subarray(16, 28));
    gl.uniform1fv(places.film, light.subarray(28));
    gl.bindVertexArray(this.quads);
    gl.drawElements(gl.TRIANGLES, 6 * this.count, gl.UNSIGNED_INT, 0);
    gl.bindVertexArray(null);
  }
}

function link(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(program));
  return program;
}

function texture(gl) {
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  return made;
}

function padded(data, Kind, length) {
  const out = new Kind(length);
  out.set(data);
  return out;
}
