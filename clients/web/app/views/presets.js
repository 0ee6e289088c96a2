// SPDX-License-Identifier: Apache-2.0
// Presets: named rendering choices that the daemon stores for all volumes.

import { byId } from '../controls/dom.js';

const PARTS = ['transfer_function', 'layers', 'filter', 'compositing', 'shading', 'background'];

export function install({ viewer, connection, report }) {
  const presets = new Presets(viewer, {
    api: () => (connection.session && !connection.session.isJoined ? connection.api : null), fail: report,
  });
  connection.on('session', () => presets.refresh());
}

class Presets {
  #viewer; #api; #fail; #key = null;

  /** api(): the daemon's interface, or null if this client may not use presets; fail(Error) shows an error. */
  constructor(viewer, { api, fail }) {
    this.#viewer = viewer;
    this.#api = api;
    this.#fail = fail;
    byId('preset').addEventListener('change', (event) => this.#apply(event.target.value, event.timeStamp));
    byId('preset-delete').addEventListener('click', () => this.#do((api_) => api_.deletePreset(byId('preset').value)));
    byId('preset-form').addEventListener('submit', (event) => {
      event.preventDefault();
      this.#keep(byId('preset-name').value.trim());
    });
    byId('preset').addEventListener('pointerdown', () => this.#list()); // other clients may have saved some
  }

  /** Call when a session starts. */
  refresh() {
    const isAllowed = Boolean(this.#api());
    byId('preset-form').hidden = !isAllowed;
    if (isAllowed) this.#list();
    else byId('preset-row').hidden = true;
  }

  async #list(chosen = byId('preset').value) {
    try {
      const names = await this.#api().presets();
      const key = JSON.stringify(names);
      byId('preset-row').hidden = names.length === 0;
      if (key !== this.#key) byId('preset').replaceChildren(new Option('—', ''), ...names.map((name) => new Option(name, name)));
      this.#key = key;
      byId('preset').value = names.includes(chosen) ? chosen : '';
      byId('preset-delete').disabled = !byId('preset').value;
    } catch (error) {
      this.#fail(error);
    }
  }

  async #do(what, chosen = '') {
    try {
      await what(this.#api());
      await this.#list(chosen);
    } catch (error) {
      this.#fail(error);
    }
  }

  async #apply(name, time) {
    byId('preset-delete').disabled = !name;
    if (name) await this.#do(async (api) => this.#viewer.change(await api.preset(name), time), name);
  }

  async #keep(name) {
    const { view } = this.#viewer;
    if (!name || !view) return;
    await this.#do((api) => api.putPreset(name, Object.fromEntries(PARTS.map((part) => [part, view[part]]))), name);
    byId('preset-name').value = '';
  }
}
