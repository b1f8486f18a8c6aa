// The robot in three dimensions: its body's capsules as the gateway sees them, drawn by WebGL. Everything here is a capsule, lines too:
// one program draws them all in one call, each in the box around it, where a fragment finds its own point on the surface.
"use strict";

const scene = {
  canvas: byId("body"), names: byId("names"), gl: null, shape: null, seen: null, asked: false, visible: true,
  turn: 0.6, tilt: 0.28, distance: 3.1, fov: 1 / Math.tan(0.35), near: 0.2, far: 12,
};
const VIEWS = { front: [0, 0.1], left: [Math.PI / 2, 0.1], above: [0, 1.45], home: [0.6, 0.28] };
const FLOOR_M = -1.476; // where the wheels stand with the lift at its top
const HUES = { left: [0.25, 0.55, 0.92], right: [0.95, 0.6, 0.2], "": [0.6, 0.63, 0.67] };
const AXES = [[0.9, 0.2, 0.2], [0.2, 0.7, 0.25], [0.25, 0.4, 0.95]];
const RED = [0.92, 0.15, 0.15];
const FLOATS = 11; // of a capsule: both ends in the camera's frame, radius, colour, and how much light counts

const VERTEX = `#version 300 es
precision highp float;
layout(location=0) in vec3 corner; layout(location=1) in vec3 a; layout(location=2) in vec3 b;
layout(location=3) in vec2 size; layout(location=4) in vec3 colour;
uniform vec4 lens;
out vec3 at; flat out vec3 A; flat out vec3 B; flat out vec2 S; flat out vec3 C;
void main() {
  vec3 along = b - a; float len = length(along);
  vec3 n = len > 1e-6 ? along / len : vec3(0, 0, 1);
  vec3 u = normalize(cross(n, abs(n.x) < 0.9 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
  at = 0.5 * (a + b) + size.x * (u * corner.x + cross(n, u) * corner.y) + n * corner.z * (0.5 * len + size.x);
  gl_Position = vec4(at.xy * lens.xy, -at.z * (lens.w + lens.z) / (lens.w - lens.z) - 2.0 * lens.w * lens.z / (lens.w - lens.z), -at.z);
  A = a; B = b; S = size; C = colour;
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 at; flat in vec3 A; flat in vec3 B; flat in vec2 S; flat in vec3 C;
uniform vec4 lens; uniform vec3 sky;
out vec4 shown;
float sphere(vec3 centre, vec3 ray) {
  float along = dot(ray, centre), h = along * along - dot(centre, centre) + S.x * S.x;
  if (h < 0.0) discard;
  return along - sqrt(h);
}
void main() {
  vec3 ray = normalize(at), axis = B - A;
  float len = length(axis); vec3 n = len > 1e-6 ? axis / len : vec3(0, 0, 1);
  vec3 m = ray - n * dot(ray, n), o = -A + n * dot(A, n);
  float k = max(dot(m, m), 1e-7), mo = dot(m, o), h = mo * mo - k * (dot(o, o) - S.x * S.x);
  if (h < 0.0) discard;
  float t = (-mo - sqrt(h)) / k, s = dot(t * ray - A, n);
  if (s < 0.0) t = sphere(A, ray); else if (s > len) t = sphere(B, ray);
  vec3 p = t * ray; s = clamp(dot(p - A, n), 0.0, len);
  vec3 normal = (p - A - n * s) / S.x;
  float key = max(dot(normal, normalize(vec3(-0.4, 0.6, 0.7))), 0.0), fill = 0.5 + 0.5 * dot(normal, sky);
  float shine = pow(max(dot(normal, normalize(vec3(-0.4, 0.6, 0.7) - ray)), 0.0), 40.0);
  shown = vec4(mix(C, C * (0.3 * fill + 0.75 * key + 0.12) + 0.22 * shine, S.y), 1);
  gl_FragDepth = 0.5 * ((lens.w + lens.z) / (lens.w - lens.z) + 2.0 * lens.w * lens.z / ((lens.w - lens.z) * p.z)) + 0.5;
}`;

function begin() {
  const gl = (scene.gl = scene.canvas.getContext("webgl2", { antialias: false, powerPreference: "low-power" }));
  byId("no-3d").hidden = Boolean(gl);
  if (!gl) return;
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    scene.gl = null;
    byId("no-3d").hidden = false;
    return;
  }
  gl.useProgram(program);
  const box = [];
  for (const face of [0, 1, 2]) {
    for (const sign of [-1, 1]) {
      for (const [x, y] of [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]]) {
        const corner = [0, 0, 0];
        corner[face] = sign;
        corner[(face + 1) % 3] = x * sign;
        corner[(face + 2) % 3] = y;
        box.push(...corner);
      }
    }
  }
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(box), gl.STATIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); // stays bound: it takes the capsules of each picture
  for (const [place, length, offset] of [[1, 3, 0], [2, 3, 3], [3, 2, 6], [4, 3, 8]]) {
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, length, gl.FLOAT, false, 4 * FLOATS, 4 * offset);
    gl.vertexAttribDivisor(place, 1);
  }
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.CULL_FACE);
  scene.lens = gl.getUniformLocation(program, "lens");
  scene.sky = gl.getUniformLocation(program, "sky");
}

// Camera: right, up and back of it in `chest`; a point there becomes one before the camera, which looks along its own -z.
function camera() {
  const [ct, st, cp, sp] = [Math.cos(scene.turn), Math.sin(scene.turn), Math.cos(scene.tilt), Math.sin(scene.tilt)];
  const rows = [[-st, ct, 0], [-ct * sp, -st * sp, cp], [ct * cp, st * cp, sp]];
  const middle_m = -0.16 * scene.distance; // all of it from afar, the arms from near by
  return (x, y, z) => rows.map((row, i) => row[0] * x + row[1] * y + row[2] * (z - middle_m) - (i === 2 ? scene.distance : 0));
}

function capsules(see) {
  const { shape, seen } = scene;
  const found = [];
  const add = (a, b, radius_m, colour, light) => found.push(...see(...a), ...see(...b), radius_m, light, ...colour);
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const grid = dark ? [0.25, 0.28, 0.32] : [0.82, 0.84, 0.87];
  for (let i = -4; i <= 4; i += 1) {
    add([i / 4 - 0.1, -1, FLOOR_M], [i / 4 - 0.1, 1, FLOOR_M], 0.003, grid, 0);
    add([-1.1, i / 4, FLOOR_M], [0.9, i / 4, FLOOR_M], 0.003, grid, 0);
  }
  const near = seen.near;
  shape.parts.forEach(({ name, side, radius_m }, index) => {
    const line = seen.lines_m[index];
    const isNear = scene.isTight && (name === near.first || name === near.second);
    add(line.slice(0, 3), line.slice(3), radius_m, isNear ? RED : HUES[side], 1);
  });
  add(near.from_m, near.to_m, 0.008, RED, 0);
  if (byId("frames").checked) {
    for (const frame of Object.values({ ...shape.frames, ...seen.frames })) {
      for (const axis of [0, 1, 2]) {
        const tip = [0, 1, 2].map((i) => frame[i] + 0.14 * frame[3 + 3 * axis + i]);
        add(frame.slice(0, 3), tip, 0.006, AXES[axis], 0.3);
      }
    }
  }
  return new Float32Array(found);
}

function render() {
  scene.asked = false;
  const { gl, canvas, shape, seen } = scene;
  if (!gl || gl.isContextLost() || !shape || !seen || document.hidden || !scene.visible) return;
  const scale = Math.max(1, Math.min(2, 1600 / canvas.clientWidth)); // fine enough without anything that smooths it
  canvas.width = Math.round(canvas.clientWidth * scale);
  canvas.height = Math.round(canvas.clientHeight * scale);
  gl.viewport(0, 0, canvas.width, canvas.height);
  const see = camera();
  const all = capsules(see);
  const wide = scene.fov * Math.min(1, canvas.width / canvas.height / 1.1);
  const lens = [(wide * canvas.height) / canvas.width, wide];
  gl.uniform4f(scene.lens, ...lens, scene.near, scene.far);
  gl.uniform3f(scene.sky, 0, Math.cos(scene.tilt), Math.sin(scene.tilt));
  gl.clearColor(0, 0, 0, 0);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  gl.bufferData(gl.ARRAY_BUFFER, all, gl.DYNAMIC_DRAW);
  gl.drawArraysInstanced(gl.TRIANGLES, 0, 36, all.length / FLOATS);
  showNames(see, lens);
  canvas.dataset.drawn = String(Number(canvas.dataset.drawn || 0) + 1);
}

function showNames(see, lens) {
  const frames = byId("frames").checked ? { ...scene.shape.frames, ...scene.seen.frames } : {};
  while (scene.names.childElementCount > Object.keys(frames).length) scene.names.lastChild.remove();
  Object.entries(frames).forEach(([name, frame], index) => {
    const label = scene.names.children[index] || element("span", "", scene.names);
    const [x, y, z] = see(frame[0], frame[1], frame[2]);
    label.textContent = name;
    label.style.transform = `translate(${((1 - (x * lens[0]) / z) / 2) * scene.canvas.clientWidth}px, ${((1 + (y * lens[1]) / z) / 2) * scene.canvas.clientHeight}px)`;
  });
}

function again() {
  if (!scene.asked) requestAnimationFrame(render); // the browser's own turn: whatever was pressed meanwhile goes first
  scene.asked = true;
}

function orbit(turn, tilt, nearer = 1) {
  scene.turn += turn;
  scene.tilt = Math.max(-0.3, Math.min(1.5, scene.tilt + tilt));
  scene.distance = Math.max(1, Math.min(6, scene.distance * nearer));
  again();
}

const KEYS = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 0.9], "-": [0, 0, 1.1] };
scene.canvas.addEventListener("keydown", (event) => {
  const by = KEYS[event.key];
  if (!by || event.ctrlKey || event.metaKey || event.altKey) return; // Escape goes on: it stops
  event.preventDefault();
  orbit(...by);
});
scene.canvas.addEventListener("pointerdown", (event) => {
  scene.canvas.setPointerCapture(event.pointerId);
  scene.from = [event.clientX, event.clientY];
});
scene.canvas.addEventListener("pointermove", (event) => {
  if (!scene.canvas.hasPointerCapture(event.pointerId)) return;
  orbit(0.01 * (scene.from[0] - event.clientX), 0.01 * (event.clientY - scene.from[1]));
  scene.from = [event.clientX, event.clientY];
});
for (const one of document.querySelectorAll("[data-view]")) {
  one.addEventListener("click", () => {
    [scene.turn, scene.tilt] = VIEWS[one.dataset.view];
    again();
  });
}
for (const one of document.querySelectorAll("[data-zoom]")) one.addEventListener("click", () => orbit(0, 0, Number(one.dataset.zoom)));
byId("frames").addEventListener("change", again);
scene.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
scene.canvas.addEventListener("webglcontextrestored", () => { begin(); again(); });
new IntersectionObserver(([entry]) => { scene.visible = entry.isIntersecting; again(); }).observe(scene.canvas);
new ResizeObserver(again).observe(scene.canvas);
document.addEventListener("visibilitychange", again);

let toldAt = -1000;
watchers.push(({ state, body }) => {
  scene.canvas.classList.toggle("stale", !body);
  if (!body) {
    toldAt = -1000;
    byId("near").textContent = "Where the arms are is not known now.";
  }
  if (!body || !scene.shape) return;
  scene.seen = body;
  const { first, second, gap_m } = body.near;
  scene.isTight = Boolean(state.spacing && (state.spacing.held.length || gap_m < state.spacing.margin_m));
  if (performance.now() - toldAt > 1000) { // not with each state: it is read, also aloud
    toldAt = performance.now();
    const words = (name) => name.replaceAll("_", " ");
    const apart = gap_m < 0 ? `${(-100 * gap_m).toFixed(1)} cm inside each other` : `${(100 * gap_m).toFixed(1)} cm apart`;
    const kept = !state.spacing || !state.spacing.on ? ". The gateway keeps no parts apart now" : scene.isTight ? ": too near" : "";
    byId("near").textContent = `Nearest: ${words(first)} and ${words(second)}, ${apart}${kept}.`;
  }
  again();
});

async function fetchShape() {
  const answer = await fetch("/api/body").catch(() => null);
  if (!answer || !answer.ok) return setTimeout(fetchShape, 2000);
  scene.shape = await answer.json();
  byId("body-card").hidden = !scene.shape.parts.length;
}

begin();
fetchShape();
