// The WebSocket: reconnects by itself, and knows the age of its data.

const SILENT_MS = 1500;
const RETRY_MS = [200, 2000];
const TRY_AGAIN_LATER = 1013; // others took our place
const LATER_MS = 30000;

const nowS = () => performance.now() / 1000;

export class Link {
  constructor(handlers, vehicle) {
    this.handlers = handlers;
    this.vehicle = vehicle;
    this.status = null;
    this.wait = RETRY_MS[0];
    this.open();
    setInterval(() => this.leaveIfSilent(), 250);
  }

  choose(vehicle) {
    this.vehicle = vehicle;
    this.open();
  }

  // Seconds since the newest sample left the companion, delays on the way included.
  get age() {
    if (!this.status || this.status.age_s === null || this.status.age_s === undefined) return Infinity;
    return this.status.age_s + this.late + (nowS() - this.statusAt);
  }

  // Seconds since the dashboard's own server was heard.
  get silence() {
    return this.heard === undefined ? Infinity : nowS() - this.heard;
  }

  open() {
    this.abandon();
    clearTimeout(this.timer);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws?vehicle=${encodeURIComponent(this.vehicle)}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.opened = nowS();
    this.fastest = Infinity;
    socket.onmessage = ({ data }) => this.take(data);
    socket.onclose = ({ code }) => this.retry(code === TRY_AGAIN_LATER ? LATER_MS : this.wait);
  }

  abandon() {
    if (!this.socket) return;
    this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.socket = null;
  }

  retry(wait = this.wait) {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.open(), wait);
    this.wait = Math.min(2 * this.wait, RETRY_MS[1]);
  }

  // A half-open connection is never closed: reconnect after a long silence.
  leaveIfSilent() {
    if (this.socket && nowS() - Math.max(this.heard ?? 0, this.opened) > SILENT_MS / 1000 && this.socket.readyState !== WebSocket.CLOSED) {
      this.abandon();
      this.retry();
    }
  }

  take(data) {
    this.heard = nowS();
    this.wait = RETRY_MS[0];
    if (typeof data !== "string") {
      this.handlers.rows(data);
      return;
    }
    const message = JSON.parse(data);
    if (message.status) {
      const apart = this.heard - message.status.now_s;
      this.fastest = Math.min(this.fastest, apart);
      this.late = apart - this.fastest;
      this.status = message.status;
      this.statusAt = this.heard;
    }
    for (const [name, content] of Object.entries(message)) this.handlers[name]?.(content);
  }
}
