// SPDX-License-Identifier: Apache-2.0
// Loads slices: at most one request per loader at a time, the newest one wins, neighbours are loaded ahead, and slices that were
// seen stay in a cache that all loaders share.

const RETRY_MS = 200;

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

/** Asks until the answer is a slice of `volume`. The daemon may be loading it, or show another volume because the change is on its way. ask() → Promise of a slice. */
export async function askUntil(volume, ask, signal, pause = () => new Promise((resolve) => { setTimeout(resolve, RETRY_MS); })) {
  for (;;) {
    try {
      const slice = await ask();
      if (slice.meta.volume === volume) return slice;
    } catch (error) {
      if (!error.retryAfter || error.status !== 409) throw error;
    }
    signal.throwIfAborted();
    await pause();
  }
}

export class SliceLoader {
  #load; #show; #fail; #cache;
  #wanted = null;
  #ahead = [];
  #request = null;

  /** load(query, signal) → Promise of a slice; show(slice, key) for the newest one that is wanted and those on the way to it; fail(error). */
  constructor({ load, show, fail, cache }) {
    this.#load = load;
    this.#show = show;
    this.#fail = fail;
    this.#cache = cache;
  }

  get isBusy() {
    return this.#request !== null;
  }

  /** Wants the slice of {key, query}; `ahead`: further ones to load while nothing else is wanted. */
  want(wanted, ahead = []) {
    this.#ahead = ahead;
    const known = this.#cache.get(wanted.key);
    if (known) {
      this.#wanted = null;
      this.#show(known, wanted.key);
    } else {
      this.#wanted = wanted;
      if (this.#request?.isAhead && this.#request.key !== wanted.key) this.#request.abort.abort();
    }
    this.#next();
  }

  /** Wants nothing any more. */
  stop() {
    this.#wanted = null;
    this.#ahead = [];
    this.#request?.abort.abort();
  }

  #next() {
    if (this.#request) return;
    const isAhead = !this.#wanted;
    const wanted = this.#wanted ?? this.#ahead.find(({ key }) => !this.#cache.get(key));
    if (!wanted) return;
    const request = { key: wanted.key, isAhead, abort: new AbortController() };
    this.#request = request;
    this.#load(wanted.query, request.abort.signal).then((slice) => {
      if (request.abort.signal.aborted) return;
      this.#cache.put(wanted.key, slice);
      const isWanted = this.#wanted?.key === wanted.key;
      if (isWanted) this.#wanted = null;
      if (isWanted || (this.#wanted && !isAhead)) this.#show(slice, wanted.key);
    }, (error) => {
      if (request.abort.signal.aborted) return; // the same slice may be wanted again
      const isWanted = this.#wanted?.key === wanted.key;
      if (isWanted) this.#wanted = null;
      if (isAhead) this.#ahead = [];
      if (isWanted || !isAhead) this.#fail(error);
    }).finally(() => {
      this.#request = null;
      this.#next();
    });
  }
}
