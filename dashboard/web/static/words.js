// Numbers and names in words.
export const DOFS = {
  z: { name: "Depth", key: "1", axis: "heave", force: "N", e: { unit: "mm", scale: 1e3, span: 6 }, rate: { unit: "mm/s", scale: 1e3, span: 10 } },
  psi: { name: "Heading", key: "2", axis: "yaw", force: "N·m", e: { unit: "°", scale: 180 / Math.PI, span: 1 }, rate: { unit: "°/s", scale: 180 / Math.PI, span: 2 } },
  x: { name: "North", key: "3", axis: "surge", force: "N", e: { unit: "mm", scale: 1e3, span: 20 }, rate: { unit: "mm/s", scale: 1e3, span: 20 } },
  y: { name: "East", key: "4", axis: "sway", force: "N", e: { unit: "mm", scale: 1e3, span: 20 }, rate: { unit: "mm/s", scale: 1e3, span: 20 } },
};

export const sentence = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}${text.endsWith(".") ? "" : "."}` : "");

export function ageText(seconds) {
  if (!Number.isFinite(seconds)) return "never";
  if (seconds < 0.0995) return `${Math.round(seconds * 1e3)} ms`;
  if (seconds < 99.5) return `${seconds.toFixed(1)} s`;
  return `${Math.round(seconds / 60)} min`;
}

// What is left of a path or a move; null where it has no end.
export function leftText({ path_left_m: metres, path_left_s: seconds } = {}) {
  if (metres === null) return "until stopped";
  return metres > 0 || seconds > 0 ? `${metres.toFixed(1)} m, about ${durationText(seconds)} left` : "";
}

export function durationText(seconds) {
  if (seconds < 99.5) return `${Math.round(seconds)} s`;
  const minutes = Math.round(seconds / 60);
  return minutes < 100 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${String(minutes % 60).padStart(2, "0")} min`;
}

export function bytesText(bytes) {
  return bytes > 2e9 ? `${(bytes / 1e9).toFixed(1)} GB` : `${(bytes / 1e6).toFixed(1)} MB`;
}

const AGAIN_S = 60;
const OVER = "over: "; // begins the text of a condition's end in recordings of older versions

// Events as rows, newest first. Repeats within a minute share a row; so do a condition and its end.
// `ended` maps the words of a condition's end to those of its beginning.
export function collapsed(events, states, ended) {
  const rows = [];
  const newest = new Map();
  for (const { t_s: t, severity, kind, text } of events) {
    const over = kind === "condition" && (text in ended || text.startsWith(OVER));
    const what = over ? ended[text] ?? text.slice(OVER.length) : text;
    const key = `${kind} ${what}`;
    const row = newest.get(key);
    if (over && row) row.until = t;
    else if (!over && row && t - (row.until ?? row.t) < AGAIN_S) Object.assign(row, { t, until: undefined, count: row.count + 1 });
    else {
      const name = kind === "state" ? what.split(":")[0] : "";
      const words = over ? text : states[name] ? states[name] + what.slice(name.length) : what;
      const fresh = { t, severity, kind, words: words[0].toUpperCase() + words.slice(1), count: 1, until: undefined };
      rows.push(fresh);
      newest.set(key, fresh);
    }
  }
  return rows.reverse().sort((one, other) => other.t - one.t); // those of one time too
}

export function rowText({ words, count, t, until }) {
  const times = count > 1 ? `${count} times` : "";
  const long = until !== undefined ? `${count > 1 ? "the last " : ""}for ${ageText(Math.max(0.1, until - t))}` : "";
  return [words, [times, long].filter(Boolean).join(", ")].filter(Boolean).join(" · ");
}
