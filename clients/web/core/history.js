// SPDX-License-Identifier: Apache-2.0
// Undo and redo: a list of states and the place of the current one.

const MOST = 200;

export class History {
  #states = [];
  #at = -1;
  #gesture = null;
  #steps = 0;

  get current() { return this.#states[this.#at] ?? null; }
  /** Grows with each step, backwards and forwards. */
  get steps() { return this.#steps; }
  get canUndo() { return this.#at > 0; }
  get canRedo() { return this.#at + 1 < this.#states.length; }

  /** Starts again with one state. */
  reset(state) {
    this.#states = [state];
    this.#at = 0;
    this.#gesture = null;
  }

  /** Records a state. The states of one gesture, such as a drag, count as one state; null = a gesture of its own. Drops the states that were undone.
   */
  put(state, gesture = null) {
    const isMore = gesture !== null && gesture === this.#gesture && this.#at > 0;
    this.#states = [...this.#states.slice(0, isMore ? this.#at : this.#at + 1), state].slice(-MOST);
    this.#at = this.#states.length - 1;
    this.#gesture = gesture;
    this.#steps += 1;
  }

  /** Replaces the current state; it does not count as a step. */
  amend(state) {
    this.#states[this.#at] = state;
  }

  /** Ends the gesture: the next state counts by itself. */
  seal() {
    this.#gesture = null;
  }

  /** The state before, or null. */
  undo() {
    if (!this.canUndo) return null;
    this.#gesture = null;
    this.#at -= 1;
    this.#steps += 1;
    return this.current;
  }

  /** The state after, or null. */
  redo() {
    if (!this.canRedo) return null;
    this.#gesture = null;
    this.#at += 1;
    this.#steps += 1;
    return this.current;
  }
}
