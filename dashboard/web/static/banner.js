// The strip that is always there: state, depth, heading, what is wrong, what to do, how fresh it all is.
import { $, mark, say } from "./dom.js";
import { MODES, STATES } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { ageText, bytesText, holder, sentence } from "./words.js";

export const STALE_S = 0.5;
const DEG = 180 / Math.PI;
const compass = (radians) => `${(((radians * DEG) % 360 + 360) % 360).toFixed(1)}°`;
const signed = (value, digits) => `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(digits)}`;

export class Banner {
  show(link, store) {
    const { status } = link;
    const age = link.age;
    const stale = !(age <= STALE_S);
    mark(document.body, "stale", stale ? "yes" : "no");
    const supervisor = status?.supervisor;
    const state = supervisor?.state ?? "NONE";
    const lost = !stale && supervisor.conditions.includes("LINK_LOST");
    mark($("banner"), "state", state);
    mark($("banner"), "lost", lost ? "yes" : "no");
    const name = state.replace("_", " ");
    const mode = MODES[status?.mode] ?? (Number.isFinite(status?.mode) ? `mode ${status.mode}` : "");
    say($("state"), stale ? "NO DATA" : lost ? "LINK LOST" : name);
    const has = stale || lost ? "" : holder(state, { ...status, mode });
    say($("meaning"), stale ? (supervisor ? `was ${name}` : "") : lost ? `to the vehicle; ${name}` : has || STATES[state] || "");
    tile("depth", store, ["depth_m", "depth_desired_m", "z.engaged", "z.e"], (metres) => `${metres.toFixed(2)} m`, (e) => `${signed(1e3 * e, 0)} mm`);
    tile("heading", store, ["heading_rad", "heading_desired_rad", "psi.engaged", "psi.e"], compass, (e) => `${signed(DEG * e, 1)}°`);
    const [reason, advice] = stale ? silence(link, age) : [supervisor.reason, sentence(supervisor.remedy ?? "")];
    say($("reason"), reason);
    say($("advice"), advice);
    say($("fact-mode"), mode || "–");
    fact("fact-armed", status?.armed === true ? "ARMED" : status?.armed === false ? "disarmed" : "–", status?.armed ? "strong" : "");
    const linkAge = status?.loop ? status.loop.link_age_s + (stale ? age : 0) : Infinity;
    fact("fact-link", linkAge > 1e5 ? "never" : ageText(linkAge), linkAge > 1 ? "bad" : "");
    fact("fact-age", stale ? `STALE ${ageText(age)}` : ageText(age), stale ? "bad" : "");
    const volts = store?.value("voltage_v");
    say($("fact-battery"), Number.isFinite(volts) ? `${volts.toFixed(1)} V` : "–");
    const recorder = status?.recorder;
    const text = !recorder ? "off" : recorder.recording ? `REC ${bytesText(recorder.size_bytes)}` : recorder.said || "stopped";
    fact("fact-recording", text, recorder?.recording ? (recorder.dropped + recorder.lost ? "warn" : "rec") : recorder ? "warn" : "");
    const missing = recorder?.lost || recorder?.dropped ? `, ${recorder.lost} samples lost on the way, ${recorder.dropped} at the disk` : "";
    $("fact-recording").title = recorder ? `${recorder.said} ${recorder.file}${missing}` : "no recorder is heard: holdfast record";
    say($("record"), recorder?.recording ? "■ Stop recording" : "● Record");
  }
}

// What is, large; what should be, and by how much it is missed, below.
function tile(name, store, columns, place, error) {
  const [is, wanted, engaged, e] = columns.map((column) => store?.value(column) ?? NaN);
  say($(`${name}-is`), Number.isFinite(is) ? place(is) : "–");
  say($(`${name}-wanted`), engaged > 0 && Number.isFinite(wanted) ? place(wanted) : "none");
  say($(`${name}-error`), engaged > 0 && Number.isFinite(e) ? error(e) : "");
}

function fact(id, text, level) {
  say($(id), text);
  mark($(id), "level", level);
}

function silence(link, age) {
  const { status } = link;
  if (link.silence > STALE_S) {
    return [`The dashboard's server is silent${Number.isFinite(link.silence) ? ` for ${ageText(link.silence)}` : ""}.`,
      "Look whether `holdfast dashboard` runs, and the network; this page tries again by itself."];
  }
  if (!status?.connected) return [`Nobody listens on ${status?.endpoint ?? "Zenoh"}.`, "Start `holdfast run`, or name the vehicle's endpoint by --connect."];
  if (!status.vehicle) return ["No vehicle is heard.", "Zenoh answers, but no companion publishes: start `holdfast run`."];
  return [`Nothing new of ${status.vehicle} for ${ageText(age)}: what you see is the past.`, "Look whether its companion (`holdfast run`) is alive, and the network."];
}
