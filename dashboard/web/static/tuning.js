// Changing things, with what is really in force read back. Only with a token.
import { $, el, mark, say } from "./dom.js";
import { COMMANDS } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py
import { DOFS } from "./words.js";

const TOKEN = "holdfast-token";
const SAID_MS = 12_000;
const GROUPS = ["gains", "estimator"];

// Of each number, [for m and N, for rad and N·m].
const UNITS = {
  lambda_per_s: ["1/s", "1/s"], kappa_per_s: ["1/s", "1/s"], leak_per_s: ["1/s", "1/s"], dead_zone: ["m/s", "rad/s"], max_disturbance: ["N", "N·m"],
  position_noise: ["m", "rad"], rate_noise: ["m/s", "rad/s"], position_noise_slow: ["m", "rad"], rate_noise_slow: ["m/s", "rad/s"],
  disturbance_noise: ["N/√s", "N·m/√s"],
};

export class Tuning {
  constructor(view, link) {
    Object.assign(this, { view, link });
    this.node = $("tuning");
    this.allowed = false;
    this.token = sessionStorageGet() || "";
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) {
      this.keep(given);
      history.replaceState(null, "", location.pathname + location.search);
    }
    this.unlocked = false;
    this.active = false;
    this.config = null;
    this.before = {};
    this.build();
    $("release").addEventListener("click", () => this.release());
    $("record").addEventListener("click", () => this.record());
    this.said = $("said");
    this.said.addEventListener("click", () => this.tell(""));
    view.addEventListener("change", () => this.refresh());
  }

  build() {
    this.lock = el("section", { class: "lock" });
    this.axisName = el("h3");
    this.inputs = {};
    const field = (group) => ({ name, title, description, least, most }) => {
      const input = el("input", { type: "number", step: "any", min: least, max: most, id: `set-${name}`, inputmode: "decimal", oninput: () => this.changed() });
      const now = el("span", { class: "now", title: "in force" });
      const unit = el("i");
      this.inputs[name] = { group, input, now, unit };
      return el("label", {}, el("span", {}, title, " ", unit, el("small", {}, description)), now, input);
    };
    this.compensator = el("select", { id: "set-compensator", onchange: () => this.changed() });
    this.compensatorNow = el("small");
    const [gains, noises] = GROUPS.map((group) => Object.values(COMMANDS[group]).filter(({ least }) => least !== null).map(field(group)));
    const within = ({ least, most }) => ({ min: least, max: most });
    this.apply = el("button", { id: "apply", class: "primary", onclick: () => this.applyAsked() }, "Apply");
    this.revert = el("button", { id: "revert", onclick: () => this.revertAll() }, "Revert");
    this.depth = el("input", { type: "number", step: "any", id: "aim-depth", placeholder: "m", ...within(COMMANDS.setpoint.depth_m) });
    this.heading = el("input", { type: "number", step: "any", id: "aim-heading", placeholder: "°", ...within(COMMANDS.setpoint.heading_deg) });
    this.engage = el("button", { id: "engage", class: "primary", onclick: () => this.ask(this.engage, "Engage", () => this.send("engage", {})) }, "Engage");
    this.controls = el("fieldset", {},
      el("div", { class: "row" }, this.engage,
        el("button", { id: "let-go", class: "danger", onclick: () => this.release() }, "Release"),
        el("button", { id: "clear", onclick: () => this.send("clear_fault", {}) }, "Clear fault")),
      el("h3", {}, "Where to be"),
      el("form", { class: "row", onsubmit: (event) => this.aim(event) }, el("label", {}, "depth", this.depth), el("label", {}, "heading", this.heading), el("button", { id: "aim" }, "Go")),
      this.axisName,
      el("div", { class: "fields" }, el("div", { class: "legend" }, el("span", {}, ""), el("span", {}, "in force"), el("span", {}, "new")),
        el("label", { class: "wide" }, el("span", {}, "compensator", this.compensatorNow), this.compensator), ...gains),
      el("details", {}, el("summary", {}, "Estimator"), el("div", { class: "fields" }, ...noises)),
      el("div", { class: "row" }, this.apply, this.revert));
    this.node.append(el("header", {}, el("h2", {}, "Tuning"), el("button", { "aria-label": "close", onclick: () => this.toggle(false) }, "×")), this.lock, this.controls);
  }

  toggle(open = this.node.hidden) {
    this.node.hidden = !open;
    $("tune").setAttribute("aria-pressed", String(open));
    mark(document.body, "tuning", open ? "yes" : "no");
    this.refresh();
  }

  hello({ control }) {
    this.allowed = control;
    if (control && this.token && !this.unlocked) this.unlock(this.token);
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

  // Commands can be given.
  get open() {
    return this.allowed && this.unlocked;
  }

  release() {
    if (this.open) this.send("release", {});
    else this.toggle(true); // which says how
  }

  record() {
    const recorder = this.link.status?.recorder;
    if (!this.open) this.toggle(true);
    else if (recorder) this.send("record", { on: !recorder.recording });
    else this.tell("No recorder is heard. Start `holdfast record --allow-control`, or the dashboard with --record.", true);
  }

  // What there is to do depends on whether it holds.
  status({ supervisor }) {
    const active = supervisor?.state === "ACTIVE";
    if (active === this.active) return;
    this.active = active;
    this.engage.classList.toggle("primary", !active);
    this.engage.disabled = active;
  }

  get axis() {
    return DOFS[this.view.dof].axis;
  }

  // What is in force, and what is typed where nothing was changed.
  refresh() {
    const { open } = this;
    this.controls.disabled = !open;
    $("release").hidden = !open;
    this.showLock(open);
    say(this.axisName, `${DOFS[this.view.dof].name}: gains of ${this.axis}`);
    const now = this.config?.[this.axis];
    for (const [name, { input, now: shown, unit }] of Object.entries(this.inputs)) {
      say(unit, UNITS[name]?.[this.axis === "yaw" ? 1 : 0] ?? "");
      say(shown, now ? text(now[name]) : "–");
      if (this.touched !== this.axis && now) input.value = text(now[name]);
    }
    say(this.compensatorNow, `in force: ${now?.compensator ?? "–"}`);
    if (this.touched !== this.axis && now) this.compensator.value = now.compensator;
    this.changed(false);
  }

  showLock(open) {
    const kind = !this.allowed ? "read-only" : open ? "open" : "locked";
    if (this.lock.dataset.kind === kind) return;
    mark(this.lock, "kind", kind);
    if (kind === "read-only") this.lock.replaceChildren(el("p", {}, "This dashboard is read-only: it sends no commands. To tune from here, start it with ", el("code", {}, "--allow-control"), "."));
    else if (kind === "locked") {
      const input = el("input", { type: "password", id: "token", autocomplete: "off", placeholder: "token" });
      this.lock.replaceChildren(el("form", { class: "row", onsubmit: (event) => { event.preventDefault(); this.unlock(input.value.trim()); } }, input, el("button", { id: "unlock" }, "Unlock")),
        el("p", {}, "The dashboard said at its start what the token is, or which file has it."));
    } else this.lock.replaceChildren(el("p", {}, "Unlocked. The companion checks, answers and logs each command; its supervisor has the last word."));
  }

  async unlock(token) {
    const { ok, reply } = await this.post("/api/token", {}, token);
    this.unlocked = ok;
    if (ok) this.keep(token);
    this.tell(ok ? "" : reply.said, !ok);
    this.refresh();
  }

  keep(token) {
    this.token = token;
    try { sessionStorage.setItem(TOKEN, token); } catch { /* kept for this page alone */ }
  }

  changes(group) {
    const now = this.config?.[this.axis] ?? {};
    return Object.fromEntries(Object.entries(this.inputs)
      .filter(([name, field]) => field.group === group && field.input.value !== "" && Number(field.input.value) !== now[name])
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

  // What takes a step that the companion wants confirmed: more than twofold, or to or from zero.
  large() {
    const now = this.config?.[this.axis] ?? {};
    return Object.entries({ ...this.changes("gains"), ...this.changes("estimator") })
      .filter(([name, value]) => !(now[name] / 2 <= value && value <= now[name] * 2)).map(([name]) => name);
  }

  applyAsked() {
    const outside = Object.entries(this.inputs).find(([, { input }]) => !input.checkValidity());
    if (outside) {
      this.tell(`${outside[0]}: must be ${outside[1].input.min} to ${outside[1].input.max}.`, true);
      this.touched = null;
      return void this.refresh();
    }
    const large = this.large();
    if (!large.length) return void this.applyAll();
    this.tell(`More than twofold at once: ${large.join(", ")}. Press Apply again if that is meant.`, true);
    this.ask(this.apply, "Apply", () => this.applyAll(true));
  }

  async applyAll(confirm = false) {
    const now = this.config?.[this.axis];
    if (!now) return;
    const { axis } = this;
    const commands = GROUPS.map((group) => [group, this.changes(group)])
      .filter(([, what]) => Object.keys(what).length).map(([group, what]) => [group, confirm ? { ...what, confirm } : what]);
    if (this.compensator.value !== now.compensator) commands.unshift(["compensator", { compensator: this.compensator.value }]);
    if (!commands.length) return void this.tell("Nothing was changed.");
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
    this.tell(heard.join("; "), !good);
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

  aim(event) {
    event.preventDefault();
    const what = {};
    if (this.depth.value !== "") what.depth_m = Number(this.depth.value);
    if (this.heading.value !== "") what.heading_deg = Number(this.heading.value);
    if (Object.keys(what).length) this.send("setpoint", what);
    else this.tell("Give a depth or a heading.", true);
  }

  // Twice within three seconds.
  ask(button, title, act) {
    if (button.dataset.sure === "yes") {
      mark(button, "sure", "no");
      say(button, title);
      act();
      return;
    }
    mark(button, "sure", "yes");
    say(button, `${title}: sure?`);
    setTimeout(() => { mark(button, "sure", "no"); say(button, title); }, 3000);
  }

  async send(command, what) {
    const vehicle = this.link.status?.vehicle;
    if (!vehicle) return { done: false, said: "no vehicle is heard" };
    this.tell(`${command} …`);
    const { reply } = await this.post(`/api/${encodeURIComponent(vehicle)}/${command}`, what, this.token);
    if (reply.done && what.axis && this.config?.[what.axis]) {
      const known = Object.entries(reply.value).filter(([name]) => name in this.config[what.axis]);
      this.config = { ...this.config, [what.axis]: { ...this.config[what.axis], ...Object.fromEntries(known) } };
    }
    this.tell(`${command}: ${reply.said}`, !reply.done);
    return reply;
  }

  async post(path, body, token) {
    try {
      const response = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json", Authorization: `Bearer ${token}` }, body: JSON.stringify(body) });
      if (response.status === 401) {
        this.unlocked = false;
        this.refresh();
      }
      return { ok: response.ok, reply: await response.json() };
    } catch (error) {
      return { ok: false, reply: { done: false, said: `the dashboard's server did not answer (${error.message})`, value: {} } };
    }
  }

  // At the bottom of the page: what went well for some seconds, what did not until it is read.
  tell(words, bad = false) {
    clearTimeout(this.forget);
    if (!bad) this.forget = setTimeout(() => say(this.said, ""), SAID_MS);
    say(this.said, words);
    mark(this.said, "level", bad ? "bad" : "good");
  }
}

const text = (value) => (value === undefined ? "" : String(+Number(value).toPrecision(6)));

function sessionStorageGet() {
  try { return sessionStorage.getItem(TOKEN); } catch { return null; }
}
