// The page of `ta2 web`: shows what /api/live tells, asks for what its buttons say. No library, nothing from elsewhere.
"use strict";

const byId = (id) => document.getElementById(id);
const SIDES = ["left", "right"];
const COLOURS = ["#d1495b", "#edae49", "#5ba300", "#00798c", "#4361ee", "#9d4edd", "#8d6e63"];
const PLOT_S = 30;
const LATE_MS = 1500; // without an answer for so long a stop's line says so
const LOOK_MS = 500;
const MOST_SILENT = 6; // looks without a word; the server says one each second. No time: a page that was busy has not listened
const AGAIN_MS = 150; // a held button says its velocity again; the server lets it count for 400 ms
let socket = null;
let number = 0;
let isOwner = false;
let epoch = 0; // of the lease that this page was given last
let drawnAt = 0;
let wasLatched = false;
const waiting = new Map();
const watchers = []; // functions of the other files: each message that tells a state, and {} where nobody tells any
const history = { left: [], right: [] };

// ------------------------------------------------------------------------------------------------------------- stop

async function stop(word) {
  const said = byId("stopped");
  said.textContent = "stopping";
  const late = setTimeout(() => { said.textContent = "nobody has answered yet: use the physical emergency stop"; }, LATE_MS);
  try {
    const answer = await fetch(`/api/${word}`, { method: "POST", body: JSON.stringify({ reason: "" }), keepalive: true });
    const done = await answer.json();
    if (!answer.ok) said.textContent = `${done.error.message}: ${done.error.hint}`;
    else if (done.undelivered) said.textContent = "NOT delivered: no way to the robot. Use the physical emergency stop.";
    else if (!done.confirmed) said.textContent = "sent, but nobody has confirmed it: look at the robot, use the physical emergency stop";
    else said.textContent = `stopped${done.by_guard ? " by the guard; the gateway does not answer" : ""}; Recover lets it move again`;
  } catch {
    said.textContent = "the page's own server does not answer: use the physical emergency stop";
  } finally {
    clearTimeout(late);
  }
}

byId("stop").addEventListener("pointerdown", () => stop("stop"));
byId("stop").addEventListener("click", (event) => { if (event.detail === 0) stop("stop"); }); // by the keyboard
byId("estop").addEventListener("click", () => stop("estop"));
document.addEventListener("keydown", (event) => { if (event.key === "Escape" && !event.repeat) stop("stop"); });
byId("recover").addEventListener("click", async () => {
  const answer = await fetch("/api/recover", { method: "POST", body: "{}" });
  const done = await answer.json();
  byId("stopped").textContent = answer.ok ? "" : `${done.error.message} ${done.error.hint}`;
});

// ---------------------------------------------------------------------------------------------------------- the socket

function connect() {
  const mine = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/live`);
  socket = mine;
  let isOpened = false;
  let isOver = false;
  let silent = 0;
  const end = (why) => {
    if (isOver) return;
    isOver = true;
    clearInterval(looking);
    mine.close(); // which is told minutes later where nobody answers: nothing waits for it
    own(false);
    waiting.clear();
    for (const see of watchers) see({});
    showNone(why);
    setTimeout(connect, 1000);
  };
  const looking = setInterval(() => {
    silent += 1;
    const most = isOpened ? MOST_SILENT : 3 * MOST_SILENT; // a connection may take a while
    if (silent > most) end("the page's server is not heard: what is shown is old");
  }, LOOK_MS);
  mine.addEventListener("open", () => { isOpened = true; silent = 0; byId("events").replaceChildren(); });
  mine.addEventListener("message", (event) => {
    silent = 0;
    if (!isOver) take(JSON.parse(event.data));
  });
  mine.addEventListener("close", () => {
    const way = document.querySelector('header a[href="/login"]') ? "log in" : "open the address that `ta2 web` printed";
    end(isOpened ? "the page's server is away" : `${way}; stopping works without`);
  });
}

function ask(message) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  number += 1;
  waiting.set(number, message.do);
  socket.send(JSON.stringify({ id: number, ...message }));
}

function take(message) {
  if (message.type === "state") showState(message);
  else if (message.type === "gone") showNone("no gateway answers: start it with ta2 run");
  else if (message.type === "notice") showNotice(message);
  else if (message.type === "reply") showReply(message);
  if (message.type === "state" || message.type === "gone") for (const see of watchers) see(message);
}

function showReply(reply) {
  const asked = waiting.get(reply.id);
  waiting.delete(reply.id);
  if (reply.ok) {
    byId("answer").textContent = "";
    if (asked === "acquire") {
      epoch = reply.facts.epoch;
      own(true);
    }
    if (asked === "release") own(false);
  } else {
    const error = reply.error;
    byId("answer").textContent = `${error.code}: ${error.message}${error.hint ? ` → ${error.hint}` : ""}`;
    if (["NOT_OWNER", "LEASE_LOST", "LEASE_STALE"].includes(error.code)) own(false);
  }
}

setInterval(() => { ask({ do: "alive" }); waiting.delete(number); }, 1000); // also while it waits to become the owner

// ------------------------------------------------------------------------------------------------------------- control

function own(is) {
  isOwner = is;
  byId("acquire").disabled = is;
  for (const button of document.querySelectorAll(".owner")) button.disabled = !is;
}

byId("acquire").addEventListener("click", () => {
  const owner = byId("owner").dataset.name;
  const take = byId("take").value.trim();
  byId("taking").hidden = !owner; // a field, no dialog: a dialog would keep the stop away while it is open
  if (owner && !take) {
    byId("answer").textContent = `${owner} owns the robot: say why you take it, then Take control again`;
    byId("take").focus();
    return;
  }
  byId("take").value = "";
  byId("taking").hidden = true;
  ask({ do: "acquire", take: owner ? take : "" });
});
for (const button of document.querySelectorAll("[data-do]")) {
  button.addEventListener("click", () => ask({ do: button.dataset.do }));
}

// A velocity counts only while its button is held: whatever ends the press ends the motion.
function held(button, message, rest) {
  let timer = 0;
  const begin = () => {
    if (timer || button.disabled) return;
    button.classList.add("held");
    ask(message);
    timer = setInterval(() => (isOwner ? ask(message) : end()), AGAIN_MS);
  };
  const end = () => {
    if (!timer) return;
    clearInterval(timer);
    timer = 0;
    button.classList.remove("held");
    ask(rest);
  };
  button.addEventListener("pointerdown", (event) => { button.setPointerCapture(event.pointerId); begin(); });
  for (const name of ["pointerup", "pointercancel", "lostpointercapture", "blur"]) button.addEventListener(name, end);
  button.addEventListener("keydown", (event) => { if (event.key === " " || event.key === "Enter") { event.preventDefault(); begin(); } });
  button.addEventListener("keyup", end);
  document.addEventListener("visibilitychange", end);
}

for (const button of document.querySelectorAll("[data-drive]")) {
  const [vx_mps, vy_mps, wz_radps] = button.dataset.drive.split(",").map(Number);
  held(button, { do: "drive", vx_mps, vy_mps, wz_radps }, { do: "drive", vx_mps: 0, vy_mps: 0, wz_radps: 0 });
}
for (const button of document.querySelectorAll("[data-lift]")) {
  held(button, { do: "lift", velocity_ratio: Number(button.dataset.lift) }, { do: "lift", velocity_ratio: 0 });
}

function element(name, text, parent) {
  const made = document.createElement(name);
  made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

function button(text, label, parent, then) {
  const made = element("button", text, parent);
  made.className = "owner";
  made.disabled = true;
  made.setAttribute("aria-label", label);
  made.addEventListener("click", then);
}

for (const side of SIDES) {
  const table = element("table", "", byId("jog"));
  element("caption", `${side} arm`, table);
  for (let joint = 1; joint <= 7; joint += 1) {
    const row = element("tr", "", table);
    element("th", `joint ${joint}`, row).scope = "row";
    element("td", "–", row).id = `${side}-${joint}`;
    const cell = element("td", "", row);
    const jog = (sign) => ask({ do: "jog", side, joint, step_rad: sign * Number(byId("step").value) });
    button("−", `${side} joint ${joint} minus`, cell, () => jog(-1));
    button("+", `${side} joint ${joint} plus`, cell, () => jog(1));
  }
  const row = element("tr", "", table);
  element("th", "gripper", row).scope = "row";
  element("td", "–", row).id = `${side}-gripper`;
  const cell = element("td", "", row);
  button("open", `open the ${side} gripper`, cell, () => ask({ do: "grip", side, force: -0.5 }));
  button("grip", `close the ${side} gripper`, cell, () => ask({ do: "grip", side, force: 0.5 }));
  const plot = element("figure", "", byId("plots"));
  const caption = element("figcaption", `${side} [rad]`, plot);
  COLOURS.forEach((colour, index) => { element("span", String(index + 1), caption).style.color = colour; });
  const canvas = element("canvas", "", plot);
  canvas.id = `plot-${side}`;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `joint positions of the ${side} arm over the last ${PLOT_S} seconds`);
}
own(false);

// --------------------------------------------------------------------------------------------------------------- show

function show(text, isBad) {
  const state = byId("state");
  if (state.textContent !== text) state.textContent = text;
  state.classList.toggle("bad", isBad);
}

const OLD_NS = 200e6; // numbers that are older are none
const BAD = new Set(["ESTOP", "FAULT", "DISCONNECTED", "LOST"]);

function showArm(side, arm, gripper) {
  const q = arm && arm.age_ns < OLD_NS ? arm.q_rad : [];
  for (let joint = 1; joint <= 7; joint += 1) {
    byId(`${side}-${joint}`).textContent = joint <= q.length ? `${q[joint - 1].toFixed(3)} rad` : "–";
  }
  byId(`${side}-gripper`).textContent = gripper && gripper.age_ns < OLD_NS ? `${gripper.q_rad[0].toFixed(2)} rad` : "–";
  return q;
}

// Nobody tells a state: what the last one told is not so any more.
function showNone(why) {
  show(why, true);
  byId("owner").textContent = "";
  for (const side of SIDES) showArm(side);
  byId("why").replaceChildren();
  showWire({ topics: {}, streams: {} });
}

function showState({ info, state }) {
  const age = state.link.up ? "" : ", no link to the robot";
  show(`${state.shown}${age}`, BAD.has(state.shown) || !state.link.fresh);
  const owner = byId("owner");
  const { lease } = state;
  if (isOwner && (lease.epoch > epoch || (lease.epoch === epoch && !lease.owned))) own(false); // an older state says nothing
  owner.dataset.name = lease.owned && !isOwner ? lease.name : "";
  owner.textContent = isOwner ? "you own the robot" : lease.owned ? `owner: ${lease.name}` : "nobody owns it";
  byId("place").textContent = info ? `${info.robot} (${info.model})` : "";
  byId("lift").hidden = !(info && info.has_lift);
  for (const side of SIDES) {
    const q = showArm(side, state.arms[side].measured, state.grippers[side]);
    if (q.length) history[side].push([state.at_ns / 1e9, q]);
    while (history[side].length && history[side][0][0] < state.at_ns / 1e9 - PLOT_S) history[side].shift();
    if (history[side].length && history[side].at(-1)[0] < history[side][0][0]) history[side].length = 0; // another gateway
  }
  const isLatched = Object.keys(state.latches).length > 0;
  const stopped = byId("stopped");
  if (wasLatched && !isLatched && stopped.textContent.startsWith("stopped")) stopped.textContent = ""; // somebody's Recover
  wasLatched = isLatched;
  showWhy(state);
  showWire(state);
  if (performance.now() - drawnAt > 250 && !document.hidden) {
    drawnAt = performance.now();
    SIDES.forEach(draw);
  }
}

function showWhy(state) {
  const told = [
    ...Object.entries(state.latches).map(([code, text]) => `${code}: ${text}. Recover when its cause is gone.`),
    ...state.findings.map((finding) => `${finding.code}: ${finding.message} → ${finding.hint}`),
    ...state.others.seen.map((other) => `another ${other.kind} commands the robot, or could: ${other.topic || other.zid}`),
    ...(state.spacing && state.spacing.held.length ? [`${state.spacing.first} and ${state.spacing.second} would come too near`] : []),
  ];
  const list = byId("why");
  const text = told.join("\n");
  if (list.dataset.text === text && list.childElementCount) return; // a screen reader hears what is new alone
  list.dataset.text = text;
  list.replaceChildren();
  for (const line of told) element("li", line, list);
  if (!told.length) element("li", "nothing", list).className = "fine";
}

const seconds = (ns) => (ns === null || ns === undefined ? "–" : ns < 1e9 ? `${(ns / 1e6).toFixed(0)} ms` : `${(ns / 1e9).toFixed(1)} s`);

function showWire(state) {
  const body = byId("wire").tBodies[0];
  const rows = [
    ...Object.entries(state.topics).map(([name, t]) => [name, t.rate_hz, seconds(t.age_ns), t.worst_gap_ns, t.count]),
    ...Object.entries(state.streams).filter(([, s]) => s.running).map(([name, s]) => [`→ ${name}`, s.rate_hz, "", s.worst_gap_ns, s.sent]),
  ];
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach(([name, rate, age, gap, count], index) => {
    const row = body.rows[index] || body.insertRow();
    while (row.cells.length < 5) row.insertCell();
    [name, `${rate.toFixed(1)} Hz`, age, seconds(gap), String(count)].forEach((text, column) => { row.cells[column].textContent = text; });
  });
}

function showNotice({ notice }) {
  const list = byId("events");
  const item = document.createElement("li");
  item.className = notice.level;
  element("b", notice.code, item);
  item.append(` ${notice.message}`);
  list.prepend(item);
  while (list.childElementCount > 100) list.lastChild.remove();
}

function draw(side) {
  const canvas = byId(`plot-${side}`);
  const points = history[side];
  const scale = window.devicePixelRatio || 1;
  const width = (canvas.width = canvas.clientWidth * scale);
  const height = (canvas.height = canvas.clientHeight * scale);
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, width, height);
  if (points.length < 2) return;
  const all = points.flatMap(([, q]) => q);
  const low = Math.min(...all) - 0.1;
  const high = Math.max(...all) + 0.1;
  const end = points.at(-1)[0];
  const y = (q) => height - ((q - low) / (high - low)) * height;
  pen.fillStyle = getComputedStyle(canvas).color;
  pen.font = `${11 * scale}px system-ui`;
  pen.fillText(high.toFixed(1), 2, 11 * scale);
  pen.fillText(low.toFixed(1), 2, height - 3);
  pen.lineWidth = 1.5 * scale;
  for (let joint = 0; joint < 7; joint += 1) {
    pen.strokeStyle = COLOURS[joint];
    pen.beginPath();
    points.forEach(([at, q], index) => {
      const x = width - ((end - at) / PLOT_S) * width;
      if (index) pen.lineTo(x, y(q[joint]));
      else pen.moveTo(x, y(q[joint]));
    });
    pen.stroke();
  }
}

// ------------------------------------------------------------------------------------------------------------- cameras

function look(is) {
  const picture = byId("picture");
  byId("look").textContent = is ? "Hide" : "Show";
  byId("look").setAttribute("aria-pressed", String(is));
  picture.hidden = !is;
  picture.alt = `the robot's camera, view ${byId("view").value}`;
  if (is) picture.src = `/api/video/${byId("view").value}?${Date.now()}`;
  else picture.removeAttribute("src"); // ends the answer: nothing is received for nobody
}

async function seeCameras() {
  const answer = await fetch("/api/video").catch(() => null);
  if (!answer || !answer.ok) return;
  const seen = await answer.json();
  const list = byId("view");
  if (!list.options.length) for (const view of seen.views) element("option", view, list);
  byId("video").hidden = !seen.views.length;
  const age = seen.age_s === null ? "no picture yet" : `${(seen.age_s * 1000).toFixed(0)} ms old, ${seen.rate_hz.toFixed(0)} a second`;
  byId("seen").textContent = seen.is_receiving ? [age, ...seen.why].join("; ") : "";
}

byId("look").addEventListener("click", () => look(byId("picture").hidden));
byId("view").addEventListener("change", () => { if (!byId("picture").hidden) look(true); });
setInterval(() => { if (!document.hidden && (byId("video").hidden === false)) seeCameras(); }, 1000);

connect();
seeCameras();
