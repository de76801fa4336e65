// Drawing: two meshes (before, after), a normal map for each, one map of paint and confidence.

const BACKGROUND = 32 / 255;
const MODES = { colour: 0, clay: 1, normals: 2, confidence: 3, pick: 4 };

const VERTEX = `#version 300 es
layout(location = 0) in vec2 pixel;
layout(location = 1) in float depth;
uniform vec4 optics;   // fx, fy, cx, cy
uniform vec2 size;
uniform vec3 pivot;
uniform mat3 turn;
uniform vec4 frame;    // View.frame
uniform vec2 range;    // nearest and farthest z
out vec2 at;
void main() {
  vec3 p = vec3((pixel - optics.zw) / optics.xy, 1.0) * depth;
  vec3 q = turn * (p - pivot) + pivot;
  vec2 xy = frame.xy * (optics.x * q.xy - frame.zw * q.z);
  float z = ((range.x + range.y) * q.z - 2.0 * range.x * range.y) / (range.y - range.x);
  gl_Position = vec4(xy.x, -xy.y, z, q.z);
  at = (pixel + 0.5) / size;
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
uniform sampler2D normals;   // n / 2 + 1/2, and the object's mask
uniform sampler2D paint;     // linear albedo, and the confidence
uniform mat3 turn;
uniform int mode;
uniform vec3 light;          // towards the lamp, as the viewer sees it
uniform float intensity, ambient, specular, shininess;
uniform vec3 ramp[5];
in vec2 at;
out vec4 colour;

vec3 encoded(vec3 linear) {
  vec3 c = clamp(linear, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(max(c, 1e-6), vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}

void main() {
  vec4 texel = texture(normals, at);
  float inside = clamp((texel.a - 0.5) / max(fwidth(texel.a), 1e-3) + 0.5, 0.0, 1.0);
  vec3 n = normalize(2.0 * texel.xyz - 1.0);
  vec4 material = texture(paint, at);
  if (inside <= 0.0) discard;
  if (mode == ${MODES.pick}) {
    if (inside < 0.5) discard;
    vec2 coarse = floor(at * 65535.0 / 256.0);
    colour = vec4(coarse, floor(at * 65535.0) - 256.0 * coarse).xzyw / 255.0;
    return;
  }
  vec3 shown;
  if (mode == ${MODES.normals}) {
    shown = vec3(n.x, -n.yz) * 0.5 + 0.5;
  } else if (mode == ${MODES.confidence}) {
    float along = 4.0 * material.a;
    int below = int(min(along, 3.0));
    shown = mix(ramp[below], ramp[below + 1], along - float(below));
  } else {
    vec3 facing = turn * n;
    float lit = max(dot(facing, light), 0.0);
    vec3 base = mode == ${MODES.colour} ? material.rgb : vec3(0.8);
    vec3 halfway = normalize(light + vec3(0.0, 0.0, -1.0));
    float shine = lit > 0.0 ? pow(max(dot(facing, halfway), 0.0), shininess) : 0.0;
    shown = encoded(base * (1.0 - 0.6 * specular) * (intensity * lit + ambient)
                    + specular * intensity * shine);
  }
  colour = vec4(shown, inside);
}`;

class Scene {
  constructor(canvas, facts, maps) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: true });
    if (!gl) throw new NoWebGL();
    Object.assign(this, { gl, canvas, facts });
    this.program = link(gl);
    this.at = (name) => gl.getUniformLocation(this.program, name);
    this.paint = texture(gl, maps, gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, maps.paint);
    this.surfaces = {};
    for (const name of ["before", "after"]) {
      const { depth, normals } = maps[name];
      const mesh = decimate(depth, facts.camera, facts.mesh);
      this.surfaces[name] = {
        ...upload(gl, mesh),
        step: mesh.step,
        normals: texture(
          gl, maps, gl.RGB10_A2, gl.RGBA, gl.UNSIGNED_INT_2_10_10_10_REV, normals),
      };
    }
    this.target = pickTarget(gl);
  }

  resize(width, height) {
    this.canvas.width = width;
    this.canvas.height = height;
  }

  // state.wipe: the share of the width, from the left, that shows the surface before.
  draw(view, state) {
    const { gl, canvas: { width, height } } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(BACKGROUND, BACKGROUND, BACKGROUND, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.prepare(view, state, MODES[state.surface]);
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    const edge = Math.round(state.wipe * width);
    gl.enable(gl.SCISSOR_TEST);
    for (const [name, from, to] of [["before", 0, edge], ["after", edge, width]]) {
      if (to <= from) continue;
      gl.scissor(from, 0, to - from, height);
      this.drawSurface(name);
    }
    gl.disable(gl.SCISSOR_TEST);
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
  }

  // The pixel (u, v) of the maps that is seen at (x, y), shares of the canvas; null for none.
  pick(view, state, x, y) {
    const { gl, canvas: { width, height } } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    // The framebuffer's only pixel is the one wanted.
    gl.viewport(-Math.floor(x * width), Math.floor(y * height) + 1 - height, width, height);
    gl.clearColor(1, 1, 1, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.prepare(view, state, MODES.pick);
    this.drawSurface(x < state.wipe ? "before" : "after");
    const bytes = new Uint8Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    if (bytes.every((byte) => byte === 255)) return null;
    const { camera } = this.facts;
    const share = (high, low) => (256 * high + low + 0.5) / 65535;
    return [
      share(bytes[0], bytes[1]) * camera.width - 0.5,
      share(bytes[2], bytes[3]) * camera.height - 0.5,
    ];
  }

  prepare(view, state, mode) {
    const { gl, facts: { camera, ramp } } = this;
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    gl.uniform4f(this.at("optics"), camera.fx, camera.fy, camera.cx, camera.cy);
    gl.uniform2f(this.at("size"), camera.width, camera.height);
    gl.uniform3fv(this.at("pivot"), view.pivot);
    gl.uniformMatrix3fv(this.at("turn"), true, view.turn.flat());
    gl.uniform4fv(this.at("frame"), view.frame);
    gl.uniform2fv(this.at("range"), view.range);
    gl.uniform1i(this.at("mode"), mode);
    gl.uniform3fv(this.at("light"), lightVector(state));
    for (const name of ["intensity", "ambient", "specular", "shininess"]) {
      gl.uniform1f(this.at(name), state[name]);
    }
    gl.uniform3fv(this.at("ramp"), ramp.flat());
    gl.uniform1i(this.at("normals"), 0);
    gl.uniform1i(this.at("paint"), 1);
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.paint);
  }

  drawSurface(name) {
    const { gl } = this, { array, count, normals } = this.surfaces[name];
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, normals);
    gl.bindVertexArray(array);
    gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 0);
  }

  // Wait until what was drawn is there.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

class NoWebGL extends Error {}

// Towards the lamp: azimuth clockwise from above, elevation over the picture, degrees.
function lightVector({ azimuth, elevation }) {
  const flat = Math.cos(elevation * RADIAN);
  return [
    Math.sin(azimuth * RADIAN) * flat,
    -Math.cos(azimuth * RADIAN) * flat,
    -Math.sin(elevation * RADIAN),
  ];
}

function link(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS) && !gl.isContextLost()) {
      throw new Error(gl.getShaderInfoLog(shader));
    }
  }
  gl.linkProgram(program);
  return program;
}

function texture(gl, { width, height }, internal, format, type, values) {
  if (Math.max(width, height) > gl.getParameter(gl.MAX_TEXTURE_SIZE)) {
    throw new Error("the maps are larger than this computer's textures");
  }
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, type, values);
  gl.generateMipmap(gl.TEXTURE_2D);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return made;
}

function upload(gl, { pixels, z, indices }) {
  const array = gl.createVertexArray();
  gl.bindVertexArray(array);
  const fill = (target, values) => {
    gl.bindBuffer(target, gl.createBuffer());
    gl.bufferData(target, values, gl.STATIC_DRAW);
  };
  fill(gl.ARRAY_BUFFER, pixels);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 2, gl.UNSIGNED_SHORT, false, 0, 0);
  fill(gl.ARRAY_BUFFER, z);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribPointer(1, 1, gl.FLOAT, false, 0, 0);
  fill(gl.ELEMENT_ARRAY_BUFFER, indices);
  gl.bindVertexArray(null);
  return { array, count: indices.length };
}

function pickTarget(gl) {
  const target = gl.createFramebuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, target);
  for (const [attachment, format] of [
    [gl.COLOR_ATTACHMENT0, gl.RGBA8], [gl.DEPTH_ATTACHMENT, gl.DEPTH_COMPONENT16],
  ]) {
    const buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, format, 1, 1);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, buffer);
  }
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return target;
}
