// From above, north up: where the vehicle was and should have been, the path, the fence, the current.
import { colours, el, mark, say } from "./dom.js";
import { GAP_S } from "./store.js";
import { ageText, leftText } from "./words.js";

const POINTS = 600;
const APART_MS = 100; // it changes slowly
const LEAST_M = 1; // from the middle to the nearer edge
const FOLLOW_M = 3;
const CURRENT_PX = 80; // a m/s
const MOST_CURRENT_PX = 70;
const LEAST_CURRENT_MPS = 0.02;
const FENCE_SEEN = 3; // times what is inside it: a larger one would make the rest small

// The largest of 1, 2 and 5 times a power of ten that is not above `most`.
export function niceStep(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].find((step) => step * power <= most * (1 + 1e-9)) * power;
}

// Points [[north, east], …] of two columns between two indices, null in a long gap.
export function trail(store, names, first, end, where = () => true) {
  const step = Math.max(1, Math.ceil((end - first) / POINTS));
  const [north, east] = names.map((name) => store.of[name]);
  const out = [];
  let last = -Infinity;
  for (let i = first + ((step - ((first + store.number) % step)) % step); i < end; i += step) {
    if (!Number.isFinite(north[i] + east[i]) || !where(i)) continue;
    if (store.t[i] - last > GAP_S + (step > 1 ? store.t[i] - store.t[Math.max(first, i - step)] : 0)) out.push(null);
    out.push([north[i], east[i]]);
    last = store.t[i];
  }
  return out;
}

function fenced(plan) {
  if (!plan?.fenced) return [];
  const [[south, north], [west, east]] = [plan.fence_north_m, plan.fence_east_m];
  return [[south, west], [north, west], [north, east], [south, east], [south, west]];
}

export class FromAbove {
  name = "map";

  constructor(view, store, solo) {
    Object.assign(this, { view, store, solo });
    this.canvas = el("canvas", { role: "img", "aria-label": "map from above, north up" });
    this.note = el("small");
    this.follow = el("button", { "aria-pressed": "false", title: "keep the vehicle in the middle; otherwise all of it is shown", onclick: () => this.set(this.reach ? { reach: null, middle: null } : { reach: FOLLOW_M, middle: null }) }, "follow");
    const zoom = (factor, name, title) => el("button", { title, "aria-label": title, onclick: () => this.zoom(factor) }, name);
    this.box = el("div", { class: "plot square" }, this.canvas);
    this.node = el("article", { class: "panel", id: "panel-map", hidden: !solo },
      el("header", {}, el("h2", {}, "Map"), el("span", { class: "readouts" }, this.note)), this.box,
      el("span", { class: "over" }, zoom(0.7, "+", "nearer"), zoom(1 / 0.7, "−", "farther"), this.follow));
    this.canvas.addEventListener("wheel", (event) => { event.preventDefault(); this.zoom(event.deltaY > 0 ? 1.25 : 0.8); }, { passive: false });
    this.canvas.addEventListener("pointerdown", (event) => this.canvas.setPointerCapture(event.pointerId));
    this.canvas.addEventListener("pointermove", (event) => this.drag(event));
    this.canvas.addEventListener("dblclick", () => this.set({ reach: null, middle: null }));
    new ResizeObserver(() => this.fit()).observe(this.box);
    view.addEventListener("change", () => { this.drawnAt = -Infinity; });
  }

  // Half the visible width in m, null to show everything; its centre as [north, east], null for the vehicle.
  reach = null;
  middle = null;
  plan = null;

  set(changes) {
    Object.assign(this, changes);
    this.follow.setAttribute("aria-pressed", String(Boolean(this.reach) && !this.middle));
    this.view.set({});
  }

  zoom(factor) {
    this.set({ reach: Math.min(500, Math.max(0.3, (this.reach ?? this.seen ?? FOLLOW_M) * factor)), middle: this.reach ? this.middle : this.centre ?? null });
  }

  drag({ buttons, movementX, movementY }) {
    if (!buttons || !this.centre) return;
    const [north, east] = this.centre;
    this.set({ reach: this.seen, middle: [north + (movementY * devicePixelRatio) / this.scale, east - (movementX * devicePixelRatio) / this.scale] });
  }

  fit() {
    this.canvas.width = Math.round(this.box.clientWidth * devicePixelRatio);
    this.canvas.height = Math.round(this.box.clientHeight * devicePixelRatio);
  }

  read({ status }) {
    const { store, view } = this;
    const index = view.index(store);
    const [north, east] = ["x_m", "y_m"].map((name) => store.value(name, index));
    const known = Number.isFinite(north + east);
    if (this.node.hidden && store.of.x_m.subarray(store.start, store.end).some(Number.isFinite)) {
      this.node.hidden = false;
      view.set({});
    }
    mark(this.node, "known", known ? "yes" : "no");
    const laps = status?.path_length_m > 0 && status.path_left_m !== 0 ? status.path_progress_m / status.path_length_m : NaN;
    const done = Number.isFinite(laps) ? `${this.plan?.name || "path"}${laps > 1 ? `, lap ${Math.floor(laps) + 1}` : ""}, ${Math.floor(100 * (laps % 1))} %` : "";
    const path = [done, status ? leftText(status) : ""].filter(Boolean).map((text) => ` · ${text}`).join("");
    const age = store.value("position_age_s", index);
    say(this.note, known ? `N ${north.toFixed(2)}, E ${east.toFixed(2)} m${path}` : Number.isFinite(age) ? `no position for ${ageText(age)}` : "no position");
  }

  draw({ now }) {
    if (!this.canvas.width || this.node.hidden || (now - this.drawnAt < APART_MS && this.view.cursor === null)) return;
    this.drawnAt = now;
    const { store, view, plan } = this;
    const [from] = view.range(store.last);
    const index = view.index(store);
    const first = Math.max(store.start, store.find(from));
    const engaged = store.of["x.engaged"];
    const was = trail(store, ["x_m", "y_m"], first, index + 1);
    const wanted = trail(store, ["x_desired_m", "y_desired_m"], first, index + 1, (i) => engaged[i] > 0);
    const path = plan?.x_m.map((north, i) => [north, plan.y_m[i]]).filter(([north, east]) => Number.isFinite(north + east)) ?? [];
    const fence = fenced(plan);
    const here = ["x_m", "y_m"].map((name) => store.value(name, index));
    const aim = ["x_desired_m", "y_desired_m"].map((name) => store.value(name, index));
    const ratio = devicePixelRatio;
    const { width, height } = this.canvas;
    const context = this.canvas.getContext("2d");
    this.look([...was, ...wanted, ...path].filter(Boolean), fence, here);
    const [n0, e0] = this.centre;
    const k = this.scale;
    const place = ([north, east]) => [width / 2 + (east - e0) * k, height / 2 - (north - n0) * k];
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    const line = (points, colour, thick, dash = []) => {
      context.strokeStyle = colour;
      context.lineWidth = thick * ratio;
      context.setLineDash(dash.map((part) => part * ratio));
      context.beginPath();
      let pen = "moveTo";
      for (const point of points) {
        if (point) context[pen](...place(point));
        pen = point ? "lineTo" : "moveTo";
      }
      context.stroke();
      context.setLineDash([]);
    };
    const step = niceStep((0.45 * Math.min(width, height)) / k);
    const [halfN, halfE] = [height / 2 / k, width / 2 / k];
    for (let at = Math.ceil((e0 - halfE) / step) * step; at < e0 + halfE; at += step) line([[n0 - halfN, at], [n0 + halfN, at]], colours.line, 1);
    for (let at = Math.ceil((n0 - halfN) / step) * step; at < n0 + halfN; at += step) line([[at, e0 - halfE], [at, e0 + halfE]], colours.line, 1);
    line(fence, colours.fault, 1.5, [8, 4]);
    line(path, colours.model, 1.5);
    line(wanted, colours.wanted, 1.5, [5, 4]);
    line(was, colours.measured, 2);
    if (engaged[index] > 0 && Number.isFinite(aim[0] + aim[1])) this.cross(context, place(aim), ratio);
    if (Number.isFinite(here[0] + here[1])) {
      this.current(context, place(here), index, ratio);
      this.craft(context, place(here), store.value("heading_rad", index), Math.max(9 * ratio, 0.23 * k));
    }
    this.legend(context, step, k, ratio, width, height);
  }

  // Choose what is seen: `centre` in m, `scale` in pixels per m.
  look(points, fence, here) {
    const half = Math.max(1, Math.min(this.canvas.width, this.canvas.height) / 2);
    const known = Number.isFinite(here[0] + here[1]);
    if (this.reach) {
      this.centre = this.middle ?? (known ? here : this.centre ?? [0, 0]);
      this.seen = this.reach;
    } else {
      const all = known ? [...points, here] : points.length ? points : [[0, 0]];
      const range = (axis) => all.reduce(([low, high], point) => [Math.min(low, point[axis]), Math.max(high, point[axis])], [Infinity, -Infinity]);
      const inside = fence.length && fence[2][0] - fence[0][0] < FENCE_SEEN * (range(0)[1] - range(0)[0]) && fence[2][1] - fence[0][1] < FENCE_SEEN * (range(1)[1] - range(1)[0]);
      if (inside) all.push(...fence);
      const [north, east] = [range(0), range(1)];
      this.centre = [north, east].map(([low, high]) => (low + high) / 2);
      const share = (axis, size) => ((axis[1] - axis[0]) / 2) * (2 * half / size);
      this.seen = Math.max(LEAST_M, 1.2 * share(north, this.canvas.height), 1.2 * share(east, this.canvas.width));
    }
    this.scale = half / this.seen;
  }

  cross(context, [x, y], ratio) {
    context.strokeStyle = colours.wanted;
    context.lineWidth = 2 * ratio;
    context.beginPath();
    for (const [dx, dy] of [[7, 0], [0, 7]]) {
      context.moveTo(x - dx * ratio, y - dy * ratio);
      context.lineTo(x + dx * ratio, y + dy * ratio);
    }
    context.stroke();
  }

  craft(context, [x, y], heading, size) {
    context.save();
    context.translate(x, y);
    context.rotate(heading || 0);
    context.fillStyle = colours.measured;
    context.strokeStyle = colours.panel;
    context.lineWidth = 1.5 * devicePixelRatio;
    context.beginPath();
    for (const [right, ahead] of [[0, 1], [0.7, -0.8], [0, -0.45], [-0.7, -0.8]]) context.lineTo(right * size, -ahead * size);
    context.closePath();
    context.fill();
    context.stroke();
    context.restore();
  }

  // The estimated current, where it exceeds its noise.
  current(context, [x, y], index, ratio) {
    const [north, east] = ["north", "east"].map((name) => this.store.value(`current_${name}_mps`, index));
    const speed = Math.hypot(north, east);
    if (!(speed > LEAST_CURRENT_MPS)) return;
    const long = Math.min(MOST_CURRENT_PX, CURRENT_PX * speed + 14) * ratio;
    context.save();
    context.translate(x, y);
    context.rotate(Math.atan2(east, north));
    context.strokeStyle = context.fillStyle = colours.learnt;
    context.lineWidth = 2.5 * ratio;
    context.beginPath();
    context.moveTo(0, 0);
    context.lineTo(0, -long + 6 * ratio);
    context.stroke();
    context.beginPath();
    for (const [right, ahead] of [[0, 0], [5, -9], [-5, -9]]) context.lineTo(right * ratio, -long - ahead * ratio);
    context.fill();
    context.restore();
  }

  legend(context, step, k, ratio, width, height) {
    const write = (text, x, y, colour, align = "left") => {
      Object.assign(context, { font: `${11 * ratio}px system-ui, sans-serif`, fillStyle: colour, textAlign: align });
      context.fillText(text, x, y);
    };
    const [x, y, long] = [10 * ratio, height - 10 * ratio, step * k];
    context.strokeStyle = colours.ink;
    context.lineWidth = 1.5 * ratio;
    context.beginPath();
    for (const [at, up] of [[0, 4], [0, 0], [long, 0], [long, 4]]) context.lineTo(x + at, y - up * ratio);
    context.stroke();
    write(`${+step.toPrecision(1)} m`, x + 4 * ratio, y - 5 * ratio, colours.ink);
    const [north, east, off] = ["north", "east", "doubt"].map((name) => this.store.value(`current_${name}_mps`, this.view.index(this.store)));
    if (Number.isFinite(north + east)) write(`→ current ${Math.hypot(north, east).toFixed(2)} ± ${off.toFixed(2)} m/s`, x, 14 * ratio, colours.learnt);
    write("N ↑", width - 8 * ratio, 14 * ratio, colours.dim, "right");
  }
}
