// SPDX-License-Identifier: Apache-2.0
// The pace of view.update: what the user does between two sends is joined into one patch; one patch is sent an
// animation frame at most; while `limit` updates are unanswered, nothing is sent, and the newest waits. What
// waits is always sent in the end, so that the last picture shows the last view.
import { joinPatches } from './merge.js';

export class Pace {
  #send; #schedule; #now; #limit; #fail; #done;
  #seq = 0;
  #taken = 0;
  #drawn = 0;
  #epoch = 0;
  #open = false;
  #scheduled = false;
  #waiting = null;
  #since = 0;
  #flying = new Map();
  #times = new Map();

  /**
   * send({seq, patch}) → Promise of the answer; schedule(f) calls f at the next animation frame; now() in ms;
   * done(patch) is told of an accepted update, fail(error, patch) of a refused one. At most `limit` updates are
   * unanswered.
   */
  constructor({ send, schedule, now, done = () => {}, fail, limit = 4 }) {
    this.#send = send;
    this.#schedule = schedule;
    this.#now = now;
    this.#done = done;
    this.#fail = fail;
    this.#limit = limit;
  }

  /** Newest seq that was sent on this stream and not refused: a picture will show it; 0 before the first. */
  get sent() { return Math.max(this.#taken, ...this.#flying.keys()); }
  /** Newest seq that a drawn picture shows. */
  get drawn() { return this.#drawn; }
  /** Updates that were sent and not answered. */
  get unanswered() { return this.#flying.size; }
  /** Nothing waits and nothing is unanswered. */
  get isIdle() { return !this.#waiting && this.#flying.size === 0; }

  /** Joins `patch` to what waits. `time` is when the user did it. `alone` drops what waits before. */
  put(patch, { time = this.#now(), alone = false } = {}) {
    if (this.#waiting && !alone) {
      this.#waiting = joinPatches(this.#waiting, patch);
    } else {
      this.#waiting = patch;
      this.#since = time;
    }
    this.#plan();
  }

  /** A stream is open: sending may go on. Each stream counts its own seq, from 1. */
  open() {
    this.#open = true;
    this.#seq = 0;
    this.#taken = 0;
    this.#drawn = 0;
    this.#plan();
  }

  /** The stream is gone: what was not answered waits again, older first, since it may be lost. */
  close() {
    this.#open = false;
    this.#epoch += 1;
    const lost = [...this.#flying.values()];
    this.#flying.clear();
    this.#times.clear();
    if (!lost.length) return;
    const joined = lost.reduce(joinPatches);
    this.#since = this.#waiting ? this.#since : this.#now();
    this.#waiting = this.#waiting ? joinPatches(joined, this.#waiting) : joined;
  }

  /** Forgets what waits: the view has been replaced as a whole. */
  drop() {
    this.#waiting = null;
  }

  /** A picture that shows `seq` was drawn; returns the ms from the user's action to now, or null if unknown. */
  show(seq) {
    if (seq <= this.#drawn || seq > this.#seq) return null;
    this.#drawn = seq;
    const then = this.#times.get(seq);
    for (const key of this.#times.keys()) if (key <= seq) this.#times.delete(key);
    return then === undefined ? null : this.#now() - then;
  }

  #plan() {
    if (this.#scheduled || !this.#open || !this.#waiting || this.#flying.size >= this.#limit) return;
    this.#scheduled = true;
    this.#schedule(() => {
      this.#scheduled = false;
      this.#flush();
    });
  }

  #flush() {
    if (!this.#open || !this.#waiting || this.#flying.size >= this.#limit) return;
    const patch = this.#waiting;
    const epoch = this.#epoch;
    const seq = ++this.#seq;
    this.#waiting = null;
    this.#flying.set(seq, patch);
    this.#times.set(seq, this.#since);
    const settle = (error) => {
      if (epoch !== this.#epoch) return;
      this.#flying.delete(seq);
      if (error) {
        this.#times.delete(seq);
        this.#fail(error, patch);
      } else {
        this.#taken = Math.max(this.#taken, seq);
        this.#done(patch);
      }
      this.#plan();
    };
    this.#send({ seq, patch }).then(() => settle(null), settle);
  }
}
