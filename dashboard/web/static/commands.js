// The operator's commands, and the token that they need.
import { $, el, mark, say } from "./dom.js";
import { COMMANDS, WORDS } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py

const TOKEN = "holdfast-token";
const SAID_MS = 12_000;
const SURE_MS = 3000;
const AIMED_MS = 1000; // until the status says what was ordered
const GUIDED = ["path", "move", "waiting"];

// The frames of `goto`: title and unit of each coordinate. "body" counts from the vehicle, as the pilot sees it.
const FRAMES = {
  body: { x_m: ["Forward", "m"], y_m: ["Right", "m"], depth_m: ["Down", "m"], heading_deg: ["Turn right", "°"] },
  local: { x_m: ["North", "m"], y_m: ["East", "m"], depth_m: ["Depth", "m"], heading_deg: ["Heading", "°"] },
};

export class Commands extends EventTarget {
  allowed = false; // the dashboard takes commands
  unlocked = false; // and takes this token
  status = null;

  constructor(link) {
    super();
    this.link = link;
    this.token = stored();
    const given = new URLSearchParams(location.hash.slice(1)).get("token");
    if (given) {
      this.keep(given);
      history.replaceState(null, "", location.pathname + location.search);
    }
    const on = (id, act) => $(id).addEventListener("click", act);
    on("engage", () => this.ask($("engage"), "Engage", () => this.send("engage")));
    on("release", () => this.release());
    on("clear", () => this.send("clear_fault"));
    on("hold", () => this.send("path", { action: "hold" }));
    on("wait", () => this.send("path", { action: $("wait").textContent === "Go on" ? "resume" : "pause" }));
    on("go", () => this.openGoto());
    on("said", () => this.tell(""));
    $("unlocking").addEventListener("submit", (event) => { event.preventDefault(); this.unlock($("token").value.trim()); });
    this.buildGoto();
    this.buildAim();
    this.refresh();
  }

  // No tick has come lately: what steers the vehicle cannot work, and Release is tried all the same.
  hear(silent) {
    if (silent === this.silent) return;
    this.silent = silent;
    this.refresh();
  }

  // Commands can be given.
  get open() {
    return this.allowed && this.unlocked;
  }

  // The server may be another one than before, with another token.
  hello({ control }) {
    this.allowed = control;
    if (control && this.token) this.unlock(this.token);
    else this.lock();
  }

  take(status) {
    this.status = status;
    this.refresh();
  }

  refresh() {
    const { status } = this;
    const open = this.open && !this.silent;
    const { guidance, supervisor } = status ?? {};
    const state = supervisor?.state;
    const paused = guidance === "paused" || (guidance === "hold" && status.path_left_m !== 0);
    mark($("commands"), "lock", !this.allowed ? "read-only" : this.open ? "open" : "locked");
    $("release").disabled = !this.open;
    $("engage").hidden = state === "FAULT";
    $("clear").hidden = state !== "FAULT";
    $("clear").disabled = !open;
    $("engage").disabled = !open || state === "ACTIVE";
    $("clear").classList.toggle("primary", state === "FAULT");
    $("release").classList.toggle("danger", open && state !== "FAULT");
    $("engage").classList.toggle("primary", state === "READY" || state === "PILOT");
    $("hold").disabled = !open || state !== "ACTIVE";
    for (const one of [$("go"), ...$("aim").elements]) one.disabled = !open || !state;
    $("wait").disabled = !open || !(paused || GUIDED.includes(guidance));
    say($("wait"), paused ? "Go on" : "Pause");
    this.dispatchEvent(new Event("change"));
  }

  // Retry once where the server had just closed an idle connection: releasing twice does no harm.
  async release() {
    if (!this.open) return void $("token").focus();
    const reply = await this.send("release");
    if (reply.unheard) await this.send("release");
  }

  // --- Go to a place ---

  buildGoto() {
    this.fields = Object.entries(FRAMES.body).map(([name]) => {
      const title = el("span");
      const input = el("input", { type: "number", step: "any", id: `goto-${name}`, inputmode: "decimal", autocomplete: "off" });
      return { name, title, input, node: el("label", {}, title, input) };
    });
    const frame = (value, title) => el("label", {}, el("input", { type: "radio", name: "frame", value, onchange: () => this.count(value) }), title);
    this.needs = el("p", { class: "needs" });
    $("goto").append(el("h2", {}, "Go to"), el("form", { onsubmit: (event) => this.goto(event) },
      el("div", { class: "frames", role: "radiogroup", "aria-label": "counted from" }, frame("body", "from here"), frame("local", "a place")),
      el("div", { class: "places", oninput: () => mark(this.needs, "level", "") }, ...this.fields.map(({ node }) => node)), this.needs,
      el("div", { class: "row" }, el("button", { type: "button", id: "goto-close", onclick: () => $("goto").close() }, "Close"), el("button", { class: "primary", id: "goto-go" }, "Go"))));
    this.count("body");
  }

  count(frame) {
    this.frame = frame;
    $("goto").querySelector(`[value="${frame}"]`).checked = true;
    for (const { name, title, input } of this.fields) {
      const { least, most } = COMMANDS.goto[name];
      const [words, unit] = FRAMES[frame][name];
      say(title, `${words}, ${unit}`);
      Object.assign(input, { min: frame === "local" && name === "depth_m" ? 0 : least, max: most, value: "" });
    }
  }

  positioned(known) {
    for (const { name, input } of this.fields.slice(0, 2)) input.disabled = !known;
    const rule = this.needs.dataset.level === "bad" ? "Fill in at least one field." : "An empty field keeps its value.";
    say(this.needs, known ? rule : `${rule} Without a position source, such as a DVL, only depth and heading can be given.`);
  }

  openGoto() {
    if ($("goto").open) return void $("goto").close();
    $("goto").show(); // not modal: Release stays within reach
  }

  async goto(event) {
    event.preventDefault();
    const given = this.fields.filter(({ input }) => input.value !== "" && !input.disabled);
    mark(this.needs, "level", given.length ? "" : "bad");
    if (!given.length) return;
    const reply = await this.send("goto", { frame: this.frame, ...Object.fromEntries(given.map(({ name, input }) => [name, Number(input.value)])) });
    if (reply.done) $("goto").close();
  }

  // --- Depth and heading by one tap ---

  buildAim() {
    const field = $("depth-to");
    field.max = COMMANDS.goto.depth_m.most;
    for (const button of $("aim").querySelectorAll("button")) button.addEventListener("click", () => this.step(button.dataset.step, Number(button.value)));
    $("aim").addEventListener("submit", async (event) => {
      event.preventDefault();
      if ((await this.aim({ depth_m: Number(field.value) })).done) field.value = "";
    });
  }

  // From where it goes, or is held, or is.
  step(name, by) {
    const { guidance, pending } = this.status ?? {};
    const goes = this.aimed && (guidance === "move" || pending || performance.now() < this.aimedUntil);
    const from = goes && Number.isFinite(this.aimed[name]) ? this.aimed[name] : this.place(name);
    if (!this.open || this.silent || !Number.isFinite(from)) return;
    this.aim({ [name]: Number((name === "depth_m" ? from + by : (from + by + 360) % 360).toFixed(2)) });
  }

  async aim(place) {
    this.aimed = { ...this.aimed, ...place };
    this.aimedUntil = performance.now() + AIMED_MS;
    const reply = await this.send("goto", place);
    if (!reply.done) this.aimed = null;
    return reply;
  }

  // --- The token ---

  async unlock(token) {
    const { ok, reply, unheard } = await this.post("/api/token", {}, token);
    if (unheard) return;
    this.unlocked = ok;
    if (ok) this.keep(token);
    $("token").value = "";
    this.tell(ok ? "" : reply.said, !ok);
    this.refresh();
  }

  lock() {
    this.unlocked = false;
    this.refresh();
  }

  keep(token) {
    this.token = token;
    try { sessionStorage.setItem(TOKEN, token); } catch { /* kept for this page alone */ }
  }

  // --- To the server ---

  // A tap, and another within three seconds.
  ask(button, title, act) {
    if (button.dataset.sure === "yes") {
      mark(button, "sure", "no");
      say(button, title);
      act();
      return;
    }
    mark(button, "sure", "yes");
    say(button, `${title}: sure?`);
    setTimeout(() => { mark(button, "sure", "no"); say(button, title); }, SURE_MS);
  }

  async send(command, what = {}) {
    const vehicle = this.link.status?.vehicle || this.link.vehicle;
    if (!vehicle) {
      this.tell(WORDS.NO_VEHICLE, true);
      return { done: false, said: WORDS.NO_VEHICLE };
    }
    this.tell(`${command} …`);
    const { reply, unheard } = await this.post(`/api/${encodeURIComponent(vehicle)}/${command}`, what, this.token);
    this.tell(`${command}: ${reply.said}`, !reply.done);
    return { ...reply, unheard };
  }

  async post(path, body, token) {
    try {
      const response = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json", Authorization: `Bearer ${token}` }, body: JSON.stringify(body) });
      if (response.status === 401) this.lock();
      return { ok: response.ok, reply: await response.json() };
    } catch (error) {
      return { ok: false, unheard: true, reply: { done: false, said: `${WORDS.SERVER_SILENT[0]} ${WORDS.ELSEWHERE} (${error.message})`, value: {} } };
    }
  }

  // Success is shown for some seconds, a failure until it is dismissed.
  tell(words, bad = false) {
    clearTimeout(this.forget);
    if (!bad) this.forget = setTimeout(() => say($("said"), ""), SAID_MS);
    say($("said"), words);
    mark($("said"), "level", bad ? "bad" : "good");
  }
}

function stored() {
  try { return sessionStorage.getItem(TOKEN) ?? ""; } catch { return ""; }
}
