// SPDX-License-Identifier: Apache-2.0
// Features that the first image does not need are in parts of their own (part.js). The page announces their buttons, keys and sections at once,
// so that nothing moves when they arrive. It loads a part when the user asks for it, and the others one after another after the first image, or
// earlier when the user comes near them.
import { byId } from '../controls/dom.js';
import { Part } from './part.js';

/** The first of these events loads the parts: [element, events]. */
const signs = () => [[window, ['pointerdown', 'keydown', 'dragenter']], [byId('tools'), ['pointerover', 'focusin']], [byId('panel'), ['pointerover', 'focusin']]];

export class Announcer {
  #app;
  #parts = new Map(); // by name
  #hasTried = false; // on this stream, to load all parts
  #heard = []; // the notifications of this stream that parts need

  constructor(app) {
    this.#app = app;
    const begin = () => this.#loadAll();
    for (const [element, names] of signs()) for (const name of names) element.addEventListener(name, begin, { capture: true, passive: true, once: true });
    const { connection, frames } = app;
    frames.on('drawn', begin);
    connection.on('missing', begin);
    connection.on('state', ({ state }) => {
      if (state !== 'live') return;
      this.#hasTried = false;
      this.#heard = [];
    });
    connection.on('notification', (notification) => {
      if (this.#missing.some(({ methods }) => methods.includes(notification.method))) this.#heard.push(notification);
    });
    document.addEventListener('click', (event) => this.#intercept(event), true);
  }

  get #missing() { return [...this.#parts.values()].filter(({ isInstalled }) => !isInstalled); }

  /** True when all parts are installed. */
  get isComplete() { return this.#missing.length === 0; }

  /** Announces a part and returns it; see Part. */
  part(name, load, { styles = [], after = [] } = {}) {
    const part = new Part(this.#app, name, { load, styles, after, install: (features) => this.#install(features, part.methods) });
    this.#parts.set(name, part);
    return part;
  }

  /** Calls act() when a part is installed. */
  whenInstalled(name, act) { this.#parts.get(name).whenInstalled(act); }

  // A press on a control of index.html whose feature is missing counts when the feature is there.
  #intercept(event) {
    const control = event.target.closest?.('[data-later]');
    const part = this.#parts.get(control?.dataset.later);
    if (!part || part.isInstalled) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    part.ask(() => control.click());
  }

  /** Loads all parts one after another, once per stream: a part that fails loads when the user asks for it or the stream is new. */
  async #loadAll() {
    if (this.#hasTried) return;
    this.#hasTried = true;
    for (const part of this.#missing) await part.load().catch(() => {}); // Part tells the user
  }

  /** Installs features and tells them what they missed. */
  #install(features, methods) {
    const { connection, viewer, transfer } = this.#app;
    const [toNewOnes, ofView] = [connection.late(), viewer.late()];
    for (const install of features) install(this.#app);
    if (connection.volumes.length > 0) toNewOnes('volumes', connection.volumes);
    if (connection.session) toNewOnes('session', { ...connection.session, replaced: null });
    if (viewer.view) ofView('view', viewer.view);
    if (connection.isLive) toNewOnes('state', { state: connection.state, reason: '', retryMs: 0, error: null });
    for (const notification of this.#heard) if (methods.includes(notification.method)) toNewOnes('notification', notification);
    transfer.plan();
  }
}
