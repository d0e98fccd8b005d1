// A panel with a plot: uPlot, a line of readouts, shades and marks.
import { colours, el, mark, say } from "./dom.js";
import { GAP_S } from "./store.js";
import { ageText } from "./words.js";

const SHRINK = 0.08; // of the surplus, a frame: scales grow at once and shrink gently
const POINTS = 0.45; // a pixel: more costs frames without a graphics card, and shows no more

export class Plot {
  constructor(definition, view, store, events) {
    Object.assign(this, { definition, view, store, events });
    this.shown = true;
    this.values = definition.series.map(() => el("b"));
    this.note = el("small");
    const readouts = definition.series.map((series, index) =>
      el("span", { class: `key ${series.colour}${series.dash ? " dashed" : ""}` }, series.label, this.values[index]));
    readouts.forEach((node, index) => { if (!definition.series[index].label) node.hidden = true; });
    this.title = el("h2", {}, definition.title);
    this.canvas = el("div", { class: "plot" });
    this.node = el("article", { class: "panel", id: `panel-${definition.name}` },
      el("header", {}, this.title, el("span", { class: "readouts" }, ...readouts, this.note)), this.canvas);
  }

  // Called once it is part of the page.
  start() {
    const { definition, view } = this;
    const axis = (extra) => ({
      stroke: () => colours.dim, font: "11px system-ui, sans-serif", ticks: { show: false },
      grid: { stroke: () => colours.line, width: 1 }, ...extra,
    });
    this.uplot = new uPlot({
      width: 300, height: 100, padding: [6, 16, 0, 0], pxAlign: 0,
      legend: { show: false },
      cursor: {
        sync: { key: "holdfast" }, drag: { x: true, y: false, setScale: false }, points: { size: 6 }, dataIdx: (_, __, index) => index,
        bind: { dblclick: () => () => { view.live(); return null; } },
      },
      scales: { x: { time: false }, y: { auto: false, dir: definition.downward ? -1 : 1 } },
      axes: [
        axis({ size: 22, gap: 4, space: 70, values: (_, ticks) => ticks.map(ago) }),
        axis({ size: 50, gap: 4, space: 26, incrs: definition.incrs, values: (_, ticks, __, ___, step) => ticks.map((tick) => (definition.format ?? plainNumber)(tick, step)) }),
      ],
      series: [{}, ...definition.series.map((series) => ({
        stroke: series.colour === "band" ? undefined : () => colours[series.colour], width: series.width ?? 1,
        dash: series.dash, points: { show: false }, pxAlign: 0, spanGaps: false,
      }))],
      bands: definition.bands?.map((pair) => ({ series: pair, fill: () => colours.band })),
      hooks: {
        drawClear: [(u) => this.shade(u)],
        draw: [(u) => this.marks(u)],
        setCursor: [(u) => this.point(u)],
        setSelect: [(u) => this.select(u)],
      },
    }, [[], ...definition.series.map(() => [])], this.canvas);
    new ResizeObserver(() => this.fit()).observe(this.canvas);
    new IntersectionObserver(([entry]) => {
      this.shown = entry.isIntersecting;
      if (this.shown) view.set({}); // drawn even while paused
    }).observe(this.node);
    this.fit();
  }

  fit() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.width = width; // asking the page for it in every frame costs a layout
    if (width && height) this.uplot.setSize({ width, height });
  }

  draw(context) {
    if (!this.shown || !this.uplot) return;
    const { store, view, definition } = this;
    const [from, to] = view.range(store.last);
    const zero = view.head(store.last);
    const window = store.window(definition.columns(view.dof), from, to, zero, Math.max(150, POINTS * this.width));
    const made = definition.make(window.values, view.dof, { ...context, x: window.x });
    this.shades = made.shades ?? [];
    this.x = window.x;
    this.lines = made.lines;
    this.context = context;
    const [least, most] = this.scale(made.lines, window.x, from - zero, to - zero);
    this.bare = !made.lines.some((line) => line.some(Number.isFinite));
    const data = [window.x, ...made.lines.map((line) => broken(line, window.x))];
    this.uplot.batch(() => {
      this.uplot.setData(data, false);
      this.uplot.setScale("x", { min: from - zero, max: to - zero });
      this.uplot.setScale("y", { min: least, max: most });
    });
  }

  scale(lines, x, from, to) {
    let least = Infinity;
    let most = -Infinity;
    let low = Infinity;
    let high = -Infinity;
    lines.forEach((line, index) => {
      const { unscaled, soft } = this.definition.series[index];
      if (unscaled) return;
      if (soft && most > least) { // a band may widen the scale, but not drown the line
        const room = (most - least) * 0.75;
        for (const [i, value] of line.entries()) {
          if (x[i] < from || !Number.isFinite(value)) continue;
          low = Math.max(least - room, Math.min(low, value));
          high = Math.min(most + room, Math.max(high, value));
        }
        return;
      }
      for (let i = 0; i < line.length; i++) {
        if (x[i] < from || x[i] > to) continue;
        const value = line[i];
        if (value < least) least = value;
        if (value > most) most = value;
      }
    });
    least = Math.min(least, low);
    most = Math.max(most, high);
    if (least > most) [least, most] = [0, 0];
    const span = this.definition.span?.(this.view.dof) ?? 1;
    if (this.definition.fromZero) least = Math.min(0, least);
    const missing = Math.max(0, span - (most - least));
    if (this.definition.fromZero) most += missing;
    else [least, most] = [least - missing / 2, most + missing / 2];
    const pad = 0.08 * (most - least);
    most += pad;
    if (!this.definition.fromZero) least -= pad;
    const before = this.limits;
    if (before && this.limitsOf === this.view.dof && Math.abs(before[1] - before[0]) < 50 * (most - least)) {
      least = least < before[0] ? least : before[0] + SHRINK * (least - before[0]);
      most = most > before[1] ? most : before[1] + SHRINK * (most - before[1]);
    }
    this.limitsOf = this.view.dof;
    this.limits = [least, most];
    return this.limits;
  }

  // The numbers in the heading: under the cursor, or the newest.
  read(context) {
    if (!this.shown) return;
    const { store, view, definition } = this;
    if (store.empty) return;
    let index = store.end - 1;
    const at = view.cursor ?? (view.paused ? view.range(store.last)[1] : null);
    if (at !== null) index = Math.min(store.end - 1, store.find(at));
    const row = definition.columns(view.dof).map((name) => [store.value(name, index)]);
    const made = definition.make(row, view.dof, { ...context, x: [0], single: true });
    const format = definition.read ?? definition.format ?? plainNumber;
    made.lines.forEach((line, i) => {
      const value = definition.series[i].drawn ? this.drawn(i, at) : line[0];
      say(this.values[i], Number.isFinite(value) ? format(value, 0) : "–");
    });
    const silent = definition.source && at === null && !made.lines.some(([value]) => Number.isFinite(value));
    const age = silent ? store.value(definition.source(view.dof), index) : NaN;
    mark(this.node, "known", age > GAP_S ? "no" : "yes");
    const free = definition.held && !(store.value(`${view.dof}.engaged`, index) > 0);
    if (age > GAP_S) say(this.note, `nothing new for ${ageText(age)}`);
    else if (free && !this.bare) say(this.note, "not held now");
    else say(this.note, definition.note?.(view.dof, { ...this.context, ...context }) ?? definition.unit?.(view.dof) ?? "");
    if (definition.heading) say(this.title, definition.heading(view.dof));
    mark(this.node, "held", free && this.bare ? "no" : "yes"); // never over curves
  }

  // A value that exists only in the drawn line.
  drawn(index, at) {
    if (!this.lines) return NaN;
    if (at === null) return this.lines[index].at(-1);
    const x = at - this.view.head(this.store.last);
    return this.lines[index][Math.max(0, this.x.findIndex((value) => value >= x))];
  }

  shade(u) {
    const { ctx, bbox } = u;
    if (!this.x?.length) return;
    for (const { flags, colour } of this.shades) {
      ctx.fillStyle = colours[colour];
      for (let i = 0; i < flags.length; i++) {
        if (!(flags[i] > 0)) continue;
        const [from, to, last] = shaded(flags, this.x, i);
        i = last;
        const left = Math.max(bbox.left, u.valToPos(from, "x", true));
        const right = Math.min(bbox.left + bbox.width, u.valToPos(to, "x", true));
        if (right > left - 1) ctx.fillRect(left, bbox.top, Math.max(1, right - left), bbox.height);
      }
    }
  }

  marks(u) {
    const { ctx, bbox } = u;
    const zero = this.view.head(this.store.last);
    const ratio = devicePixelRatio;
    ctx.setLineDash([]);
    for (const event of this.events) {
      const x = u.valToPos(event.t_s - zero, "x", true);
      if (!(x >= bbox.left && x <= bbox.left + bbox.width)) continue;
      ctx.strokeStyle = ctx.fillStyle = colours[event.severity] ?? colours.info;
      ctx.globalAlpha = 0.55;
      ctx.lineWidth = ratio;
      ctx.beginPath();
      ctx.moveTo(x, bbox.top);
      ctx.lineTo(x, bbox.top + bbox.height);
      ctx.stroke();
      ctx.globalAlpha = 1;
      ctx.beginPath();
      ctx.moveTo(x - 4 * ratio, bbox.top);
      ctx.lineTo(x + 4 * ratio, bbox.top);
      ctx.lineTo(x, bbox.top + 5 * ratio);
      ctx.fill();
    }
  }

  point(u) {
    if (!u.cursor.event) return; // another plot's cursor, passed on
    const inside = u.cursor.left >= 0;
    this.view.cursor = inside ? u.posToVal(u.cursor.left, "x") + this.view.head(this.store.last) : null;
  }

  select(u) {
    if (u.select.width < 6) return;
    const zero = this.view.head(this.store.last);
    const from = u.posToVal(u.select.left, "x") + zero;
    const to = u.posToVal(u.select.left + u.select.width, "x") + zero;
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    if (u.cursor.event) this.view.zoomTo(from, to, this.store.last);
  }
}

// The span that a flag at index `i` shades, and the index of its end: the flag is down again, or a gap.
export function shaded(flags, x, i) {
  const from = x[i];
  let to = x[i];
  let last = i;
  for (let k = i + 1; k < flags.length && x[k] - to <= GAP_S; k++) {
    if (Number.isNaN(flags[k])) continue;
    to = x[k];
    if (!(flags[k] > 0)) break;
    last = k;
  }
  return [from, to, last];
}

// For uPlot: null breaks the line, undefined does not. A short gap does not break it.
function broken(line, x) {
  const out = new Array(line.length);
  let missing = 0;
  for (let i = 0; i < line.length; i++) {
    out[i] = Number.isFinite(line[i]) ? line[i] : null;
    if (out[i] === null) missing++;
    else if (missing) {
      if (missing < i && x[i] - x[i - missing - 1] < GAP_S) out.fill(undefined, i - missing, i);
      missing = 0;
    }
  }
  // Drop the inner points of a level stretch: drawing costs by the number of points.
  for (let i = out.length - 2, next = out.at(-1); i > 0; i--) {
    const value = out[i];
    if (value === next && value === out[i - 1] && Number.isFinite(value)) out[i] = undefined;
    next = value;
  }
  return out;
}

export const plainNumber = (value, step) => value.toFixed(step ? places(step) : 1);
export const places = (step) => Math.max(0, Math.min(4, Math.ceil(-Math.log10(step) - 1e-9)));

function ago(seconds) {
  if (seconds === 0) return "now";
  const sign = seconds < 0 ? "−" : "+";
  const size = Math.abs(seconds);
  if (size < 60) return `${sign}${+size.toFixed(2)} s`;
  const minutes = Math.floor(size / 60);
  return `${sign}${minutes}:${(size - 60 * minutes).toFixed(0).padStart(2, "0")}`;
}
