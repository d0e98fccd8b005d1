// Lists in words: events, and the vehicle's estimated parameters.
import { el, mark, say } from "./dom.js";
import { ENDED, STATES, WORDS } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { collapsed, DOFS, rowText, sentence } from "./words.js";

const FILTERS = {
  all: ["all", () => true],
  bad: ["warnings and faults", ({ severity }) => severity !== "info"],
  state: ["states and commands", ({ kind }) => kind === "state" || kind === "command"],
  autopilot: ["the autopilot's", ({ kind }) => kind === "autopilot"],
};

export class Events {
  name = "events";

  constructor(view, store, events) {
    Object.assign(this, { view, store, events });
    this.list = el("ol", { class: "events" });
    this.filter = el("select", { "aria-label": "which events", onchange: () => this.show(this.wallOf) },
      ...Object.entries(FILTERS).map(([value, [title]]) => el("option", { value }, title)));
    this.node = el("article", { class: "panel", id: "panel-events" }, el("header", {}, el("h2", {}, "Events"), this.filter), this.list);
  }

  show(wallOf) {
    this.wallOf = wallOf;
    const [, wanted] = FILTERS[this.filter.value];
    const rows = collapsed(this.events.filter(wanted), STATES, ENDED).slice(0, 100).map((row) => el("li", { class: row.severity },
      el("button", { title: "go there", onclick: () => this.view.zoomTo(row.t - 5, row.t + 5, this.store.last) },
        el("time", {}, wallOf(row.t)), el("span", {}, rowText(row)))));
    this.list.replaceChildren(...(rows.length ? rows : [el("li", { class: "none" }, "nothing so far")]));
  }
}

const finite = (value) => typeof value === "number" && Number.isFinite(value);

export class Model {
  name = "model";

  constructor(commands) {
    const row = (dof) => ({ dof, cells: [0, 1, 2, 3].map(() => el("td")) });
    this.rows = Object.keys(DOFS).map(row);
    this.motor = el("p", { class: "motor", hidden: true });
    this.commands = commands;
    this.reset = el("button", { id: "reset-model", hidden: true, onclick: () => commands.ask(this.reset, "Forget", () => commands.send("reset_model")),
      title: "discard the estimates, and use the nominal vehicle again" }, "Forget");
    this.node = el("article", { class: "panel", id: "panel-model" },
      el("header", {}, el("h2", {}, "Vehicle, as found"), this.reset),
      el("table", { class: "found" },
        el("thead", {}, el("tr", {}, el("th"), el("th", { colspan: 2, title: "force per command over inertia; nominal: 1" }, "strength"), el("th", { colspan: 2, title: "of the thrusters" }, "lag, ms")),
          el("tr", {}, ...["", "in use", "found", "in use", "found"].map((title) => el("th", {}, title)))),
        el("tbody", {}, ...this.rows.map(({ dof, cells }) => el("tr", {}, el("th", {}, DOFS[dof].axis), ...cells)))), this.motor);
  }

  read({ status, config }) {
    for (const { dof, cells } of this.rows) {
      const { model_gain: gain, model_gain_found: found, model_gain_doubt: doubt, model_lag_s: lag, model_lag_found_s: lagFound, model_lag_doubt_s: lagDoubt } = status?.model?.[dof] ?? {};
      say(cells[0], finite(gain) ? `× ${gain.toFixed(2)}` : "–");
      say(cells[1], finite(found) && finite(doubt) ? `${found.toFixed(2)} ± ${Math.round(100 * doubt)} %` : "–");
      say(cells[2], finite(lag) ? (1e3 * lag).toFixed(0) : "–");
      say(cells[3], finite(lagFound) && finite(lagDoubt) ? `${(1e3 * lagFound).toFixed(0)} ± ${(1e3 * lagDoubt).toFixed(0)}` : "–");
    }
    const dead = status?.dead_motor, turned = status?.reversed_motor;
    this.motor.hidden = !(dead || turned);
    say(this.motor, this.motor.hidden ? "" : sentence(dead ? WORDS.DEAD_MOTOR.replace("{}", dead) : WORDS.REVERSED_MOTOR.replaceAll("{0}", turned)));
    this.reset.hidden = !this.commands?.open;
  }
}
