// SPDX-License-Identifier: Apache-2.0
// Features that the first image does not need are in a part of their own, ../later.js. The page announces their buttons, keys and sections
// at once, so that nothing moves when they arrive, and loads them after the first image, or earlier when the user comes near them. What the
// user asks of them before that happens as soon as they are there.
import { t } from '../../core/text.js';
import { byId } from '../controls/dom.js';

/** The first of these events loads the features: [element, events]. */
const signs = () => [[window, ['pointerdown', 'keydown', 'dragenter']], [byId('tools'), ['pointerover', 'focusin']], [byId('panel'), ['pointerover', 'focusin']]];

export class Announcer {
  #app; #import;
  #loading = null;
  #waiting = [];
  #heard = []; // the notifications of this stream that a feature needs, in their order
  #isComplete = false;

  /** load() resolves to the module with install(app). */
  constructor(app, load) {
    this.#app = app;
    this.#import = load;
    const begin = () => this.#load().catch(() => {}); // ask() tells
    for (const [element, names] of signs()) for (const name of names) element.addEventListener(name, begin, { capture: true, passive: true, once: true });
    const ends = [
      app.frames.on('drawn', begin), app.connection.on('missing', begin), app.connection.on('state', ({ state }) => { if (state === 'live') this.#heard = []; }),
    ];
    this.whenComplete(() => ends.forEach((end) => end()));
    this.#intercept();
  }

  /** True when all features are installed. */
  get isComplete() { return this.#isComplete; }

  /** Announces a button of the toolbar, see Toolbar.button(). The feature calls button() with the same id. */
  button(options) { this.#app.toolbar.announce(options, (act) => this.#ask(act)); }

  /** Announces a section, see Panel.section(). The feature calls section() with the same id. */
  section(options) {
    this.#app.panel.announce(options);
    this.fold(options.id);
  }

  /** Announces what a fold of the panel contains. */
  fold(id) {
    const fold = byId(id);
    const look = () => fold.open && this.#ask(() => {});
    fold.addEventListener('toggle', look);
    look();
  }

  /** Announces a function of `app`, which the feature replaces. */
  call(name) { this.#app[name] = (...values) => this.#ask(() => this.#app[name](...values)); }

  /** Remembers the notifications of a method until the feature is there. */
  notifications(method) {
    const end = this.#app.connection.on('notification', (notification) => { if (notification.method === method) this.#heard.push(notification); });
    this.whenComplete(end);
  }

  /** Calls act() when all features are installed. */
  whenComplete(act) {
    if (this.#isComplete) act();
    else this.#waiting.push(act);
  }

  // A press on a control of index.html whose feature is missing counts when the feature is there.
  #intercept() {
    document.addEventListener('click', (event) => {
      const control = this.#isComplete ? null : event.target.closest?.('[data-later]');
      if (!control) return;
      event.preventDefault();
      event.stopImmediatePropagation();
      this.#ask(() => control.click());
    }, true);
  }

  /** Does what the user asked of a feature; says so if the features cannot be loaded. The next request tries again. */
  async #ask(act) {
    try {
      await this.#load();
    } catch (error) {
      this.#app.notice.show(t('page.incomplete', { reason: error.message }), 'error');
      return;
    }
    act();
  }

  /** Resolves when all features are installed. */
  #load() {
    this.#loading ??= this.#start().catch((error) => {
      this.#loading = null;
      throw error;
    });
    return this.#loading;
  }

  async #start() {
    const { install } = await this.#import();
    const { connection, viewer, transfer } = this.#app;
    const [toNewOnes, ofView] = [connection.late(), viewer.late()];
    install(this.#app);
    this.#isComplete = true;
    for (const act of this.#waiting.splice(0)) act();
    if (connection.volumes.length > 0) toNewOnes('volumes', connection.volumes);
    if (connection.session) toNewOnes('session', { ...connection.session, replaced: null });
    if (viewer.view) ofView('view', viewer.view);
    if (connection.isLive) toNewOnes('state', { state: connection.state, reason: '', retryMs: 0, error: null });
    for (const notification of this.#heard) toNewOnes('notification', notification);
    transfer.plan();
  }
}
