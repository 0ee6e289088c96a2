// SPDX-License-Identifier: Apache-2.0
// A part of the page that loads on demand: its texts, style sheets and features. What the user asks of a part happens as soon as the part is
// there. Until then its sections say that they load, or why they could not and offer to try again.
import { t, useTexts } from '../../core/text.js';
import { byId, make, showTexts } from '../controls/dom.js';

/** The build replaces it in the page and in each part: a part of another build has other names for what it imports. */
const BUILD = 'BUILD_OF_THE_PAGE';
const PATIENCE_MS = 300; // of a user who pressed a button, until the page says that it loads
const sheets = new Map(); // name → Promise: sheets that are being loaded or apply

/** Loads a file of style/; resolves when it applies. */
function loadSheet(name) {
  if (!sheets.has(name)) {
    sheets.set(name, new Promise((resolve, reject) => {
      const link = make('link', { rel: 'stylesheet', href: `style/${name}.css` });
      link.addEventListener('load', resolve);
      link.addEventListener('error', () => {
        link.remove();
        sheets.delete(name);
        reject(new Error(t('page.part.style')));
      });
      document.head.append(link);
    }));
  }
  return sheets.get(name);
}

/** Another build has served a part. Only the page of that build can use it. */
class OtherBuild extends Error {}

export class Part {
  #app; #import; #styles; #after; #install;
  #loading = null;
  #isInstalled = false;
  #folds = []; // {fold, note}: announced sections
  #waiting = [];
  #id;
  methods = []; // of the notifications that the features need

  /** load() resolves to a module of ../parts/; styles: names of files in style/; after: the parts whose features it needs; install(features). */
  constructor(app, name, { load, styles, after, install }) {
    this.#app = app;
    this.#id = `part-${name}`;
    this.#install = install;
    this.#import = load;
    this.#styles = styles;
    this.#after = after;
  }

  get isInstalled() { return this.#isInstalled; }

  /** Announces a button of the toolbar, see Toolbar.button(). The feature calls button() with the same id. */
  button(options) { this.#app.toolbar.announce(options, (act) => this.ask(act)); }

  /** Announces a section, see Panel.section(). The feature calls section() with the same id. */
  section(options) {
    this.#app.panel.announce(options);
    this.fold(options.id);
  }

  /** Registers a fold of the panel: its contents are loaded when it opens. */
  fold(id) {
    const fold = byId(id);
    const note = make('div', { class: 'part-note', role: 'status' });
    fold.querySelector('summary').after(note);
    fold.setAttribute('aria-busy', 'true');
    this.#folds.push({ fold, note });
    const look = () => fold.open && this.load().catch(() => {}); // the note tells
    fold.addEventListener('toggle', look);
    look();
  }

  /** Announces a function of `app`, which the feature replaces. */
  call(name) { this.#app[name] = (...values) => this.ask(() => this.#app[name](...values)); }

  /** Announces that the features need the notifications of a method. After their installation they receive the notifications that the current stream has sent. */
  notifications(method) { this.methods.push(method); }

  /** Calls act() when the features are installed. */
  whenInstalled(act) {
    if (this.#isInstalled) act();
    else this.#waiting.push(act);
  }

  /** Runs act() as soon as the feature is loaded; tells the user that it is being loaded, or why it cannot be. */
  async ask(act = () => {}) {
    const { prompts } = this.#app;
    const id = this.#id;
    const timer = setTimeout(() => prompts.show(id, { text: t('page.part.loading') }), PATIENCE_MS);
    try {
      await this.load();
    } catch (error) {
      prompts.show(id, { text: reasonText(error), actions: this.#remedies(error, () => this.ask(act)), isUrgent: true });
      return;
    } finally {
      clearTimeout(timer);
    }
    prompts.hide(id);
    act();
  }

  /** Resolves when the features are installed. After a failure the next call tries again. */
  load() {
    this.#loading ??= this.#start().catch((error) => {
      this.#loading = null;
      this.#say(reasonText(error), this.#remedies(error, () => this.load().catch(() => {})));
      throw error;
    });
    return this.#loading;
  }

  async #start() {
    if (this.#folds.length > 0) this.#say(t('page.part.loading'));
    const [{ texts, features, build }] = await Promise.all([
      this.#import(), ...this.#styles.map(loadSheet), ...this.#after.map((part) => part.load()),
    ]);
    if (build !== BUILD) throw new OtherBuild(t('page.part.build'));
    useTexts(texts);
    showTexts(document, (key) => Object.hasOwn(texts, key)); // others have changed since the page began
    this.#install(features);
    this.#isInstalled = true;
    for (const { fold, note } of this.#folds) {
      fold.removeAttribute('aria-busy');
      note.remove();
    }
    for (const act of this.#waiting.splice(0)) act();
  }

  /** Shows in the sections of the part what it waits for. */
  #say(text, actions = []) {
    for (const { note } of this.#folds) {
      note.replaceChildren(make('p', { class: 'about', text }),
        make('div', { class: 'buttons' }, ...actions.map(({ label, press }) => make('button', { text: label, press }))));
    }
  }

  /** What the user can do after a failure. */
  #remedies(error, again) {
    const reload = { label: t('page.part.reload'), press: () => window.location.reload() };
    return error instanceof OtherBuild ? [reload] : [{ label: t('page.part.again'), press: again }, reload];
  }
}

const reasonText = (error) => t('page.incomplete', { reason: error.message });
