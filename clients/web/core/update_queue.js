// SPDX-License-Identifier: Apache-2.0
// Throttles view.update. Changes between two sends are merged into one patch. At most one patch is sent per animation frame,
// and none while `limit` updates are unanswered. The last change is always sent, so that the last frame shows the last view.
import { joinPatches } from './merge.js';

export class UpdateQueue {
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
  #times = new Map(); // by seq: {since, sent}
  #waited = 0;
  #arrivals = []; // {seq, resolve} of arrived()
  #pictures = new Set(); // accepted updates that no drawn frame shows yet, but one will

  /**
   * send({seq, patch}) → Promise of the answer, whose same_image says that no frame follows; schedule(f) calls f at the next animation frame; now() in ms; done(patch)
   * reports an accepted update, fail(error, patch) a refused one. At most `limit` updates are unanswered.
   */
  constructor({ send, schedule, now, done = /** @type {Function} */ (() => {}), fail, limit = 32 }) {
    this.#send = send;
    this.#schedule = schedule;
    this.#now = now;
    this.#done = done;
    this.#fail = fail;
    this.#limit = limit;
  }

  /** The newest seq that was sent on this stream and not refused; a frame will show it. 0 before the first. */
  get sent() { return Math.max(this.#taken, ...this.#flying.keys()); }
  /** The newest seq that a drawn frame shows, or that needs no frame. */
  get drawn() { return this.#drawn; }
  /** The number of unanswered updates. */
  get unanswered() { return this.#flying.size; }
  /** True if a patch waits to be sent. */
  get isWaiting() { return this.#waiting !== null; }
  /** True if no update waits and none is unanswered. */
  get isIdle() { return !this.#waiting && this.#flying.size === 0; }

  /** Resolves when the daemon has answered all that was put before, or when the stream is lost. */
  arrived() {
    const seq = this.#seq + Number(this.isWaiting);
    return new Promise((resolve) => {
      this.#arrivals.push({ seq, resolve });
      this.#arrive();
    });
  }

  #arrive() {
    const isHere = ({ seq }) => !this.#open || ![...this.#flying.keys()].some((key) => key <= seq) && (seq <= this.#seq || !this.#waiting);
    for (const { resolve } of this.#arrivals.filter(isHere)) resolve();
    this.#arrivals = this.#arrivals.filter((one) => !isHere(one));
  }

  /** Merges `patch` into the waiting patch. `time` is the time of the user's action. `alone` drops the waiting patch first. */
  put(patch, { time = this.#now(), alone = false } = {}) {
    if (this.#waiting && !alone) {
      this.#waiting = joinPatches(this.#waiting, patch);
    } else {
      this.#waiting = patch;
      this.#since = time;
    }
    this.#plan();
  }

  /** Starts sending on a new stream, whose seq counts from 1. */
  open() {
    this.#open = true;
    this.#seq = 0;
    this.#taken = 0;
    this.#drawn = 0;
    this.#pictures.clear();
    this.#plan();
  }

  /** Stops sending because the stream is gone. Unanswered patches wait again, older first, because they may be lost. */
  close() {
    this.#open = false;
    this.#epoch += 1;
    const lost = [...this.#flying.values()];
    this.#flying.clear();
    this.#times.clear();
    this.#arrive();
    if (!lost.length) return;
    const joined = lost.reduce(joinPatches);
    this.#since = this.#waiting ? this.#since : this.#now();
    this.#waiting = this.#waiting ? joinPatches(joined, this.#waiting) : joined;
  }

  /** Drops the waiting patch, because the whole view has been replaced. */
  drop() {
    this.#waiting = null;
    this.#arrive();
  }

  /** How long the update of the newest show() waited to be sent, in ms. */
  get waited() { return this.#waited; }

  /** Reports a drawn frame that shows `seq`. Returns the time since the user's action in ms, or null if it is unknown. */
  show(seq) {
    if (seq <= this.#drawn || seq > this.#seq) return null;
    this.#drawn = seq;
    for (const key of this.#pictures) if (key <= seq) this.#pictures.delete(key);
    this.#skip();
    const then = this.#times.get(seq);
    for (const key of this.#times.keys()) if (key <= seq) this.#times.delete(key);
    if (!then) return null;
    this.#waited = then.sent - then.since;
    return this.#now() - then.since;
  }

  /** Counts updates that gave no new picture as drawn, once all before them are. */
  #skip() {
    const isOlder = (seq) => seq < this.#taken;
    if (this.#pictures.size === 0 && ![...this.#flying.keys()].some(isOlder)) this.#drawn = Math.max(this.#drawn, this.#taken);
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
    this.#times.set(seq, { since: this.#since, sent: this.#now() });
    const settle = (error, answer) => {
      if (epoch !== this.#epoch) return;
      this.#flying.delete(seq);
      if (error) {
        this.#times.delete(seq);
        this.#fail(error, patch);
      } else {
        this.#taken = Math.max(this.#taken, seq);
        if (answer?.same_image) this.#times.delete(seq);
        else if (seq > this.#drawn) this.#pictures.add(seq);
        this.#skip();
        this.#done(patch);
      }
      this.#arrive();
      this.#plan();
    };
    this.#send({ seq, patch }).then((answer) => settle(null, answer), settle);
  }
}
