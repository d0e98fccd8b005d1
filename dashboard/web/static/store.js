// The newest rows, a typed array for each column.

const CAPACITY = 30_000; // ten minutes at 50 Hz
export const GAP_S = 0.5;
const LOOK_BACK = 25; // rows: keys of a tick may be lost on their way

export class Store {
  constructor(columns) {
    this.columns = columns;
    this.t = new Float64Array(2 * CAPACITY);
    this.of = Object.fromEntries(columns.map((name) => [name, new Float32Array(2 * CAPACITY)]));
    this.arrays = columns.map((name) => this.of[name]);
    this.epoch = -1;
    this.clear();
  }

  clear() {
    this.start = 0; // of what is kept, in the arrays
    this.end = 0;
    this.number = 0; // of the row at index 0, so that buckets keep their place while time goes on
  }

  get empty() {
    return this.end === this.start;
  }

  get last() {
    return this.empty ? NaN : this.t[this.end - 1];
  }

  // A binary frame of the server: see Ring.frame in dashboard/web/rows.py.
  take(buffer) {
    const view = new DataView(buffer);
    const epoch = view.getUint32(4, true);
    const rows = view.getUint32(16, true);
    const width = view.getUint32(20, true);
    if (width !== this.columns.length) return false;
    if (epoch !== this.epoch) {
      this.clear();
      this.epoch = epoch;
    }
    const t = new Float64Array(buffer, 24, rows);
    const values = new Float32Array(buffer, 24 + 8 * rows, rows * width);
    for (let row = 0; row < rows; row++) {
      if (t[row] <= this.last) continue; // again, after a reconnect
      if (this.end === 2 * CAPACITY) this.slide();
      this.t[this.end] = t[row];
      for (let column = 0; column < width; column++) this.arrays[column][this.end] = values[row * width + column];
      this.end++;
    }
    this.start = Math.max(this.start, this.end - CAPACITY);
    return true;
  }

  slide() {
    for (const array of [this.t, ...this.arrays]) array.copyWithin(0, CAPACITY);
    this.end -= CAPACITY;
    this.start = 0;
    this.number += CAPACITY;
  }

  // The index of the first row at or after t.
  find(t) {
    let low = this.start;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.t[middle] < t) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  // The newest known value at or shortly before the row at `index`.
  value(name, index = this.end - 1) {
    const column = this.of[name];
    for (let i = index; i >= Math.max(this.start, index - LOOK_BACK); i--) if (!Number.isNaN(column[i])) return column[i];
    return NaN;
  }

  // Rows of [from, to] in at most about `points` points: the times less `zero`, and for each name its values,
  // the least and the greatest of a bucket in their order. NaN where there is nothing.
  window(names, from, to, zero, points) {
    const first = Math.max(this.start, this.find(from) - 1);
    const end = Math.min(this.end, this.find(to) + 1);
    const size = Math.max(1, Math.ceil((2 * (end - first)) / points));
    const x = [];
    const out = names.map(() => []);
    if (size <= 2) {
      for (let i = first; i < end; i++) {
        if (i > first && this.t[i] - this.t[i - 1] > GAP_S) {
          x.push(this.t[i - 1] - zero + 1e-3);
          for (const values of out) values.push(NaN);
        }
        x.push(this.t[i] - zero);
        for (let c = 0; c < names.length; c++) out[c].push(this.of[names[c]][i]);
      }
      return { x, values: out };
    }
    for (let i = first; i < end; ) {
      let stop = Math.min(end, i + size - ((i + this.number) % size));
      if (i > first && this.t[i] - this.t[i - 1] > GAP_S) {
        x.push(this.t[i - 1] - zero + 1e-3);
        for (const values of out) values.push(NaN);
      }
      for (let k = i + 1; k < stop; k++) if (this.t[k] - this.t[k - 1] > GAP_S) stop = k;
      x.push(this.t[i] - zero, this.t[(i + stop) >> 1] - zero);
      if (stop - i === 1) x.pop();
      for (let c = 0; c < names.length; c++) {
        const column = this.of[names[c]];
        let least = i;
        let most = i;
        for (let k = i + 1; k < stop; k++) {
          if (column[k] < column[least] || Number.isNaN(column[least])) least = k;
          if (column[k] > column[most] || Number.isNaN(column[most])) most = k;
        }
        out[c].push(column[Math.min(least, most)]);
        if (stop - i > 1) out[c].push(column[Math.max(least, most)]);
      }
      i = stop;
    }
    return { x, values: out };
  }
}
