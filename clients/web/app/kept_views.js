// SPDX-License-Identifier: Apache-2.0
// The gallery of kept views: views that the daemon saved for this token, with names and thumbnails that it renders.
import { t } from '../core/text.js';
import { ask } from './ask.js';
import { byId, icon, make } from './dom.js';

const THUMBNAIL = [240, 160]; // px: twice the size on the page
const SHOWN_MAX = 60;

/** Renders thumbnails one after another, and only those of cards that were seen. */
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
      image.parentElement.dataset.missing = error.status === 409 ? t('kept.missing') : t('kept.nopicture');
    }
  }
}

export function install(app) {
  const body = byId('capture').querySelector('.fold-body');
  app.kept = new KeptViews(app, body);
}

class KeptViews {
  #app; #list; #note; #form; #name; #more; #thumbnails;
  #views = [];
  #isAll = false;
  #told = new Set();

  constructor(app, body) {
    this.#app = app;
    this.#thumbnails = new Thumbnails(app);
    this.#name = make('input', { id: 'kept-name', maxlength: 60, placeholder: t('kept.name'), 'aria-label': t('kept.name'), autocomplete: 'off' });
    this.#form = make('form', { id: 'kept-form', class: 'row' }, this.#name, make('button', { type: 'submit', id: 'kept-add', text: t('kept.add'), title: t('kept.add.title') }));
    this.#list = make('ul', { id: 'kept', 'aria-label': t('kept.section') });
    this.#note = make('p', { class: 'about', id: 'kept-note', role: 'status' });
    this.#more = make('button', { id: 'kept-more', hidden: true, press: () => this.#showAll() });
    body.append(make('h3', { text: t('kept.section') }), this.#form, this.#note, this.#list, this.#more);
    this.#form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.#run(() => this.#add());
    });
    const fold = body.closest('details');
    fold.addEventListener('toggle', () => fold.open && this.refresh());
    app.connection.on('session', () => this.refresh());
  }

  /** [{id, name, volume}], the newest first. */
  get views() { return this.#views; }

  /** Calls told() when the list changed. */
  onChange(told) { this.#told.add(told); }

  /** What the page calls a kept view. */
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
      this.#note.textContent = error.status === 403 ? t('kept.forbidden', { reason: error.message }) : error.message;
    }
  }

  refresh() {
    return this.#run(async () => {
      this.#form.hidden = !this.#isPossible;
      if (!this.#isPossible) {
        this.#views = [];
        this.#show(t('kept.joined'));
        return;
      }
      const views = await this.#app.api.keptViews();
      this.#views = views.filter(({ volume }) => volume).sort((a, b) => (b.saved ?? 0) - (a.saved ?? 0) || a.id.localeCompare(b.id));
      this.#show(this.#views.length ? '' : t('kept.none'));
    });
  }

  async #add() {
    const { api, viewer } = this.#app;
    if (!viewer.view) return;
    const { id } = await api.keepView(viewer.view);
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
    this.#more.textContent = t('kept.more', { count: this.#views.length });
    this.#note.textContent = note;
    for (const told of this.#told) told();
  }

  #card(view, key) {
    const name = this.nameOf(view);
    const image = make('img', { alt: '', 'data-view': view.id, width: 120, height: 80 });
    const item = make('li', { 'data-key': key, 'data-id': view.id },
      make('button', { class: 'picture', 'aria-label': t('kept.go', { name }), title: t('kept.go', { name }), press: () => this.#run(() => this.go(view)) }, image),
      this.#nameField(view, name),
      make('span', { class: 'acts' },
        make('button', { class: 'link', 'aria-label': t('kept.link', { name }), title: t('kept.link', { name }), press: () => this.#run(() => this.#copyLink(view)) }, icon('link')),
        make('button', { class: 'delete', 'aria-label': t('kept.delete', { name }), title: t('kept.delete', { name }), press: () => this.#run(() => this.#delete(view)) }, icon('trash-2'))));
    this.#thumbnails.watch(image);
    return item;
  }

  #nameField(view, name) {
    const field = make('input', { class: 'name', value: view.name ?? '', placeholder: name, maxlength: 60, 'aria-label': t('kept.rename', { name }), title: name });
    field.addEventListener('change', () => this.#run(async () => {
      await this.#app.api.renameView(view.id, field.value.trim() || null);
      await this.refresh();
    }));
    return field;
  }

  /** Goes to a kept view, also of another volume. */
  async go(view) {
    const { api, viewer, notice, connection } = this.#app;
    if (!viewer.canControl) {
      notice.show(t('kept.watching'));
      return;
    }
    const volume = connection.volumes.find(({ id }) => id === view.volume);
    if (!volume) {
      notice.show(t('kept.closed', { volume: view.volume }));
      return;
    }
    viewer.restore(await api.keptView(view.id));
  }

  async #copyLink(view) {
    const address = `${this.#app.base}#${new URLSearchParams({ view: view.id })}`;
    const isCopied = await navigator.clipboard?.writeText(address).then(() => true, () => false);
    this.#note.textContent = isCopied ? t('people.copied') : address;
  }

  async #delete(view) {
    if (!await ask(t('kept.delete.ask', { name: this.nameOf(view) }), t('kept.delete.act'))) return;
    await this.#app.api.deleteView(view.id);
    await this.refresh();
    byId('kept-add').focus();
  }
}
