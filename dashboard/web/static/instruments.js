// Panels that are no plots over time: horizon with compass, phase portrait, ages.
import { colours, el, mark, say, svg } from "./dom.js";
import { GAP_S } from "./store.js";
import { ageText, DOFS } from "./words.js";

const DEG = 180 / Math.PI;
const APART_MS = 35; // a turned SVG costs a layout and a repaint, as much as three plots

export class Attitude {
  name = "attitude";

  constructor(view, store) {
    Object.assign(this, { view, store });
    const ladder = [-60, -40, -20, -10, 10, 20, 40, 60].map((pitch) => {
      const half = pitch % 20 ? 8 : 16;
      return svg("line", { class: "ladder", x1: -half, x2: half, y1: -pitch, y2: -pitch });
    });
    this.pitch = svg("g", {}, svg("rect", { class: "sky", x: -150, y: -250, width: 300, height: 250 }),
      svg("rect", { class: "sea", x: -150, y: 0, width: 300, height: 250 }),
      svg("line", { class: "horizon", x1: -150, x2: 150, y1: 0, y2: 0 }), ...ladder);
    this.roll = svg("g", {}, this.pitch);
    const ticks = [];
    for (let angle = 0; angle < 360; angle += 10) {
      const long = angle % 30 === 0;
      ticks.push(svg("line", { class: "tick", y1: -96, y2: long ? -88 : -92, transform: `rotate(${angle})` }));
      if (long) {
        const name = { 0: "N", 90: "E", 180: "S", 270: "W" }[angle] ?? angle / 10;
        ticks.push(svg("text", { class: angle % 90 ? "" : "cardinal", y: -78, transform: `rotate(${angle})` }, String(name)));
      }
    }
    this.bug = svg("path", { class: "bug", d: "M0 -89 l-6 -10 h12 z" });
    this.card = svg("g", {}, ...ticks, this.bug);
    this.rolled = svg("text", { class: "level", x: -140, y: 92 });
    this.pitched = svg("text", { class: "level", x: 140, y: 92 });
    const picture = svg("svg", { viewBox: "-142 -104 284 208", role: "img", "aria-label": "artificial horizon and compass" },
      svg("clipPath", { id: "disc" }, svg("circle", { r: 66 })),
      svg("g", { "clip-path": "url(#disc)" }, this.roll), svg("circle", { class: "rim", r: 66 }),
      svg("circle", { class: "rim", r: 97 }), this.card,
      svg("path", { class: "lubber", d: "M0 -86 l-5 -9 h10 z", transform: "rotate(180 0 -92)" }),
      this.rolled, this.pitched, svg("path", { class: "craft", d: "M-38 0 h22 l6 8 l6 -8 h8 l6 8 l6 -8 h22" }));
    this.heading = el("b");
    this.node = el("article", { class: "panel", id: "panel-attitude" },
      el("header", {}, el("h2", {}, "Attitude"), el("span", { class: "readouts" }, el("span", { class: "key" }, this.heading))), picture);
  }

  draw({ now }) {
    if (now - this.drawnAt < APART_MS && this.view.cursor === null) return;
    this.drawnAt = now;
    const { store } = this;
    const index = this.view.index(store);
    const value = (name) => store.value(name, index);
    const [roll, pitch, heading, wanted] = ["roll_rad", "pitch_rad", "heading_rad", "heading_desired_rad"].map((name) => value(name) * DEG);
    const known = Number.isFinite(heading + roll + pitch);
    mark(this.node, "known", known ? "yes" : "no");
    if (!known) {
      const age = value("attitude_age_s");
      say(this.heading, Number.isFinite(age) ? `no attitude for ${ageText(age)}` : "no attitude yet");
      return;
    }
    move(this.roll, `rotate(${(-roll).toFixed(1)})`);
    move(this.pitch, `translate(0 ${pitch.toFixed(1)})`);
    move(this.card, `rotate(${(-heading).toFixed(1)})`);
    move(this.bug, `rotate(${wanted.toFixed(1)})`);
    this.bug.style.display = value("psi.engaged") > 0 ? "" : "none";
    say(this.heading, `${((heading + 360) % 360).toFixed(1).padStart(5, "0")}°`);
    const held = (name) => {
      const angle = value(name) * DEG;
      return Math.abs(angle) > 0.05 ? ` of ${signed(angle)}°` : "";
    };
    say(this.rolled, `roll ${signed(roll)}°${held("roll_desired_rad")}`);
    say(this.pitched, `pitch ${signed(pitch)}°${held("pitch_desired_rad")}`);
  }
}

// To a tenth of a degree, and only when it moved: a pixel here is more, and a redrawn picture costs a layout.
function move(node, transform) {
  if (node.getAttribute("transform") !== transform) node.setAttribute("transform", transform);
}

const signed = (value) => `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(1)}`;

export class Phase {
  name = "phase";

  constructor(view, store) {
    Object.assign(this, { view, store });
    this.canvas = el("canvas");
    this.note = el("small");
    this.box = el("div", { class: "plot square" }, this.canvas);
    this.node = el("article", { class: "panel", id: "panel-phase" },
      el("header", {}, el("h2", {}, "Phase portrait"), el("span", { class: "readouts" }, this.note)), this.box);
    new ResizeObserver(() => this.fit()).observe(this.box);
    new IntersectionObserver(([entry]) => {
      this.shown = entry.isIntersecting;
      if (this.shown) view.set({});
    }).observe(this.node);
  }

  fit() {
    this.canvas.width = Math.round(this.box.clientWidth * devicePixelRatio);
    this.canvas.height = Math.round(this.box.clientHeight * devicePixelRatio);
  }

  draw({ lambda }) {
    if (!this.shown || !this.canvas.width) return;
    const { store, view } = this;
    const { width, height } = this.canvas;
    const dof = DOFS[view.dof];
    const [from, to] = view.range(store.last);
    const names = ["e", "e_dot", "engaged"].map((name) => `${view.dof}.${name}`);
    const first = Math.max(store.start, store.find(Math.max(from, to - 15)));
    const end = Math.min(store.end, store.find(to) + 1);
    const step = Math.max(1, Math.floor((end - first) / 600));
    const points = [];
    let reach = [dof.e.span / 2, dof.rate.span / 2];
    for (let i = first + ((step - ((first + store.number) % step)) % step); i < end; i += step) {
      const [e, rate, engaged] = names.map((name) => store.value(name, i));
      if (!(engaged > 0) || !Number.isFinite(e + rate)) continue;
      points.push([e * dof.e.scale, rate * dof.rate.scale, store.t[i]]);
      reach = [Math.max(reach[0], Math.abs(e * dof.e.scale)), Math.max(reach[1], Math.abs(rate * dof.rate.scale))];
    }
    this.reach = this.reach && this.of === view.dof ? this.reach.map((old, i) => (reach[i] > old ? reach[i] : old + 0.06 * (reach[i] - old))) : reach;
    this.of = view.dof;
    const context = this.canvas.getContext("2d");
    const ratio = devicePixelRatio;
    const X = (e) => width / 2 + (e / this.reach[0]) * (width / 2 - 14 * ratio);
    const Y = (rate) => height / 2 - (rate / this.reach[1]) * (height / 2 - 14 * ratio);
    context.clearRect(0, 0, width, height);
    const line = (x0, y0, x1, y1, colour, dash = []) => {
      context.strokeStyle = colour;
      context.setLineDash(dash.map((part) => part * ratio));
      context.beginPath();
      context.moveTo(x0, y0);
      context.lineTo(x1, y1);
      context.stroke();
    };
    context.lineWidth = ratio;
    line(0, height / 2, width, height / 2, colours.line);
    line(width / 2, 0, width / 2, height, colours.line);
    if (Number.isFinite(lambda)) {
      const far = 2 * this.reach[0];
      const slope = (-lambda * dof.rate.scale) / dof.e.scale;
      line(X(-far), Y(-slope * far), X(far), Y(slope * far), colours.feedback, [5, 4]);
    }
    context.setLineDash([]);
    context.lineWidth = 1.5 * ratio;
    context.strokeStyle = colours.measured;
    const pieces = 16;
    for (let piece = 0; piece < pieces; piece++) {
      const begin = Math.floor((piece * points.length) / pieces);
      const stop = Math.min(points.length, Math.floor(((piece + 1) * points.length) / pieces) + 1);
      context.globalAlpha = 0.08 + 0.92 * ((piece + 1) / pieces) ** 2;
      context.beginPath();
      for (let i = begin; i < stop; i++) {
        const apart = i > begin && points[i][2] - points[i - 1][2] > GAP_S;
        context[apart ? "moveTo" : "lineTo"](X(points[i][0]), Y(points[i][1]));
      }
      context.stroke();
    }
    context.globalAlpha = 1;
    const last = points.at(-1);
    if (last) {
      context.fillStyle = colours.measured;
      context.beginPath();
      context.arc(X(last[0]), Y(last[1]), 4 * ratio, 0, 7);
      context.fill();
    }
    context.fillStyle = colours.dim;
    context.font = `${11 * ratio}px system-ui, sans-serif`;
    context.textAlign = "right";
    context.fillText(`e  ${this.reach[0].toPrecision(3)} ${dof.e.unit}`, width - 4 * ratio, height / 2 - 5 * ratio);
    context.textAlign = "left";
    context.fillText(`ė  ${this.reach[1].toPrecision(3)} ${dof.rate.unit}`, width / 2 + 5 * ratio, 12 * ratio);
    mark(this.node, "held", last ? "yes" : "no");
    say(this.note, "dashed: ε = 0");
  }
}

const AGES = [
  ["link", "vehicle link", "link_timeout_s", 1],
  ["heartbeat", "heartbeat", "heartbeat_timeout_s", 3],
  ["depth", "depth", "depth_timeout_s", 0.5],
  ["attitude", "attitude", "attitude_timeout_s", 0.5],
  ["position", "position", "position_timeout_s", 1],
];

export class Ages {
  name = "ages";

  constructor(view, store) {
    Object.assign(this, { view, store });
    this.rows = AGES.map(([name, title, limit, fallback]) => {
      const bar = el("i");
      const value = el("b");
      return { name, limit, fallback, bar, value, node: el("li", {}, el("span", {}, title), el("span", { class: "bar" }, bar), value) };
    });
    this.delays = el("small");
    this.node = el("article", { class: "panel", id: "panel-ages" },
      el("header", {}, el("h2", {}, "Telemetry ages"), el("span", { class: "readouts" }, this.delays)),
      el("ul", { class: "ages" }, ...this.rows.map((row) => row.node)));
  }

  read({ config, age }) {
    for (const { name, limit, fallback, bar, value, node } of this.rows) {
      const known = this.store.value(`${name}_age_s`);
      const seconds = known + (age > 0.5 ? age : 0);
      const share = seconds / (config?.supervisor?.[limit] ?? fallback);
      bar.style.width = `${Math.min(100, Math.max(2, 100 * share)) || 0}%`;
      mark(node, "level", !Number.isFinite(seconds) ? "none" : share > 1 ? "bad" : share > 0.5 ? "warn" : "good");
      say(value, ageText(seconds));
    }
    const [telemetry, command] = ["telemetry_delay_s", "command_delay_s"].map((name) => 1e3 * Math.max(0, this.store.value(name)));
    say(this.delays, Number.isFinite(telemetry + command) ? `delay ${telemetry.toFixed(0)}, ${command.toFixed(0)} ms` : "");
  }
}

