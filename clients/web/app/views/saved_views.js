// SPDX-License-Identifier: Apache-2.0
// The gallery of saved views: views that the daemon saved for this token, with names and thumbnails that it renders.
import { t } from '../../core/text.js';
import { ask } from '../controls/ask.js';
import { byId, icon, make } from '../controls/dom.js';
import { saidOfLink } from '../session/people.js';

const THUMBNAIL = [240, 160]; // px: twice the size on the page
const SHOWN_MAX = 60;

/** Renders thumbnails one after another, and only for cards that the user has scrolled to. */
class Thumbnails {
  #app; #observer;
  #waiting = [];
  #isBusy = false;

  constructor(app) {
    this.#app = app;
    this.#observer = new IntersectionObserver((entries) => {
      for (const { isIntersecting, target } of entries) {
        if (!isIntersecting) continue;
        this.#observer.unobserve(target);
        this.#waiting.push(target);
      }
      this.#next();
    });
  }

  watch(image) {
    this.#observer.observe(image);
  }

  async #next() {
    if (this.#isBusy) return;
    this.#isBusy = true;
    for (let image = this.#waiting.shift(); image; image = this.#waiting.shift()) if (image.isConnected) await this.#load(image);
    this.#isBusy = false;
  }

  async #load(image) {
    try {
      const url = URL.createObjectURL(await this.#app.api.thumbnail(image.dataset.view, THUMBNAIL));
      image.addEventListener('load', () => URL.revokeObjectURL(url), { once: true });
      image.src = url;
    } catch (error) {
      image.parentElement.dataset.missing = error.status === 409 ? t('saved.missing') : t('saved.nopicture');
    }
  }
}

export function install(app) {
  const body = byId('capture').querySelector('.fold-body');
  app.saved = new SavedViews(app, body);
  app.saved.onChange(() => app.compare?.listSources());
}

class SavedViews {
  #app; #list; #note; #form; #name; #more; #thumbnails;
  #views = [];
  #isAll = false;
  #folds;
  #told = new Set();

  constructor(app, body) {
    this.#app = app;
    this.#thumbnails = new Thumbnails(app);
    this.#name = make('input', { id: 'saved-name', maxlength: 60, placeholder: t('saved.name'), 'aria-label': t('saved.name'), autocomplete: 'off' });
    this.#form = make('form', { id: 'saved-form', class: 'row' }, this.#name, make('button', { type: 'submit', id: 'saved-add', text: t('saved.add'), title: t('saved.add.title') }));
    this.#list = make('ul', { id: 'saved', 'aria-label': t('saved.section') });
    this.#note = make('p', { class: 'about', id: 'saved-note', role: 'status' });
    this.#more = make('button', { id: 'saved-more', hidden: true, press: () => this.#showAll() });
    body.append(make('h3', { text: t('saved.section') }), this.#form, this.#note, this.#list, this.#more);
    this.#form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.#run(() => this.#add());
    });
    // Only where a fold shows the list: here, or as a choice of the comparison.
    this.#folds = [body.closest('details'), byId('compare')];
    for (const fold of this.#folds) fold.addEventListener('toggle', () => fold.open && this.refresh());
    app.connection.on('session', () => this.#folds.some(({ open }) => open) && this.refresh());
  }

  /** [{id, name, volume}], the newest first. */
  get views() { return this.#views; }

  /** Calls told() when the list changed. */
  onChange(told) { this.#told.add(told); }

  /** What the page calls a saved view. */
  nameOf({ name, volume, id }) {
    return name || volume || id.slice(0, 8);
  }

  get #isPossible() {
    return Boolean(this.#app.api.token) && !this.#app.connection.session?.isJoined;
  }

  async #run(act) {
    try {
      await act();
    } catch (error) {
      this.#note.textContent = error.status === 403 ? t('saved.forbidden', { reason: error.message }) : error.message;
    }
  }

  refresh() {
    return this.#run(async () => {
      this.#form.hidden = !this.#isPossible;
      if (!this.#isPossible) {
        this.#views = [];
        this.#show(t('saved.joined'));
        return;
      }
      const views = await this.#app.api.savedViews();
      this.#views = views.filter(({ volume }) => volume).sort((a, b) => (b.saved ?? 0) - (a.saved ?? 0) || a.id.localeCompare(b.id));
      this.#show(this.#views.length ? '' : t('saved.none'));
    });
  }

  async #add() {
    const { api, viewer } = this.#app;
    if (!viewer.view) return;
    const { id } = await api.saveView(viewer.view);
    const name = this.#name.value.trim();
    if (name) await api.renameView(id, name);
    this.#name.value = '';
    await this.refresh();
  }

  #showAll() {
    this.#isAll = true;
    this.#show('');
  }

  #show(note) {
    const shown = this.#isAll ? this.#views : this.#views.slice(0, SHOWN_MAX);
    const known = new Map([...this.#list.children].map((item) => [item.dataset.key, item]));
    const keyOf = ({ id, name }) => `${id} ${name ?? ''}`;
    this.#list.replaceChildren(...shown.map((view) => known.get(keyOf(view)) ?? this.#card(view, keyOf(view))));
    this.#more.hidden = shown.length === this.#views.length;
    this.#more.textContent = t('saved.more', { count: this.#views.length });
    this.#note.textContent = note;
    for (const told of this.#told) told();
  }

  #card(view, key) {
    const name = this.nameOf(view);
    const image = make('img', { alt: '', 'data-view': view.id, width: 120, height: 80 });
    const item = make('li', { 'data-key': key, 'data-id': view.id },
      make('button', { class: 'picture', 'aria-label': t('saved.go', { name }), title: t('saved.go', { name }), press: () => this.#run(() => this.go(view)) }, image),
      this.#nameField(view, name),
      make('span', { class: 'acts' },
        make('button', { class: 'link', 'aria-label': t('saved.link', { name }), title: t('saved.link', { name }), press: () => this.#run(() => this.#copyLink(view)) }, icon('link')),
        make('button', { class: 'delete', 'aria-label': t('saved.delete', { name }), title: t('saved.delete', { name }), press: () => this.#run(() => this.#delete(view)) }, icon('trash-2'))));
    this.#thumbnails.watch(image);
    return item;
  }

  #nameField(view, name) {
    const field = make('input', { class: 'name', value: view.name ?? '', placeholder: name, maxlength: 60, 'aria-label': t('saved.rename', { name }), title: name });
    field.addEventListener('change', () => this.#run(async () => {
      await this.#app.api.renameView(view.id, field.value.trim() || null);
      await this.refresh();
    }));
    return field;
  }

  /** Goes to a saved view, also of another volume. */
  async go(view) {
    const { api, viewer, notice, connection } = this.#app;
    if (!viewer.canControl) {
      notice.show(t('saved.watching'), 'warning');
      return;
    }
    const volume = connection.volumes.find(({ id }) => id === view.volume);
    if (!volume) {
      notice.show(t('saved.closed', { volume: view.volume }), 'warning');
      return;
    }
    viewer.restore(await api.savedView(view.id));
  }

  async #copyLink(view) {
    const address = `${this.#app.base}#${new URLSearchParams({ view: view.id })}`;
    const isCopied = await navigator.clipboard?.writeText(address).then(() => true, () => false);
    this.#note.textContent = isCopied ? saidOfLink(this.#app, true) : address;
  }

  async #delete(view) {
    if (!await ask(t('saved.delete.ask', { name: this.nameOf(view) }), t('saved.delete.act'))) return;
    await this.#app.api.deleteView(view.id);
    await this.refresh();
    byId('saved-add').focus();
  }
}
