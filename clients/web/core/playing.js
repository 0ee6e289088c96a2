// SPDX-License-Identifier: Apache-2.0
// The streaks of vectors that move with the clock of the daemon, for all participants. Event: change.
import { Emitter } from './emitter.js';

const SPEED_MAX = 4; // that the slider offers, in periods per second
const SPEED_MIN = 0.02; // 0 would not be playing

/** The speed of a slider's position in [-1, 1], with finer steps towards 0, and back. */
export const speedScale = {
  at: (x) => (x < 0 ? -1 : 1) * Math.max(SPEED_MIN, Number((SPEED_MAX * x * x).toPrecision(2))),
  of: (speed) => Math.sign(speed) * Math.min(1, Math.sqrt(Math.abs(speed) / SPEED_MAX)),
};

export class Playing extends Emitter {
  #call; #stopped; #failed;
  #wanted = null; // the rate that is not asked for yet
  #isAsking = false;
  #speed = 0.5;
  /** Periods per second; 0 = the streaks stand. */
  rate = 0;

  /** call(method, params) → promise; stopped(): the streaks stand, at a phase that only the daemon knows; failed(error). */
  constructor({ call, stopped, failed }) {
    super();
    this.#call = call;
    this.#stopped = stopped;
    this.#failed = failed;
  }

  /** The rate at which play() begins. */
  get speed() { return this.#speed; }

  /** Changes the speed, also while the streaks move. */
  set speed(speed) {
    this.#speed = speed;
    if (this.rate !== 0) this.play();
    this.emit('change');
  }

  play() { this.#ask(this.#speed); }
  stop() { this.#ask(0); }

  /** Takes the rate of the notification time.changed. */
  take(rate) {
    const hasStopped = this.rate !== 0 && rate === 0;
    this.rate = rate;
    if (rate !== 0 && !this.#isAsking) this.#speed = rate;
    this.emit('change');
    if (hasStopped) this.#stopped();
  }

  /** A new stream: the daemon says if the streaks move. */
  reset() {
    this.rate = 0;
    this.emit('change');
  }

  /** Asks for one rate at a time; the newest wins. */
  async #ask(rate) {
    this.#wanted = rate;
    if (this.#isAsking) return;
    this.#isAsking = true;
    while (this.#wanted !== null) {
      const next = this.#wanted;
      this.#wanted = null;
      try {
        await (next === 0 ? this.#call('time.stop', {}) : this.#call('time.play', { rate: next }));
      } catch (error) {
        this.#failed(error);
      }
    }
    this.#isAsking = false;
  }
}
