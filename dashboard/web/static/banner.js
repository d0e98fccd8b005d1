// The strip at the top: state, depth, heading, faults, what to do, and the age of the data.
import { $, mark, prose, say } from "./dom.js";
import { MODES, WORDS } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { ageText, bytesText, durationText, sentence } from "./words.js";

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
    say($("state"), stale ? WORDS.NO_DATA : lost ? WORDS.LINK_LOST : name);
    say($("meaning"), stale ? (supervisor ? `was ${name}` : "") : lost ? name : status.holder);
    tile("depth", store, ["depth_m", "depth_desired_m", "z.engaged", "z.e"], (metres) => `${metres.toFixed(2).replace(/^-0.00$/, "0.00")} m`, (e) => `${signed(1e3 * e, 0)} mm`);
    const offset = store?.value("depth_offset_m") ?? 0;
    say($("depth-name"), Math.abs(offset) >= 0.01 ? `Depth (autopilot ${signed(offset, 2)} m)` : "Depth");
    tile("heading", store, ["heading_rad", "heading_desired_rad", "psi.engaged", "psi.e"], compass, (e) => `${signed(DEG * e, 1)}°`);
    const [reason, advice] = stale ? silence(link) : [supervisor.reason, [status.advice, status.pending].filter(Boolean).map(sentence).join(" ")];
    prose($("reason"), reason);
    mark($("reason"), "long", reason.length > 90 ? "yes" : "no");
    prose($("advice"), advice);
    const was = stale ? "was " : "";
    say($("fact-mode"), mode ? was + mode : "–");
    const armed = status?.armed;
    fact("fact-armed", armed === true ? `${was}ARMED` : armed === false ? `${was}disarmed` : "–", armed && !stale ? "strong" : "");
    const linkAge = status?.loop ? status.loop.link_age_s + (stale ? age : 0) : Infinity;
    fact("fact-link", linkAge > 1e5 ? "never" : ageText(linkAge), linkAge > 1 ? "bad" : "");
    fact("fact-age", stale ? `STALE ${ageText(age)}` : ageText(age), stale ? "bad" : "");
    const volts = store?.value("voltage_v");
    say($("fact-battery"), Number.isFinite(volts) ? `${volts.toFixed(1)} V` : "–");
    say($("fact-deepest"), status?.loop?.deepest_m > 0 ? `${status.loop.deepest_m.toFixed(1)} m` : "–");
    say($("fact-dive"), status?.loop?.dive_s > 0 ? durationText(status.loop.dive_s) : "–");
    const recorder = status?.recorder;
    const text = !recorder ? "off" : recorder.recording ? `REC ${bytesText(recorder.size_bytes)}` : recorder.said || "stopped";
    fact("fact-recording", text, recorder?.recording ? (recorder.dropped + recorder.lost ? "warn" : "rec") : recorder ? "warn" : "");
    const missing = recorder?.lost || recorder?.dropped ? `, ${recorder.lost} samples lost on the way, ${recorder.dropped} at the disk` : "";
    $("fact-recording").title = recorder ? `${recorder.said} ${recorder.file}${missing}` : "";
  }
}

// The measured value, large; reference and error below.
function tile(name, store, columns, place, error) {
  const [is, wanted, engaged, e] = columns.map((column) => store?.value(column) ?? NaN);
  say($(`${name}-is`), Number.isFinite(is) ? place(is) : "–");
  say($(`${name}-held`), engaged > 0 ? "should be" : "not held");
  say($(`${name}-wanted`), engaged > 0 && Number.isFinite(wanted) ? place(wanted) : "");
  say($(`${name}-error`), engaged > 0 && Number.isFinite(e) ? error(e) : "");
}

function fact(id, text, level) {
  say($(id), text);
  mark($(id), "level", level);
}

// No age in it: a screen reader would read it again and again.
function silence(link) {
  if (link.silence > STALE_S) return WORDS.SERVER_SILENT;
  if (link.late > STALE_S) return WORDS.LATE;
  return link.status?.silence ?? ["", ""];
}
