// The strip that is always there: state, what is wrong, what to do, how fresh it all is.
import { $, mark, say } from "./dom.js";
import { MODES, STATES } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { ageText, bytesText, sentence } from "./words.js";

export const STALE_S = 0.5;

export class Banner {
  show(link, store) {
    const { status } = link;
    const age = link.age;
    const stale = !(age <= STALE_S);
    mark(document.body, "stale", stale ? "yes" : "no");
    const supervisor = status?.supervisor;
    const state = supervisor?.state ?? "NONE";
    mark($("banner"), "state", state);
    say($("state"), supervisor ? state.replace("_", " ") : "–");
    const meaning = supervisor?.conditions.includes("LINK_LOST") ? "LINK LOST" : STATES[state] ?? "";
    say($("meaning"), stale ? (supervisor ? "was so: this is the past" : "no data") : meaning);
    const [reason, advice] = stale ? silence(link, age) : [supervisor.reason, sentence(supervisor.remedy ?? "")];
    say($("reason"), reason);
    say($("advice"), advice);
    say($("fact-mode"), status?.mode === null || status?.mode === undefined ? "–" : MODES[status.mode] ?? `mode ${status.mode}`);
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
  }
}

function fact(id, text, level) {
  say($(id), text);
  mark($(id), "level", level);
}

function silence(link, age) {
  const { status } = link;
  if (link.silence > STALE_S) {
    return [`The dashboard's server is silent${Number.isFinite(link.silence) ? ` for ${ageText(link.silence)}` : ""}.`,
      "What you see is the past. Is `holdfast dashboard` running, and the network there? Trying again."];
  }
  if (!status?.connected) return [`Nobody listens on ${status?.endpoint ?? "Zenoh"}.`, "Is `holdfast run` up, or is it elsewhere? See --connect."];
  if (!status.vehicle) return ["No vehicle is heard.", "Zenoh answers, but no companion publishes: is `holdfast run` up?"];
  return [`Nothing new of ${status.vehicle} for ${ageText(age)}.`, "What you see is the past. Is its companion (`holdfast run`) alive, and the network there?"];
}
