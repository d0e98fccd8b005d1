// Changes gains, and shows those in force.
import { $, el, mark, say } from "./dom.js";
import { COMMANDS } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { DOFS } from "./words.js";

export class Tuning {
  constructor(view, commands) {
    Object.assign(this, { view, commands });
    this.node = $("tuning");
    this.config = null;
    this.before = {};
    this.build();
    view.addEventListener("change", () => this.refresh());
    commands.addEventListener("change", () => this.permit());
  }

  build() {
    this.lock = el("p");
    this.axisName = el("h3");
    this.inputs = {};
    const field = ([name, { title, what, unit: of, least, most }]) => {
      const input = el("input", { type: "number", step: "any", min: least, max: most, id: `set-${name}`, inputmode: "decimal", oninput: () => this.changed() });
      const now = el("span", { class: "now", title: "in force" });
      const unit = el("i");
      this.inputs[name] = { input, now, unit, units: of.split(" or ") };
      return el("label", {}, el("span", {}, title, " ", unit, el("small", {}, what)), now, input);
    };
    this.compensator = el("select", { id: "set-compensator", onchange: () => this.changed() });
    this.compensatorNow = el("small");
    const gains = Object.entries(COMMANDS.gains).filter(([, { least }]) => least !== null).map(field);
    this.apply = el("button", { id: "apply", class: "primary", onclick: () => this.applyAsked() }, "Apply");
    this.revert = el("button", { id: "revert", onclick: () => this.revertAll() }, "Revert");
    this.controls = el("fieldset", {},
      this.axisName,
      el("div", { class: "fields" }, el("div", { class: "legend" }, el("span", {}, ""), el("span", {}, "in force"), el("span", {}, "new")),
        el("label", { class: "wide" }, el("span", {}, "compensator", this.compensatorNow), this.compensator), ...gains),
      el("div", { class: "row" }, this.apply, this.revert));
    this.node.append(el("header", {}, el("h2", {}, "Tuning"), el("button", { "aria-label": "close", onclick: () => this.toggle(false) }, "×")), this.lock, this.controls);
  }

  toggle(open = this.node.hidden) {
    this.node.hidden = !open;
    $("tune").setAttribute("aria-pressed", String(open));
    mark(document.body, "tuning", open ? "yes" : "no");
    this.refresh();
  }

  choices({ compensator }) {
    this.compensator.replaceChildren(...compensator.map((name) => el("option", { value: name }, name)));
    this.refresh();
  }

  show(config) {
    this.config = config;
    this.refresh();
  }

  permit() {
    const { allowed, open } = this.commands;
    this.controls.disabled = !open;
    say(this.lock, open ? "The companion checks, answers and logs each change." : allowed ? "Unlock the commands first, with the token." : "Read-only: start the dashboard with --allow-control to tune from here.");
  }

  get axis() {
    return DOFS[this.view.dof].axis;
  }

  // Show the values in force, and in the fields that were not edited.
  refresh() {
    this.permit();
    say(this.axisName, `${DOFS[this.view.dof].name}: gains of ${this.axis}`);
    const now = this.config?.[this.axis];
    for (const [name, { input, now: shown, unit, units }] of Object.entries(this.inputs)) {
      say(unit, this.axis === "yaw" ? units.at(-1) : units[0]);
      say(shown, now ? text(now[name]) : "–");
      if (this.touched !== this.axis && now) input.value = text(now[name]);
    }
    say(this.compensatorNow, `in force: ${now?.compensator ?? "–"}`);
    if (this.touched !== this.axis && now) this.compensator.value = now.compensator;
    this.changed(false);
  }

  changes() {
    const now = this.config?.[this.axis] ?? {};
    return Object.fromEntries(Object.entries(this.inputs)
      .filter(([name, field]) => field.input.value !== "" && Number(field.input.value) !== now[name])
      .map(([name, field]) => [name, Number(field.input.value)]));
  }

  changed(byHand = true) {
    if (byHand) this.touched = this.axis;
    const now = this.config?.[this.axis] ?? {};
    for (const [name, { input }] of Object.entries(this.inputs)) mark(input, "changed", Number(input.value) !== now[name] && input.value !== "" ? "yes" : "no");
    mark(this.compensator, "changed", this.compensator.value !== now.compensator ? "yes" : "no");
    this.apply.disabled = !this.config;
    this.revert.disabled = !this.before[this.axis] && this.touched !== this.axis;
  }

  // The changes that need a confirmation: more than twofold, or to or from zero.
  large() {
    const now = this.config?.[this.axis] ?? {};
    return Object.entries(this.changes())
      .filter(([name, value]) => !(now[name] / 2 <= value && value <= now[name] * 2)).map(([name]) => name);
  }

  applyAsked() {
    const outside = Object.entries(this.inputs).find(([, { input }]) => !input.checkValidity());
    if (outside) {
      this.commands.tell(`${outside[0]}: must be ${outside[1].input.min} to ${outside[1].input.max}.`, true);
      this.touched = null;
      return void this.refresh();
    }
    const large = this.large();
    if (!large.length) return void this.applyAll();
    this.commands.tell(`A change by more than a factor of two: ${large.join(", ")}. Press Apply again to confirm it.`, true);
    this.commands.ask(this.apply, "Apply", () => this.applyAll(true));
  }

  async applyAll(confirm = false) {
    const now = this.config?.[this.axis];
    if (!now) return;
    const { axis } = this;
    const gains = this.changes();
    const commands = Object.keys(gains).length ? [["gains", confirm ? { ...gains, confirm } : gains]] : [];
    if (this.compensator.value !== now.compensator) commands.unshift(["compensator", { compensator: this.compensator.value }]);
    if (!commands.length) return void this.commands.tell("Nothing was changed.");
    const before = { ...now };
    const heard = [];
    let good = true;
    for (const [name, what] of commands) {
      const reply = await this.send(name, { axis, ...what });
      heard.push(reply.said);
      good &&= reply.done;
      if (!reply.done) break;
    }
    this.touched = null;
    if (good) this.before[axis] = before;
    this.commands.tell(heard.join("; "), !good);
    this.refresh();
  }

  // Undo typing; where nothing is typed, go back to what was in force before the last apply.
  async revertAll() {
    const { axis } = this;
    const before = this.before[axis];
    if (this.touched === axis || !before) {
      this.touched = null;
      return void this.refresh();
    }
    for (const [name, { input }] of Object.entries(this.inputs)) input.value = text(before[name]);
    this.compensator.value = before.compensator;
    await this.applyAll(true);
    delete this.before[axis];
    this.refresh();
  }

  async send(command, what) {
    const reply = await this.commands.send(command, what);
    if (reply.done && this.config?.[what.axis]) {
      const known = Object.entries(reply.value).filter(([name]) => name in this.config[what.axis]);
      this.config = { ...this.config, [what.axis]: { ...this.config[what.axis], ...Object.fromEntries(known) } };
    }
    return reply;
  }
}

const text = (value) => (value === undefined ? "" : String(+Number(value).toPrecision(6)));
