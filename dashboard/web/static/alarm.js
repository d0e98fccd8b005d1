// The alarm: sound and vibration when control ends without the pilot, at a fault, and when nothing new comes.
import { $, mark, say } from "./dom.js";
import { BY_A_PERSON } from "./vocabulary.js"; // made by the server: dashboard/web/vocabulary.py

const AGAIN_MS = 2000;
const BEEPS_S = [0, 0.25, 0.5]; // of each call
const VIBRATION_MS = [200, 50, 200, 50, 200];
const KEPT = "holdfast-alarm";

export class Alarm {
  cause = ""; // what it sounds for
  silenced = ""; // the cause that was heard

  constructor() {
    this.on = stored() !== "off";
    this.node = $("alarm");
    this.node.addEventListener("click", () => this.tap());
    for (const touch of ["pointerdown", "keydown"]) addEventListener(touch, () => this.unlock(), { capture: true });
    setInterval(() => this.call(), AGAIN_MS);
    this.refresh();
  }

  // A browser plays no sound before the page is touched.
  unlock() {
    if (!globalThis.AudioContext) return;
    this.audio ??= new AudioContext();
    this.audio.resume().then(() => this.refresh(), () => {});
  }

  get ready() {
    return this.audio?.state === "running";
  }

  // `state` and its `reason` as last heard; `silent`: nothing new comes now.
  hear(state, reason, silent) {
    if (state === "ACTIVE" || BY_A_PERSON.some((words) => reason.includes(words))) this.lost = false;
    else if (this.state === "ACTIVE") this.lost = true;
    this.state = state;
    const cause = silent ? (state ? "data" : "") : state === "FAULT" ? "fault" : this.lost ? "control" : "";
    if (cause === this.cause) return;
    this.cause = cause;
    this.silenced = "";
    this.call();
  }

  // Another vehicle.
  forget() {
    this.state = undefined;
    this.lost = false;
  }

  get sounds() {
    return this.on && this.cause && this.cause !== this.silenced;
  }

  // One tap silences what sounds; otherwise it switches the alarm off, or on.
  tap() {
    if (this.sounds) this.silenced = this.cause;
    else {
      this.on = !this.on;
      try { localStorage.setItem(KEPT, this.on ? "on" : "off"); } catch { /* for this page alone */ }
    }
    navigator.vibrate?.(0);
    this.refresh();
  }

  call() {
    this.refresh();
    if (!this.sounds) return;
    navigator.vibrate?.(VIBRATION_MS);
    if (!this.ready) return;
    for (const at of BEEPS_S) {
      const [tone, volume] = [this.audio.createOscillator(), this.audio.createGain()];
      tone.type = "square";
      tone.frequency.value = 880;
      volume.gain.value = 0.3;
      tone.connect(volume).connect(this.audio.destination);
      tone.start(this.audio.currentTime + at);
      tone.stop(this.audio.currentTime + at + 0.15);
    }
  }

  refresh() {
    const can = globalThis.AudioContext ? (this.ready ? "" : "touch for sound") : "no sound here";
    const words = !this.on ? "alarm off" : can || (this.sounds ? "Silence" : "alarm on");
    say(this.node, words);
    mark(this.node, "sounds", this.sounds ? "yes" : "no");
  }
}

function stored() {
  try { return localStorage.getItem(KEPT); } catch { return null; }
}
