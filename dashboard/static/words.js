// What numbers and names mean to people.

export const MODES = { 0: "STABILIZE", 1: "ACRO", 2: "ALT HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE", 16: "POSHOLD", 19: "MANUAL", 20: "MOTOR DETECT", 21: "SURFTRAK" };

export const STATES = {
  IDLE: "hands off",
  READY: "may engage",
  ACTIVE: "holding",
  RAMP_DOWN: "letting go",
  PILOT: "the pilot steers",
  FAULT: "latched",
};

export const DOFS = {
  z: { name: "Depth", key: "1", axis: "heave", force: "N", e: { unit: "mm", scale: 1e3, span: 6 }, rate: { unit: "mm/s", scale: 1e3, span: 10 } },
  psi: { name: "Heading", key: "2", axis: "yaw", force: "N·m", e: { unit: "°", scale: 180 / Math.PI, span: 1 }, rate: { unit: "°/s", scale: 180 / Math.PI, span: 2 } },
  x: { name: "North", key: "3", axis: "surge", force: "N", e: { unit: "mm", scale: 1e3, span: 20 }, rate: { unit: "mm/s", scale: 1e3, span: 20 } },
  y: { name: "East", key: "4", axis: "sway", force: "N", e: { unit: "mm", scale: 1e3, span: 20 }, rate: { unit: "mm/s", scale: 1e3, span: 20 } },
};

// What is wrong in words, and what to do. Names that are not here are shown as they are.
const CONDITIONS = {
  LINK_LOST: ["the vehicle is silent", "check tether, power and link.endpoint"],
  DEPTH_STALE: ["no fresh depth", "check the depth sensor and the message rates"],
  ATTITUDE_STALE: ["no fresh attitude", "check the autopilot's message rates"],
  POSITION_STALE: ["no fresh position", "check the DVL; depth and heading can be held without"],
  DISARMED: ["the motors are disarmed", "arm the vehicle"],
  WRONG_MODE: ["the flight mode is another", "switch the vehicle to MANUAL"],
  FAILSAFE_UNSAFE: ["the pilot-input failsafe is off or slow", "set FS_PILOT_INPUT to 1 or 2 and FS_PILOT_TIMEOUT to 3 s or less"],
  NON_FINITE: ["a computed value was not finite", "look at the last events, then clear the fault"],
  TICK_LATE: ["the companion does not keep time", "see what else loads its computer"],
  TILTED: ["it rolled or pitched too far", "level the vehicle; check trim and tether"],
  PILOT_TAKEOVER: ["a stick is moved", "let go of the sticks"],
  OPERATOR_STOP: ["the operator stopped it", ""],
  ENGAGE_ASKED: ["asked to engage", ""],
};

const plain = (name) => name.toLowerCase().replaceAll("_", " ");

function remedies(conditions) {
  const known = conditions.filter((name) => CONDITIONS[name]?.[1]);
  const words = known.map((name) => `${CONDITIONS[name][0]}: ${CONDITIONS[name][1]}`);
  const strange = conditions.filter((name) => !CONDITIONS[name] && !["CLEAR_ASKED", "RAMPED_DOWN"].includes(name)).map(plain);
  return [...words, ...strange].join("; ");
}

// The reason and what to do about it, for the supervisor's message.
export function explain({ state, conditions, reason }) {
  const todo = remedies(conditions.filter((name) => name !== "POSITION_STALE" || state === "FAULT" || reason.includes("position")));
  switch (state) {
    case "ACTIVE":
      return [reason, "A stick, a mode change or disarming takes it back at once."];
    case "READY":
      return [reason, "Engage: `holdfast tell VEHICLE engage`, or Tune."];
    case "RAMP_DOWN":
      return [reason, todo || "The command fades to neutral."];
    case "PILOT":
      return [reason, todo || "Engage again when the sticks are at rest and the mode is MANUAL."];
    case "FAULT":
      return [reason, `${todo ? `${sentence(todo)} ` : ""}Then clear the fault: \`holdfast tell VEHICLE clear_fault\`, or Tune.`];
    default:
      return [reason, todo ? sentence(todo) : "Not engaged: the pilot steers."];
  }
}

export const sentence = (text) => (text ? `${text[0].toUpperCase()}${text.slice(1)}${text.endsWith(".") ? "" : "."}` : "");

export function ageText(seconds) {
  if (!Number.isFinite(seconds)) return "never";
  if (seconds < 0.0995) return `${Math.round(seconds * 1e3)} ms`;
  if (seconds < 99.5) return `${seconds.toFixed(1)} s`;
  return `${Math.round(seconds / 60)} min`;
}

export function bytesText(bytes) {
  return bytes > 2e9 ? `${(bytes / 1e9).toFixed(1)} GB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
