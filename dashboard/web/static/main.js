// The page: stores what arrives, draws it, and handles the keys.
import { Alarm } from "./alarm.js";
import { Banner, STALE_S } from "./banner.js";
import { Commands } from "./commands.js";
import { $, colours, el, mark, readColours, say } from "./dom.js";
import { Events, Model } from "./events.js";
import { Ages, Attitude, Phase } from "./instruments.js";
import { Link } from "./link.js";
import { FromAbove } from "./map.js";
import { PLOTS } from "./panels.js";
import { Plot } from "./plots.js";
import { csv, png, save } from "./save.js";
import { Store } from "./store.js";
import { Tuning } from "./tuning.js";
import { SPANS, View } from "./view.js";
import { STATES } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { DOFS } from "./words.js";

const READ_MS = 100;
const PILOTS = ["depth", "heading"]; // plots in the place of the map, where no position is known
const solo = location.pathname.match(/^\/panel\/(\w+)/)?.[1] ?? "";
if (solo) document.body.dataset.solo = solo;
const pilots = location.pathname === "/";
document.body.dataset.view = pilots ? "pilot" : "engineer";

const asked = new URLSearchParams(location.search);
const view = new View();
if (DOFS[asked.get("dof")]) view.dof = asked.get("dof");
if (SPANS.includes(Number(asked.get("span")))) view.span = Number(asked.get("span"));
const events = [];
const banner = new Banner();
const count = { frames: 0, rows: 0, firstPlot: null, drawMs: 0 };
let store = null;
let config = null;
let plan = null;
let panels = [];
let dirty = true;
let wall = 0; // the wall clock less the data's clock, s

const link = new Link({
  hello(hello) {
    if (!store) {
      store = new Store(hello.columns);
      build();
    } else if (hello.columns.join() !== store.columns.join()) location.reload();
    commands.hello(hello);
  },
  rows(buffer) {
    const { epoch } = store;
    if (!store.take(buffer)) return;
    if (epoch !== -1 && epoch !== store.epoch) forget();
    count.rows++;
    dirty = true;
  },
  events(fresh) {
    const newest = events.at(-1)?.t_s ?? -Infinity;
    const seen = new Set(events.slice(-300).map((event) => event.t_s + event.text));
    for (const event of fresh) if (!seen.has(event.t_s + event.text)) events.push(event);
    events.sort((one, other) => one.t_s - other.t_s);
    events.splice(0, events.length - 500);
    if (fresh.length) listed = false;
    if (fresh.some((event) => event.t_s > newest)) dirty = true;
  },
  plan(fresh) {
    plan = fresh;
    for (const panel of panels) if (panel.name === "map") panel.plan = plan;
    dirty = true;
  },
  choices(known) {
    tuning?.choices(known);
  },
  config(fresh) {
    config = fresh;
    tuning?.show(config);
  },
  status(status) {
    if (status.t_s !== null && status.t_s !== undefined && status.age_s !== null) {
      const fresh = Date.now() / 1000 - status.age_s - status.t_s;
      if (Math.abs(fresh - wall) > 1) listed = false;
      wall = Math.abs(fresh - wall) > 1 ? fresh : Math.min(fresh, wall + 1e-3);
    }
    vehicles(status);
    commands.take(status);
    nothing(status);
  },
}, asked.get("vehicle") ?? "");
const commands = new Commands(link);
commands.place = place;
const alarm = solo ? null : new Alarm();
const tuning = solo || pilots ? null : new Tuning(view, commands);
let listed = false;

function forget() {
  events.length = 0;
  plan = null;
  for (const panel of panels) if (panel.name === "map") panel.plan = null;
  listed = false;
  view.live();
}

function build() {
  readColours();
  const rail = document.querySelector(".rail");
  const plots = document.querySelector(".plots");
  const all = [
    ...PLOTS.map((definition) => [definition.name, plots, () => new Plot(definition, view, store, events)]),
    ["attitude", rail, () => new Attitude(view, store)],
    ["map", rail, () => new FromAbove(view, store, solo)],
    ["events", rail, () => new Events(view, store, events)],
    ["phase", plots, () => new Phase(view, store)],
    ["model", plots, () => new Model(commands)],
    ["ages", plots, () => new Ages(view, store)],
  ].filter(([name, place]) => (solo ? name === solo : !pilots || place === rail || PILOTS.includes(name)));
  for (const [name, place, make] of all) {
    const panel = make();
    panel.name = name;
    (solo ? plots : pilots ? rail : place).append(panel.node);
    panels.push(panel);
  }
  for (const panel of panels) panel.start?.();
}

// λ in force; the configured one where nothing is held.
function slope() {
  const inForce = store.value(`${view.dof}.lambda_per_s`);
  return inForce > 0 ? inForce : config?.[DOFS[view.dof].axis]?.lambda_per_s ?? NaN;
}

const PLACES = { depth_m: ["z", "depth_desired_m", "depth_m", 1], heading_deg: ["psi", "heading_desired_rad", "heading_rad", 180 / Math.PI] };

// Where it is held, or is.
function place(name) {
  const [dof, desired, measured, scale] = PLACES[name];
  return scale * (store?.value(store.value(`${dof}.engaged`) > 0 ? desired : measured) ?? NaN);
}

let readAt = 0;
let readCursor = null;

function frame(now) {
  requestAnimationFrame(frame);
  if (!store || store.empty) return;
  const context = { store, config, now, status: link.status, lambda: slope(), age: link.age };
  if (dirty) {
    dirty = false;
    count.frames++;
    const begun = performance.now();
    if (!view.paused || !drawn) for (const panel of panels) panel.draw?.(context);
    drawn = view.paused;
    count.drawMs += performance.now() - begun;
    if (count.firstPlot === null) count.firstPlot = performance.now();
  }
  if (now - readAt > READ_MS || view.cursor !== readCursor) {
    readAt = now;
    readCursor = view.cursor;
    for (const panel of panels) panel.read?.(context);
    const at = view.cursor;
    say($("cursor"), at === null ? "" : `${clock(at, 2)}  (${(at - view.head(store.last)).toFixed(2)} s)`);
    for (const panel of panels) if (panel.name === "attitude" || panel.name === "map") panel.draw(context);
    if (!listed && wall) {
      listed = true;
      for (const panel of panels) panel.show?.((t) => clock(t, 0));
    }
  }
}
let drawn = false; // and paused: nothing changes till the view does

function clock(t, digits) {
  const date = new Date((t + wall) * 1000);
  const seconds = (date.getSeconds() + date.getMilliseconds() / 1000).toFixed(digits);
  return `${String(date.getHours()).padStart(2, "0")}:${String(date.getMinutes()).padStart(2, "0")}:${digits ? seconds.padStart(3 + digits, "0") : String(date.getSeconds()).padStart(2, "0")}`;
}

// --- The toolbar and the keys ---

function group(node, items) {
  node.replaceChildren(...items.map(([title, active, act, extra]) => el("button", { "aria-pressed": String(active), onclick: act, ...extra }, title)));
}

const short = (span) => (span < 60 ? `${span} s` : `${span / 60} min`);

function controls() {
  group($("dofs"), Object.entries(DOFS).map(([dof, { name, key }]) => [name, view.dof === dof, () => view.set({ dof }), { title: `key ${key}` }]));
  group($("spans"), SPANS.map((span) => [short(span), view.span === span && !view.zoom, () => view.set({ span, zoom: null })]));
  $("freeze").setAttribute("aria-pressed", String(view.paused));
  say($("freeze"), view.paused ? "Frozen" : "Freeze");
  $("unzoom").hidden = !view.paused && !view.zoom;
}

let known = "";
function vehicles({ vehicles: all, vehicle }) {
  const state = JSON.stringify([all.map(({ name, state: is, age_s: age }) => [name, is, age === null || age > 2]), vehicle]);
  if (state === known) return;
  known = state;
  document.title = vehicle ? `${vehicle} · Holdfast` : "Holdfast";
  group($("vehicles"), all.map(({ name, state: is, age_s: age }) => [name, name === vehicle, () => choose(name),
    { class: "vehicle", "data-state": age === null || age > 2 ? "NONE" : is, title: `${STATES[is] ?? is}; v: the next one` }]));
}

function choose(name) {
  if (name === link.status?.vehicle) return;
  asked.set("vehicle", name);
  history.replaceState(null, "", `?${asked}`);
  address();
  store?.clear();
  if (store) store.epoch = -1;
  config = null;
  link.status = null;
  commands.aimed = null;
  alarm?.forget();
  forget();
  link.choose(name);
}

// The other view, of the same vehicle.
function address() {
  say($("other"), pilots ? "Engineer" : "Pilot");
  $("other").title = pilots ? "the engineer's view: plots and gains" : "the pilot's view";
  $("other").href = (pilots ? "/engineer" : "/") + location.search;
}

function nextVehicle() {
  const all = link.status?.vehicles ?? [];
  if (all.length < 2) return;
  choose(all[(all.findIndex(({ name }) => name === link.status.vehicle) + 1) % all.length].name);
}

function theme() {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  try { localStorage.setItem("holdfast-theme", root.dataset.theme); } catch { /* for this page alone */ }
  repaint();
}

function repaint() {
  readColours();
  for (const panel of panels) panel.uplot?.redraw(false);
  drawn = false;
  dirty = true;
}

// --- No vehicle: what to start ---

const ENDPOINT = "tcp/127.0.0.1:7447";

function nothing({ vehicle, endpoint }) {
  $("empty").hidden = Boolean(vehicle) || Boolean(solo);
  mark(document.body, "empty", vehicle ? "no" : "yes");
  if (vehicle) return;
  const other = (option) => (endpoint === ENDPOINT ? "" : ` ${option}${endpoint}`);
  say($("start-sim"), `holdfast sim${other("--zenoh ")}`);
  say($("start-run"), `holdfast run --engage --arm --depth 2${other("--set telemetry.endpoint=")}`);
  say($("start-look"), `holdfast run${other("--set telemetry.endpoint=")}`);
  say($("start-replay"), `holdfast replay dives/NAME.mcap${other("--connect ")}`);
}

// --- What is seen, as a file ---

function fileName(kind) {
  const at = new Date((view.range(store.last)[1] + wall) * 1000).toISOString().replace(/[-:]|\.\d+/g, "");
  return `${link.status?.vehicle ?? "holdfast"}-${at}.${kind}`;
}

function saveCsv() {
  if (!store?.empty) save(new Blob([csv(store, ...view.range(store.last), wall)], { type: "text/csv" }), fileName("csv"));
}

async function savePng() {
  if (store?.empty) return;
  const [from, to] = view.range(store.last);
  const title = `${link.status?.vehicle ?? ""}   ${clock(from, 0)} – ${clock(to, 0)}   ${DOFS[view.dof].name}`;
  save(await png(title, panels), fileName("png"));
}

const pause = () => view.pause(store?.last ?? NaN);
const KEYS = [
  ["r", "r", "release, when unlocked", () => commands.release()],
  ["Escape", "Esc", "close; back to the present", escape],
  ...(pilots ? [
    ["ArrowUp", "↑", "0.1 m up", () => commands.step("depth_m", -0.1)],
    ["ArrowDown", "↓", "0.1 m down", () => commands.step("depth_m", 0.1)],
    ["ArrowLeft", "←", "5° to the left", () => commands.step("heading_deg", -5)],
    ["ArrowRight", "→", "5° to the right", () => commands.step("heading_deg", 5)],
  ] : []),
  ["v", "v", "next vehicle", nextVehicle],
  ["t", "t", "dark or light", theme],
  ...(pilots ? [] : [
    [" ", "space", "freeze the plots, go on", pause],
    ["+", "+", "shorter time window", () => view.step(-1)],
    ["-", "−", "longer time window", () => view.step(1)],
    ...Object.entries(DOFS).map(([dof, { key, name }]) => [key, key, name.toLowerCase(), () => view.set({ dof })]),
    ["g", "g", "tuning", () => tuning?.toggle()],
  ]),
  ["?", "?", "this help", () => help()],
];

// No dialog is modal: Release stays within reach.
function help() {
  if ($("help").open) $("help").close();
  else $("help").show();
}

function escape() {
  const open = ["help", "goto"].map($).filter((dialog) => dialog.open);
  for (const dialog of open) dialog.close();
  if (!open.length) view.live();
}

$("keys").append(...KEYS.flatMap(([, shown, what]) => [el("dt", {}, el("kbd", {}, shown)), el("dd", {}, what)]));
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key !== "Escape" && event.target.closest?.("input:not([type=radio]), select, textarea")) return;
  const key = KEYS.find(([name]) => name === (event.key === "=" ? "+" : event.key));
  if (!key || (event.key === " " && event.target.closest?.("button"))) return;
  event.preventDefault();
  if (!event.repeat) key[3]();
});
$("freeze").addEventListener("click", pause);
$("unzoom").addEventListener("click", () => view.live());
$("save-png").addEventListener("click", savePng);
$("save-csv").addEventListener("click", saveCsv);
$("theme").addEventListener("click", theme);
$("ask").addEventListener("click", help);
$("tune").addEventListener("click", () => tuning?.toggle());
view.addEventListener("change", () => {
  controls();
  drawn = false;
  dirty = true;
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
new ResizeObserver(() => { drawn = false; dirty = true; }).observe($("board"));
setInterval(() => {
  banner.show(link, store);
  const silent = !(link.age <= STALE_S);
  const { state, reason } = link.status?.supervisor ?? {};
  alarm?.hear(state, reason ?? "", silent);
  commands.hear(silent);
  commands.positioned(Number.isFinite(store?.value("x_m")));
}, 100);
controls();
address();
requestAnimationFrame(frame);

// For measuring and for tests.
globalThis.holdfast = { count, view, link, get store() { return store; }, get events() { return events; }, colours, mark };
