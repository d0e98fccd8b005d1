// What numbers and names mean to people.
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

export function bytesText(bytes) {
  return bytes > 2e9 ? `${(bytes / 1e9).toFixed(1)} GB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
