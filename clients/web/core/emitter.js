// SPDX-License-Identifier: Apache-2.0
// Named events with one payload. A listener that throws does not stop the other listeners.

export class Emitter {
  #listeners = new Map();

  on(name, listener) {
    if (!this.#listeners.has(name)) this.#listeners.set(name, new Set());
    this.#listeners.get(name).add(listener);
    return () => this.#listeners.get(name).delete(listener);
  }

  emit(name, payload) {
    this.#tell(this.#listeners.get(name) ?? [], payload);
  }

  /** Returns emit() for the listeners that are added from now on, which so hear what they missed. */
  late() {
    const before = new Set([...this.#listeners.values()].flatMap((all) => [...all]));
    return (name, payload) => this.#tell([...this.#listeners.get(name) ?? []].filter((listener) => !before.has(listener)), payload);
  }

  #tell(listeners, payload) {
    for (const listener of listeners) {
      try {
        listener(payload);
      } catch (error) {
        queueMicrotask(() => { throw error; });
      }
    }
  }
}
