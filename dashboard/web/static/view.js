// The visible time, the degree of freedom, and the cursor.

export const SPANS = [10, 30, 60, 120, 300, 600];

export class View extends EventTarget {
  span = 30;
  dof = "z";
  zoom = null; // [from, to] in the data's time
  stopped = null; // the data's time when paused
  cursor = null; // the data's time under the pointer

  get paused() {
    return this.stopped !== null;
  }

  head(last) {
    return this.stopped ?? last;
  }

  range(last) {
    return this.zoom ?? [this.head(last) - this.span, this.head(last)];
  }

  // The row of the readouts: under the cursor, where it was stopped, or the newest.
  index(store) {
    const at = this.cursor ?? (this.paused ? this.range(store.last)[1] : null);
    return at === null ? store.end - 1 : Math.min(store.end - 1, store.find(at));
  }

  set(changes) {
    Object.assign(this, changes);
    this.dispatchEvent(new Event("change"));
  }

  pause(last) {
    this.set(this.paused ? { stopped: null, zoom: null } : { stopped: last });
  }

  zoomTo(from, to, last) {
    this.set({ zoom: [from, to], stopped: this.head(last) });
  }

  live() {
    this.set({ zoom: null, stopped: null });
  }

  step(direction) {
    const index = SPANS.indexOf(this.span) + direction;
    if (SPANS[index]) this.set({ span: SPANS[index], zoom: null });
  }
}
