// For each plot: the columns that it needs, and the lines made of them.
import { places, plainNumber } from "./plots.js";
import { GAP_S } from "./store.js";
import { DOFS } from "./words.js";

const DEG = 180 / Math.PI;
const wrap = (degrees) => degrees - 360 * Math.round(degrees / 360);
const scaled = (values, factor) => values.map((value) => value * factor);
const held = (values, engaged) => values.map((value, i) => (engaged[i] > 0 ? value : NaN));
const of = (dof, ...names) => names.map((name) => `${dof}.${name}`);

// Unwrap the angle: a line without jumps.
function unwrapped(radians) {
  let turns = 0;
  let last = NaN;
  return radians.map((value) => {
    const degrees = value * DEG;
    if (degrees - last > 180) turns -= 360;
    if (degrees - last < -180) turns += 360;
    if (Number.isFinite(degrees)) last = degrees;
    return degrees + turns;
  });
}

const compass = (value, step) => (((value % 360) + 360) % 360).toFixed(step ? places(step) : 1);

// The greatest of the last `seconds` before each point; NaN where there is no value.
function trailing(values, x, seconds) {
  const queue = [];
  return values.map((value, i) => {
    const size = Math.abs(value);
    if (!Number.isFinite(size)) return NaN;
    while (queue.length && queue.at(-1)[1] <= size) queue.pop();
    queue.push([x[i], size]);
    while (queue[0][0] < x[i] - seconds) queue.shift();
    return queue[0][1];
  });
}

const PROVED = ["eps", "d_observer", "saturated", "lambda_per_s", "engaged"];
const AS_CONFIGURED = 0.99; // of lambda: below, delay or a limit cycle has reduced the gains

// What docs/theory.md, section 3, proves: |eps| <= (d_max + D)/(m kappa), here for a disturbance D up to d_max.
// NaN where an assumption does not hold, and until its effect has decayed.
export function proved(x, [, disturbance, saturated, inForce, engaged], axis) {
  if (!axis) return x.map(() => NaN);
  const { mass, kappa_per_s: kappa, lambda_per_s: lambda, max_disturbance: most } = axis;
  let since = x[0];
  return x.map((t, i) => {
    const gap = i > 0 && t - x[i - 1] > GAP_S;
    const holds = engaged[i] > 0 && !(saturated[i] > 0) && Math.abs(disturbance[i]) <= most && !(inForce[i] < AS_CONFIGURED * lambda);
    if (gap || (!holds && Number.isFinite(engaged[i]))) since = t;
    return holds && t - since > 3 / kappa + 3 / lambda ? (2 * most) / (mass * kappa) : NaN;
  });
}

const TURNS = [0.1, 0.2, 0.5, 1, 2, 5, 15, 45, 90, 180, 360]; // between ticks of a heading, degrees

const place = (dof) => (dof === "psi" ? "z" : dof);
const PLACES = { z: ["depth_m", "depth_desired_m"], x: ["x_m", "x_desired_m"], y: ["y_m", "y_desired_m"] };
const TURN = { x: (c, s, surge, sway) => c * surge - s * sway, y: (c, s, surge, sway) => s * surge + c * sway };

export const PLOTS = [
  {
    name: "depth", title: "Depth", downward: true,
    heading: (dof) => DOFS[place(dof)].name,
    series: [{ label: "should be", colour: "wanted", dash: [6, 4] }, { label: "is", colour: "measured", width: 2 }],
    columns: (dof) => [...PLACES[place(dof)], `${place(dof)}.engaged`],
    make: ([is, wanted, engaged]) => ({ lines: [held(wanted, engaged), is] }),
    span: () => 0.05, read: (value) => value.toFixed(3), unit: () => "m",
    source: (dof) => (place(dof) === "z" ? "depth_age_s" : "position_age_s"),
  },
  {
    name: "heading", title: "Heading",
    series: [{ label: "should be", colour: "wanted", dash: [6, 4] }, { label: "is", colour: "measured", width: 2 }],
    columns: () => ["heading_rad", "heading_desired_rad", "psi.engaged"],
    make: ([is, wanted, engaged]) => {
      const line = unwrapped(is);
      return { lines: [held(line.map((value, i) => value + wrap(wanted[i] * DEG - value)), engaged), line] };
    },
    span: () => 4, incrs: TURNS, format: compass, unit: () => "°", source: () => "attitude_age_s",
  },
  {
    name: "error", title: "Error", held: true,
    heading: (dof) => `${DOFS[dof].name} error`,
    series: [
      { label: "e", colour: "measured", width: 2 },
      { label: "within ±", colour: "band", drawn: true, soft: true }, { colour: "band", soft: true },
      { label: "proved ±", colour: "wanted", dash: [3, 5], width: 1, unscaled: true, drawn: true }, { colour: "wanted", dash: [3, 5], width: 1, unscaled: true },
    ],
    bands: [[2, 3]],
    columns: (dof) => of(dof, "e", ...PROVED),
    make: ([e, ...law], dof, { x, lambda, config }) => {
      const { scale } = DOFS[dof].e;
      const axis = config?.[DOFS[dof].axis];
      const [eps, inForce, engaged] = [law[0], law[3], law.at(-1)];
      const allowed = held(eps, engaged).map((value, i) => value / (inForce[i] || lambda)); // of e, at rest
      const bound = scaled(trailing(allowed, x, 5 / lambda), scale);
      const line = scaled(proved(x, law, axis), scale / axis?.lambda_per_s);
      return { lines: [scaled(held(e, engaged), scale), bound, scaled(bound, -1), line, scaled(line, -1)] };
    },
    span: (dof) => DOFS[dof].e.span, unit: (dof) => DOFS[dof].e.unit,
  },
  {
    name: "eps", title: "Combined error ε = ė + λe", held: true,
    series: [
      { label: "ε", colour: "feedback" },
      { label: "proved ±", colour: "wanted", dash: [3, 5], width: 1, unscaled: true, drawn: true }, { colour: "wanted", dash: [3, 5], width: 1, unscaled: true },
    ],
    columns: (dof) => of(dof, ...PROVED),
    make: (law, dof, { x, config }) => {
      const { scale } = DOFS[dof].rate;
      const line = scaled(proved(x, law, config?.[DOFS[dof].axis]), scale);
      return { lines: [scaled(held(law[0], law.at(-1)), scale), line, scaled(line, -1)] };
    },
    span: (dof) => DOFS[dof].rate.span, unit: (dof) => DOFS[dof].rate.unit,
    note: (dof, { lambda }) => `${DOFS[dof].rate.unit}${Number.isFinite(lambda) ? ` · λ ${lambda.toFixed(2)}/s` : ""}`,
  },
  {
    name: "thrust", title: "Thrust", held: true,
    heading: (dof) => `Thrust, ${{ z: "down", psi: "clockwise", x: "north", y: "east" }[dof]}`,
    series: [
      { label: "model", colour: "model" }, { label: "feedback", colour: "feedback" }, { label: "learnt", colour: "learnt" },
      { label: "given", colour: "given", width: 3 }, { label: "asked", colour: "measured" },
    ],
    columns: (dof) => [
      ...of(dof, "feedforward", "feedback", "d_hat", "tau", "saturated", "engaged"), "heading_rad",
      ...{ z: ["heave_delivered_n"], psi: ["yaw_delivered_nm"] }[dof] ?? ["surge_delivered_n", "sway_delivered_n"],
    ],
    make: ([model, feedback, learnt, asked, saturated, engaged, heading, first, second], dof) => {
      const given = TURN[dof] ? first.map((surge, i) => TURN[dof](Math.cos(heading[i]), Math.sin(heading[i]), surge, second[i])) : first;
      return {
        lines: [model, feedback, learnt, given, asked].map((line) => held(line, engaged)),
        shades: [{ flags: saturated, colour: "saturated" }],
      };
    },
    span: (dof) => (dof === "psi" ? 1 : 8), unit: (dof) => DOFS[dof].force,
  },
  {
    name: "disturbance", title: "Disturbance d", held: true,
    series: [
      { label: "true", colour: "truth" }, { label: "observer", colour: "model", width: 1 }, { label: "learnt", colour: "learnt", width: 2 },
    ],
    columns: (dof) => [...of(dof, "d_hat", "d_observer", "engaged"), `true.${dof}.d`],
    make: ([learnt, observer, engaged, truth]) => ({ lines: [truth, held(observer, engaged), held(learnt, engaged)] }),
    span: (dof) => (dof === "psi" ? 1 : 8), unit: (dof) => DOFS[dof].force,
  },
  {
    name: "weights", title: "Weight norm", held: true, fromZero: true,
    series: [{ label: "‖W‖", colour: "learnt", width: 2 }],
    columns: (dof) => of(dof, "weight_norm", "adapting", "engaged"),
    make: ([norm, adapting, engaged]) => ({ lines: [held(norm, engaged)], shades: [{ flags: adapting, colour: "adapting" }] }),
    span: () => 1, read: (value) => value.toFixed(2),
    note: (dof, { store, config }) => {
      const kind = config?.[DOFS[dof].axis]?.compensator;
      return `${store.value(`${dof}.adapting`) > 0 ? "learning" : "not learning"}${kind ? ` · ${kind}` : ""}`;
    },
  },
  {
    name: "loop", title: "Loop", fromZero: true,
    series: [{ label: "late", colour: "measured" }, { label: "computing", colour: "model", width: 1 }],
    columns: () => ["lateness_ms", "compute_us"],
    make: ([late, compute]) => ({ lines: [late, scaled(compute, 1e-3)] }),
    span: () => 1, read: (value) => value.toFixed(2),
    note: (_, { status }) => (status?.loop ? `ms · ${status.loop.rate_hz.toFixed(1)} Hz · ${status.loop.late_ticks} ticks left out` : "ms"),
  },
  {
    name: "battery", title: "Battery",
    series: [{ label: "", colour: "measured" }],
    columns: () => ["voltage_v"],
    make: ([volts]) => ({ lines: [volts] }),
    span: () => 0.6,
    note: (_, { store }) => (Number.isFinite(store.value("voltage_v")) ? `${store.value("voltage_v").toFixed(2)} V` : "unknown"),
    format: plainNumber,
  },
];
