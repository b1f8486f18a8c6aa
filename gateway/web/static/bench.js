// Beside the state: episodes of the recording that goes on, recordings on the disk, and the check of the robot.
"use strict";

let bagNow = "";

watchers.push(({ recording }) => {
  bagNow = recording ? recording.bag : "";
  const said = !recording ? "Nobody records here: ta2 record"
    : !recording.episode ? "Recording; no episode yet"
    : `Recording; episode ${recording.episode} ${recording.is_running ? "goes on" : "has ended"}${recording.task ? `: ${recording.task}` : ""}`;
  const line = byId("recording");
  if (line.textContent !== said) line.textContent = said;
  line.classList.toggle("live", Boolean(recording && recording.is_running));
  byId("bag").textContent = bagNow;
  byId("episode").hidden = !recording;
});

for (const one of document.querySelectorAll("[data-episode]")) {
  one.addEventListener("click", () => {
    ask({ do: "episode", event: one.dataset.episode, text: byId("words").value.trim() });
    if (one.dataset.episode !== "start") byId("words").value = ""; // a task is often shown again
  });
}

function fill(table, rows) {
  const body = table.tBodies[0];
  body.replaceChildren();
  table.hidden = !rows.length;
  for (const [kind, ...cells] of rows) {
    const row = body.insertRow();
    row.className = kind;
    cells.forEach((text, column) => {
      const cell = element(column ? "td" : "th", text, row);
      if (!column) cell.scope = "row";
    });
  }
}

// What a command of its own finds out: it is begun, and looked for until it has ended. No connection waits for it.
function job(name, show) {
  const run = byId(`${name}-run`);
  const line = byId(`${name}-line`);
  async function look(method) {
    const answer = await fetch(`/api/${name}`, { method }).catch(() => null);
    const seen = answer && answer.ok ? await answer.json() : { error: answer ? "" : "the page's server does not answer" };
    run.disabled = Boolean(seen.is_running);
    line.textContent = seen.is_running ? "looking …" : seen.error || (seen.report ? show(seen.report) : "");
    if (seen.is_running) setTimeout(() => look("GET"), 1000);
  }
  run.addEventListener("click", () => look("POST"));
  look("GET");
}

const when = (ns) => (ns ? new Date(ns / 1e6).toLocaleString() : "–");

job("recordings", ({ count, bags }) => {
  fill(byId("recordings"), bags.map((bag) => {
    const told = bag.episodes || [];
    const counted = ["success", "failure"].map((outcome) => [told.filter((one) => one.outcome === outcome && !one.is_discarded).length, outcome]);
    counted.push([told.filter((one) => one.is_discarded).length, "discarded"], [told.filter((one) => !one.is_finished).length, "unfinished"]);
    const outcomes = counted.filter(([many]) => many).map(([many, word]) => `${many} ${word}`).join(", ");
    const size = bag.problem ? ["–", "–"] : [`${bag.duration_s.toFixed(0)} s`, `${(bag.size_bytes / 1e6).toFixed(1)} MB`];
    return [bag.problem && bag.bag !== bagNow ? "warning" : "", bag.bag.split("/").at(-1), when(bag.begin_ns), ...size, String(told.length), bag.bag === bagNow ? "is being recorded" : bag.problem || outcomes || bag.task];
  }));
  return count ? `${count} in this folder${count > bags.length ? `, the newest ${bags.length} shown` : ""}` : "There are none in this folder.";
});

job("check", ({ ok, at, robot, rows }) => {
  const tried = rows.filter((row) => row.verdict !== "skipped"); // what moves is never tried from here
  const order = ["fail", "unknown", "pass"];
  tried.sort((a, b) => order.indexOf(a.verdict) - order.indexOf(b.verdict));
  fill(byId("check"), tried.map((row) => {
    const figure = [row.figure === null ? "" : String(row.figure), row.bound ? `(${row.bound})` : "", row.unit].filter(Boolean).join(" ");
    return [row.verdict, row.verdict, row.title, figure, [row.found, row.remedy && `→ ${row.remedy}`].filter(Boolean).join(" "), row.section];
  }));
  const failed = tried.filter((row) => row.verdict === "fail").length;
  return `${ok ? "Nothing failed" : `${failed} failed`} of ${tried.length}; ${robot}, ${new Date(at).toLocaleString()}. What moves is checked by ta2 check alone.`;
});
