"use strict";
// The page of the fleet: shows each state that comes, and asks for what is confirmed.

const NAMES = {
  arm: "Arm", takeoff: "Take off", start: "Start: hand over to the companions", hold: "Hold",
  resume: "Resume the mission", goals: "New goals", return: "Return", land: "Land",
};
const SILENT = 2000;  // ms without a state, after which this page says that it is blind
const SAID = 300;  // lines that are kept
const $ = id => document.getElementById(id);
const map = new FleetMap($("map"));
const cards = new Map();
const picked = new Set();
let socket, heardAt = 0, drones = [], goalsOf = "", count = 0;

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/fleet`);
  socket.onmessage = event => take(JSON.parse(event.data));
  socket.onclose = () => { offline(true); setTimeout(connect, 1000); };
}

function take(told) {
  if (told.trails) map.start(told.trails);
  if (told.notes) $("notes").replaceChildren(...told.notes.map(n => element("li", n)));
  if (told.problem) say("page", told.problem, true);
  if (told.logs) showLogs(told.logs);
  if (told.state) {
    heardAt = performance.now();
    offline(false);
    show(told.state);
  }
  for (const [name, words] of Object.entries(told.words ?? {}))
    for (const w of words) say(`${name} ${w.who}`, w.text, w.bad);
  for (const r of told.results ?? []) showResult(r);
}

function offline(is) { $("offline").hidden = !is; document.body.classList.toggle("offline", is); buttons(); }

function show(state) {
  drones = state.drones;
  document.body.dataset.states = ++count;
  for (const d of drones) card(d);
  map.draw(drones);
  const lost = drones.filter(d => d.lost).length, armed = drones.filter(d => d.armed && !d.lost).length;
  const passive = drones.filter(d => d.companion.phase === "passive").length;
  const strange = state.strangers.length ? `, unknown systems: ${state.strangers.join(", ")}` : "";
  text($("summary"), `${drones.length - lost} of ${drones.length} heard, ${armed} armed, ${passive} passive${strange}`);
}

function card(d) {
  let c = cards.get(d.name);
  if (!c) {
    c = $("card").content.firstElementChild.cloneNode(true);
    c.dataset.drone = d.name;
    text(c.querySelector(".name"), d.name);
    text(c.querySelector(".kind"), `${d.kind}, system ${d.system}`);
    const box = c.querySelector(".pick");
    box.addEventListener("change", () => { box.checked ? picked.add(d.name) : picked.delete(d.name); chosen(); });
    cards.set(d.name, c);
    $("drones").append(c);
    chosen();
  }
  const m = d.companion, set = (name, value, mark = "") => {
    const e = c.querySelector(`.${name}`);
    text(e, value ?? "–");
    for (const k of ["good", "warn", "bad"]) e.classList.toggle(k, k === mark);
  };
  set("link", d.heard === null ? "never heard" : d.lost ? `lost, ${d.heard.toFixed(0)} s` : "heard",
      d.lost ? "bad" : "good");
  set("armed", d.armed === null ? "–" : d.armed ? "armed" : "disarmed");
  set("mode", d.mode || "–");
  set("busy", d.busy ? `${d.busy} …` : "");
  const silent = m.heard !== null && m.lost ? `silent, ${m.heard.toFixed(0)} s` : m.lost ? "not heard" : "";
  const phase = silent || m.phase || "–";
  set("phase", phase, m.lost && m.heard !== null || phase === "passive" ? "bad" : phase === "fly" ? "good" : "warn");
  const guarding = m.guard && m.guard !== "plan";
  set("guard", m.guard ? `guard: ${m.guard}` : "", guarding ? "bad" : "");
  set("battery", d.battery && `${d.battery[0].toFixed(1)} V, ${(d.battery[1] * 100).toFixed(0)} %`,
      d.battery && d.battery[1] < 0.2 ? "bad" : "");
  set("height", unit(d.height, 1, "m"));
  set("speed", unit(d.speed, 1, "m/s"));
  set("camera", m.camera === "none" ? "good" : m.camera, m.camera && m.camera !== "none" ? "bad" : "");
  set("tick", unit(m.tick_ms, 1, "ms"), m.tick_ms > 100 ? "bad" : "");
  set("neighbours", m.neighbours === null ? "–" : m.nearest === null ? `${m.neighbours}` : `${m.neighbours}, ${m.nearest.toFixed(1)} m`);
  set("hover", m.hover_doubt === null ? "–" : `±${(m.hover_doubt * 100).toFixed(1)} %`, m.hover_doubt > 0.05 ? "warn" : "");
  set("loss", m.loss === null ? "–" : `${(m.loss * 100).toFixed(0)} %`, m.loss > 0.4 ? "bad" : "");
  set("fix", [d.fix, d.accuracy && `±${d.accuracy[0].toFixed(2)} m`].filter(Boolean).join(", ") || "–");
  set("goal", m.goal === null || m.goal < 0 ? `${d.own_goals.length} set` : `${m.goal + 1} of ${d.own_goals.length}`);
  const bad = d.lost || m.phase === "passive" || guarding || (m.lost && m.heard !== null);
  c.classList.toggle("lost", d.lost);
  c.classList.toggle("bad", Boolean(bad));
  c.classList.toggle("good", !bad && m.phase === "fly");
  c.classList.toggle("warn", !bad && m.phase !== "fly" && d.armed === true);
}

function showResult(r) {
  const line = cards.get(r.drone)?.querySelector(".result");
  if (!line) return;
  text(line, `${r.action}: ${r.result}`);
  line.classList.toggle("good", r.ok);
  line.classList.toggle("bad", !r.ok);
  line.dataset.number = r.number;
}

function showLogs(logs) {
  for (const [name, told] of Object.entries(logs)) say(`${name} page`, `logs: ${told}`, false);
  $("logs").disabled = false;
  $("debrief").hidden = false;
}

function say(who, words, bad) {
  const line = element("li", words), name = element("span", who);
  name.className = "who";
  line.prepend(name);
  if (bad) line.classList.add("bad");
  $("log").prepend(line);
  while ($("log").children.length > SAID) $("log").lastElementChild.remove();
}

function chosen() {
  const n = picked.size;
  text($("chosen"), n === 0 ? "no drone chosen" : n === cards.size ? `all ${n} drones` : [...picked].join(", "));
  $("all").checked = n > 0 && n === cards.size;
  $("all").indeterminate = n > 0 && n < cards.size;
  buttons();
}

function buttons() {
  const blind = !$("offline").hidden;
  for (const b of document.querySelectorAll("#commands button")) b.disabled = blind || picked.size === 0;
  $("logs").disabled = blind;
}

function confirmed(action) {
  const names = [...picked], dialog = $("confirm");
  text($("question"), `${NAMES[action]}?`);
  text($("who"), `${names.length === cards.size && names.length > 1 ? "All drones: " : ""}${names.join(", ")}`);
  text($("goals-problem"), "");
  $("goals-field").hidden = action !== "goals";
  if (action === "goals" && goalsOf !== names.join()) {
    goalsOf = names.join();
    const first = drones.find(d => d.name === names[0]);
    $("goals").value = (first?.own_goals ?? []).map(g => g.join(", ")).join("\n");
  }
  dialog.returnValue = "no";
  dialog.onclose = () => { if (dialog.returnValue === "yes") ask(action, names); };
  dialog.showModal();
  (action === "goals" ? $("goals") : $("yes")).focus();
}

function readGoals() {
  const lines = $("goals").value.split("\n").filter(l => l.trim());
  const goals = lines.map(l => l.trim().split(/[\s,;]+/).map(Number));
  const wrong = goals.findIndex(g => g.length !== 3 || g.some(v => !Number.isFinite(v)));
  if (wrong >= 0) return [null, `line ${wrong + 1}: must be three numbers, got “${lines[wrong].trim()}”`];
  return goals.length ? [goals, ""] : [null, "at least one goal"];
}

function ask(action, names) {
  const request = {do: action, drones: names};
  if (action === "goals") request.goals = readGoals()[0];
  for (const name of names) {
    const line = cards.get(name).querySelector(".result");
    text(line, `${action} …`);
    line.classList.remove("good", "bad");
  }
  socket.send(JSON.stringify(request));
}

function element(tag, words) { const e = document.createElement(tag); e.textContent = words; return e; }
function text(e, words) { if (e.textContent !== words) e.textContent = words; }
function unit(value, digits, name) {
  if (value === null) return "–";
  const shown = value.toFixed(digits);
  return `${Number(shown) === 0 ? shown.replace("-", "") : shown} ${name}`;
}

for (const b of document.querySelectorAll("[data-do]")) b.addEventListener("click", () => confirmed(b.dataset.do));
$("yes").addEventListener("click", event => {
  if ($("goals-field").hidden) return;
  const problem = readGoals()[1];
  text($("goals-problem"), problem);
  if (problem) event.preventDefault();
});
$("all").addEventListener("change", () => {
  for (const [name, c] of cards) {
    c.querySelector(".pick").checked = $("all").checked;
    $("all").checked ? picked.add(name) : picked.delete(name);
  }
  chosen();
});
$("logs").addEventListener("click", () => {
  $("logs").disabled = true;
  const names = picked.size ? [...picked] : [...cards.keys()];
  socket.send(JSON.stringify({do: "logs", drones: names}));
});
setInterval(() => { if (performance.now() - heardAt > SILENT) offline(true); }, 250);
buttons();
connect();
