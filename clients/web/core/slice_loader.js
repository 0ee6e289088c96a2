// SPDX-License-Identifier: Apache-2.0
// Loads slices: at most one request in flight per loader, the newest wish wins, neighbours are loaded ahead, and slices that
// were seen stay in a cache that all loaders share.

/** Keeps the most recently used values up to a number of bytes. */
export class SliceCache {
  #entries = new Map();
  #bytes = 0;
  #limit;
  constructor(limit = 96 << 20) {
    this.#limit = limit;
  }

  get(key) {
    const entry = this.#entries.get(key);
    if (!entry) return null;
    this.#entries.delete(key);
    this.#entries.set(key, entry);
    return entry;
  }

  put(key, slice) {
    this.#drop(key);
    this.#entries.set(key, slice);
    this.#bytes += slice.values.byteLength;
    for (const oldest of this.#entries.keys()) {
      if (this.#bytes <= this.#limit || oldest === key) break;
      this.#drop(oldest);
    }
  }

  clear() {
    this.#entries.clear();
    this.#bytes = 0;
  }

  get bytes() {
    return this.#bytes;
  }

  #drop(key) {
    this.#bytes -= this.#entries.get(key)?.values.byteLength ?? 0;
    this.#entries.delete(key);
  }
}

export class SliceLoader {
  #load; #show; #fail; #cache;
  #wanted = null;
  #ahead = [];
  #flight = null;

  /** load(query, signal) → Promise of a slice; show(slice, key) for the newest wish and those on the way to it; fail(error). */
  constructor({ load, show, fail, cache }) {
    this.#load = load;
    this.#show = show;
    this.#fail = fail;
    this.#cache = cache;
  }

  get isBusy() {
    return this.#flight !== null;
  }

  /** Wishes for the slice of {key, query}; `ahead`: further ones to load while nothing else is wished for. */
  want(wish, ahead = []) {
    this.#ahead = ahead;
    const known = this.#cache.get(wish.key);
    if (known) {
      this.#wanted = null;
      this.#show(known, wish.key);
    } else {
      this.#wanted = wish;
      if (this.#flight?.isAhead && this.#flight.key !== wish.key) this.#flight.abort.abort();
    }
    this.#next();
  }

  /** Forgets all wishes. */
  stop() {
    this.#wanted = null;
    this.#ahead = [];
    this.#flight?.abort.abort();
  }

  #next() {
    if (this.#flight) return;
    const isAhead = !this.#wanted;
    const wish = this.#wanted ?? this.#ahead.find(({ key }) => !this.#cache.get(key));
    if (!wish) return;
    const flight = { key: wish.key, isAhead, abort: new AbortController() };
    this.#flight = flight;
    this.#load(wish.query, flight.abort.signal).then((slice) => {
      this.#cache.put(wish.key, slice);
      const isWanted = this.#wanted?.key === wish.key;
      if (isWanted) this.#wanted = null;
      if (isWanted || (this.#wanted && !isAhead)) this.#show(slice, wish.key);
    }, (error) => {
      if (this.#wanted?.key === wish.key) this.#wanted = null;
      if (isAhead) this.#ahead = [];
      else if (!flight.abort.signal.aborted) this.#fail(error);
    }).finally(() => {
      this.#flight = null;
      this.#next();
    });
  }
}
