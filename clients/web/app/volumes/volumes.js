// SPDX-License-Identifier: Apache-2.0
// The section "Volumes" of the panel: the list of the daemon's volumes, opening and closing them.
import { contentsText } from '../../core/kinds.js';
import { volumesOf } from '../../core/layers.js';
import { t } from '../../core/text.js';
import { fullNameOf, grouped, nameOf, placeOf } from '../../core/volume_names.js';
import { ask } from '../controls/ask.js';
import { byId, icon, make, setText } from '../controls/dom.js';
import { VolumeField } from './volume_field.js';
import { VolumeInfo } from './volume_info.js';

const LIST_MS = 500;
const MANY = 8; // from this number on, rows have one line, and there is a filter
const FAILED_SHOWN = 2; // more failed loads are folded
const BELOW = 84; // px below the panel, as in style.css
const LEAST = 0.34; // of the height of the window, which the list may have whatever is below it

function describe(volume) {
  if (volume.state === 'failed') return t('volumes.failed', { reason: volume.reason || t('volumes.failed.noreason') });
  if (volume.state === 'loading') return t('volumes.loading', { percent: Math.round((volume.progress ?? 0) * 100) });
  return contentsText(volume);
}

/** The button that shows the volume. `volumes` are all, whose names may be equal. */
function picker(volume, volumes, current, select) {
  const about = [placeOf(volume, volumes), describe(volume)].filter(Boolean).join(' · ');
  const button = make('button', {
    class: 'pick', 'data-id': volume.id, 'data-state': volume.state, 'aria-current': volume.id === current ? 'true' : false,
    disabled: volume.state !== 'ready', press: () => select(volume.id),
  }, make('span', { class: 'name', text: nameOf(volume), title: fullNameOf(volume, volumes) }), make('span', { class: 'about', text: about }));
  if (volume.state === 'loading') {
    const progress = make('progress', { max: 1, 'aria-label': t('volumes.loading.name', { name: nameOf(volume) }) });
    progress.value = volume.progress ?? 0;
    button.append(progress);
  }
  return button;
}

function closeText(volume, volumes) {
  const name = fullNameOf(volume, volumes);
  if (volume.state === 'failed') return t('volumes.remove', { name });
  return volume.state === 'loading' ? t('volumes.cancel', { name }) : t('volumes.close', { name });
}

class VolumeList {
  #app; #info; #field;
  #list = byId('volumes');
  #filter = byId('volumes-filter');
  #isFolded = null; // whether the user folded the failed loads; null = the user did not choose
  #shown = ''; // what the list shows, as text
  #timer = null; // of the next refresh
  #unknown = ''; // volumes that the view names and the list lacks
  #seen = null; // the volume in the picture
  #left = null; // the volume before it, if the daemon or another participant changed it

  constructor(app) {
    this.#app = app;
    new ResizeObserver(() => this.#reveal()).observe(this.#list);
    this.#info = new VolumeInfo(app, byId('volume-info'));
    this.#field = new VolumeField(app);
    byId('volume-info').before(this.#field.root);
    this.#filter.addEventListener('input', () => this.#refill());
    this.#filter.addEventListener('keydown', (event) => {
      if (event.key === 'Enter') this.#list.querySelector('.pick:not(:disabled)')?.click();
    });
    byId('panel-body').addEventListener('toggle', () => this.#fit(), { capture: true });
    window.addEventListener('resize', () => this.#fit());
  }

  get #current() { return this.#app.viewer.view?.volume; }

  /** Follows the view. */
  follow() {
    const isOther = this.#current !== this.#seen;
    if (isOther) [this.#left, this.#seen] = [this.#seen, this.#current];
    this.#learn();
    this.show();
    if (isOther) this.#reveal();
  }

  /** Another participant may show a volume that is not in the list yet: asks for it once. A guest's list has the volumes of the session only. */
  #learn() {
    const { connection, viewer } = this.#app;
    if (!viewer.isCurrent) return; // the daemon does not know yet
    const unknown = String(volumesOf(viewer.view).filter((id) => !connection.volumes.some((volume) => volume.id === id)));
    if (unknown && unknown !== this.#unknown) this.#read();
    this.#unknown = unknown;
  }

  async #read() {
    const { connection } = this.#app;
    if (!connection.isLive) return; // the list is read with the next stream
    try {
      await connection.refresh();
    } catch { // the stream reports a lost daemon
      if (!this.#unknown) return;
      this.#unknown = '';
      this.refresh();
    }
  }

  #select(id) {
    this.#app.viewer.selectVolume(id);
    this.#left = null;
  }

  /** Says that a volume was closed which the user saw. The daemon may show another volume before or after it says so. */
  tellClosed(id) {
    if (![this.#current, this.#left].includes(id)) return;
    const known = this.#app.connection.volumes.find((volume) => volume.id === id);
    this.#app.notice.show(t('volumes.closed', { name: known ? nameOf(known) : id }), 'warning');
  }

  show() {
    const { volumes, session } = this.#app.connection;
    const { mayOpen } = this.#app;
    byId('open-button').hidden = !mayOpen;
    byId('volumes-section').hidden = volumes.length === 0 && !mayOpen;
    byId('volumes-why').hidden = !session?.isJoined;
    const current = volumes.find(({ id }) => id === this.#current) ?? null;
    this.#info.show(current);
    this.#field.show(current);
    const shown = JSON.stringify([this.#current, volumes.map((v) => [v.id, v.name, v.source, describe(v), v.progress, v.may_close])]);
    if (shown === this.#shown) return;
    this.#shown = shown;
    this.#refill();
  }

  #refill() {
    this.#rebuild(this.#app.connection.volumes);
    this.#fit();
  }

  /** Gives the list the height that the rest of the panel leaves. */
  #fit() {
    const body = byId('panel-body');
    const { height } = body.getBoundingClientRect();
    const inner = body.lastElementChild.getBoundingClientRect().bottom - body.firstElementChild.getBoundingClientRect().top;
    const rest = inner - this.#list.offsetHeight;
    const most = Math.max(height, window.innerHeight - body.getBoundingClientRect().top - BELOW);
    this.#list.style.maxHeight = `${Math.round(Math.max(LEAST * window.innerHeight, most - rest))}px`;
  }

  /** Scrolls the list to the current volume. */
  #reveal() {
    const entry = this.#list.querySelector('[aria-current]')?.closest('li');
    if (!entry) return;
    const [list, { top, bottom }] = [this.#list.getBoundingClientRect(), entry.getBoundingClientRect()];
    if (top < list.top || bottom > list.bottom) this.#list.scrollTop += (top + bottom - list.top - list.bottom) / 2;
  }

  /** Rebuilds the list; the focus and the scroll position stay. */
  #rebuild(volumes) {
    const focused = document.activeElement?.closest?.('#volumes button')?.dataset.id;
    const { scrollTop } = this.#list;
    const isMany = volumes.length >= MANY;
    this.#filter.hidden = !isMany;
    this.#list.toggleAttribute('data-many', isMany);
    const { open, failed } = grouped(volumes, isMany ? this.#filter.value : '');
    const entries = (some) => some.map((volume) => this.#entry(volume, volumes));
    this.#list.replaceChildren(...entries(open), ...(failed.length ? [this.#failures(failed, entries(failed))] : []));
    if (volumes.length && !this.#list.childElementCount) this.#list.append(make('li', { class: 'about', text: t('volumes.nomatch') }));
    this.#list.scrollTop = scrollTop;
    for (const button of this.#list.querySelectorAll('button')) if (focused && button.dataset.id === focused) button.focus();
  }

  #entry(volume, volumes) {
    const item = make('li', { 'data-state': volume.state }, picker(volume, volumes, this.#current, (id) => this.#select(id)));
    if (volume.may_close) {
      const label = closeText(volume, volumes);
      const press = () => this.#close(volume);
      item.append(make('button', { class: 'close', 'data-id': `close:${volume.id}`, 'aria-label': label, title: label, press }, icon('x')));
    }
    return item;
  }

  /** The group of the loads that failed: they can be removed at once. */
  #failures(volumes, entries) {
    const mine = volumes.filter((volume) => volume.may_close);
    const isOpen = !(this.#isFolded ?? volumes.length > FAILED_SHOWN);
    const fold = make('details', { class: 'fold', open: isOpen }, make('summary', { text: t('volumes.failures', { count: volumes.length }) }), make('ul', {}, ...entries));
    fold.addEventListener('toggle', () => { if (fold.open !== isOpen) this.#isFolded = !fold.open; });
    const remove = make('button', { class: 'link', 'data-id': 'failures', text: t('volumes.failures.remove'), press: () => this.#remove(mine) });
    return make('li', { class: 'failures' }, fold, ...(mine.length > 1 ? [remove] : []));
  }

  /** Removes failed loads from the list. */
  async #remove(volumes) {
    const { api, notice } = this.#app;
    for (const { id, name } of volumes) {
      try {
        await api.closeVolume(id);
      } catch (error) {
        if (error.status !== 404) notice.show(t('volumes.close.failed', { name: name || id, reason: error.message }), 'error');
      }
    }
    this.#read();
  }

  /** True if others see the volume: in this session or in another one. */
  async #isWatched({ id, state }) {
    const { api, compare, participants } = this.#app;
    if (state !== 'ready') return false;
    if (id === this.#current && participants.count > 1) return true;
    const own = [this.#current, compare?.volume].filter((shown) => shown === id).length;
    try {
      return (await api.volume(id)).sessions > own;
    } catch {
      return false; // to close it will say what is wrong
    }
  }

  async #close(volume) {
    const { api, connection, notice } = this.#app;
    const name = fullNameOf(volume, connection.volumes);
    if (await this.#isWatched(volume) && !await ask(t('volumes.close.ask', { name }), t('volumes.close.act'))) return;
    try {
      await api.closeVolume(volume.id);
    } catch (error) {
      if (error.status !== 404) notice.show(t('volumes.close.failed', { name, reason: error.message }), 'error');
    }
    if (this.#list.contains(document.activeElement)) this.#list.querySelector('button:not(:disabled)')?.focus();
    this.#read();
  }

  /** Reads the list again after LIST_MS. */
  refresh() {
    this.#timer ??= setTimeout(() => {
      this.#timer = null;
      this.#read();
    }, LIST_MS);
  }
}

export function install(app) {
  const { connection, viewer } = app;
  const list = new VolumeList(app);
  viewer.on('view', () => list.follow());
  connection.on('session', () => list.show());
  connection.on('volumes', (volumes) => {
    list.show();
    if (connection.isLive && volumes.some(({ state }) => state === 'loading')) list.refresh();
  });
  connection.on('notification', ({ method, params }) => {
    if (method !== 'volume.progress') return;
    if (params.state === 'unloaded') list.tellClosed(params.volume);
    list.refresh();
  });
  document.addEventListener('visibilitychange', () => !document.hidden && list.refresh());
}
