// SPDX-License-Identifier: Apache-2.0
// Values over time for small graphs: the last `span` ms in buckets of `step` ms.

export class Series {
  #span; #step; #merge;
  #buckets = new Map(); // by number: {value, count}

  /** merge: 'sum', 'mean' or 'max' of the values of one bucket. */
  constructor({ span = 60000, step = 1000, merge = 'mean' } = {}) {
    this.#span = span;
    this.#step = step;
    this.#merge = merge;
  }

  put(time, value) {
    if (!Number.isFinite(value)) return;
    const number = Math.floor(time / this.#step);
    const { value: old, count } = this.#buckets.get(number) ?? { value: this.#merge === 'max' ? -Infinity : 0, count: 0 };
    this.#buckets.set(number, { value: this.#merge === 'max' ? Math.max(old, value) : old + value, count: count + 1 });
    const oldest = number - Math.ceil(this.#span / this.#step);
    for (const key of this.#buckets.keys()) if (key < oldest) this.#buckets.delete(key);
  }

  /** One value per bucket, the oldest first, the current bucket left out; `empty` where nothing was put. */
  values(now, empty = null) {
    const last = Math.floor(now / this.#step);
    const count = Math.ceil(this.#span / this.#step);
    return Array.from({ length: count }, (_, i) => {
      const bucket = this.#buckets.get(last - count + i);
      if (!bucket) return empty;
      return this.#merge === 'mean' ? bucket.value / bucket.count : bucket.value;
    });
  }

  clear() {
    this.#buckets.clear();
  }
}

/** The points of a polyline in a box of `width` × `height`: a list of runs without gaps, each a text for `points`. */
export function polylines(values, width, height, top) {
  const runs = [];
  let run = null;
  values.forEach((value, i) => {
    if (value === null) {
      run = null;
      return;
    }
    if (!run) runs.push(run = []);
    const x = values.length > 1 ? width * i / (values.length - 1) : 0;
    run.push(`${x.toFixed(1)},${(height * (1 - Math.min(1, value / top))).toFixed(1)}`);
  });
  return runs.map((points) => (points.length > 1 ? points : [points[0], points[0]]).join(' '));
}

/** A round number at or above every value: 1, 2 or 5 times a power of ten. */
export function roundTop(values, least = 1) {
  const most = Math.max(least, ...values.filter((value) => value !== null));
  const power = 10 ** Math.floor(Math.log10(most));
  return power * [1, 2, 5, 10].find((factor) => power * factor >= most * 0.999999);
}
