// SPDX-License-Identifier: Apache-2.0
// Loads the volumes of channels, and asks the daemon for what it knows about them: the range of their values, the histogram, and the window.
import { whenReady } from '../../core/ready.js';

export class ChannelVolumes {
  #app; #changed;
  #loading = new Map(); // by field: the id, null until the daemon has answered
  #done = 0; // of the loads that began together
  #known = new Map(); // by id: {range, histogram, window}, or null until the daemon has answered

  /** changed() is called when there is more to show. */
  constructor(app, changed) {
    this.#app = app;
    this.#changed = changed;
  }

  /** {done, count, share} of the fields that are being loaded; null = none. */
  get progress() {
    if (!this.#loading.size) return null;
    const { volumes } = this.#app.connection;
    const shares = [...this.#loading.values()].map((id) => volumes.find((one) => one.id === id)?.progress ?? 0);
    const count = this.#done + shares.length;
    return { done: this.#done, count, share: (this.#done + shares.reduce((a, b) => a + b, 0)) / count };
  }

  /** Loads a field of the volume. Resolves to the id; rejects with the reason. */
  async load(volume, field) {
    const { api, connection } = this.#app;
    this.#loading.set(field, null);
    this.#changed();
    try {
      const { id } = await api.openVolume({ volume, field });
      this.#loading.set(field, id);
      await whenReady(connection, id);
      return id;
    } finally {
      this.#loading.delete(field);
      this.#done = this.#loading.size ? this.#done + 1 : 0;
      this.#changed();
    }
  }

  /** Asks for what is known about a volume: {range, histogram (null: none), window: [low, high]}; null = nothing. */
  async ask(id) {
    const { api } = this.#app;
    this.#known.set(id, null);
    try {
      const [{ range, histogram }, { slices: { window } }] = await Promise.all([api.volume(id), api.volumeView(id)]);
      const half = window.width / 2;
      this.#known.set(id, { range, histogram: histogram ?? null, window: [window.center - half, window.center + half] });
    } catch {
      return null; // a guest may not ask
    }
    this.#changed();
    return this.#known.get(id);
  }

  /** The same if it has been asked for; asks for it the first time. */
  find(id) {
    if (!this.#known.has(id)) this.ask(id);
    return this.#known.get(id);
  }
}
