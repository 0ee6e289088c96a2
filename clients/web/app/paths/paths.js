// SPDX-License-Identifier: Apache-2.0
// The list of the daemon's camera paths: progress, download, cancel and delete.
import { t } from '../../core/text.js';
import { ask } from '../controls/ask.js';
import { byId, setText } from '../controls/dom.js';
import { shortBytes } from '../status/status.js';

/** Each event stream takes one of the few connections that a browser opens to a daemon, over all tabs. */
const WATCHES_MAX = 2;
/** Interval in ms at which the list is read while unwatched paths are in progress. */
const LIST_MS = 3000;
const NAMES = { webm: 'WebM', png: 'PNG', jpeg: 'JPEG', webp: 'WebP', exr: 'EXR' };
const RANK = ['running', 'waiting'];

const isUnderWay = ({ state }) => RANK.includes(state);

function stateText({ state, reason, done, frames, bytes }) {
  const count = t('paths.count', { done, frames });
  const size = bytes > 0 ? [shortBytes(bytes)] : [];
  const because = reason ? `: ${reason}` : '';
  switch (state) {
    case 'waiting': return [t('paths.waiting'), ...(done ? [count] : [])].join(', ') + because;
    case 'running': return [count, ...size].join(', ');
    case 'failed': return t('paths.failed', { count }) + because;
    case 'done': return [t('paths.done'), ...size].join(', ');
    default: return state;
  }
}

/** The daemon's interface for camera paths, or null: a client that joined by a link has no token of the daemon. */
export const pathApi = ({ api }) => (api.token ? api : null);

export function install(app) {
  const { connection, notice, report } = app;
  const paths = new Paths({
    api: () => pathApi(app), fail: report, say: (text) => notice.show(text),
    explain: (text) => {
      byId('path-note').textContent = text;
      byId('path-note').hidden = !text;
      byId('path-making').hidden = Boolean(text);
    },
  });
  connection.on('session', () => paths.refresh());
  app.paths = paths;
}

class Paths {
  #api; #fail; #say; #explain;
  #paths = new Map(); // id → path, in the order of the list
  #entries = new Map();
  #watches = new Map(); // id → AbortController
  #timer = null;
  #epoch = 0;
  #ended = ''; // the result of the last path

  /**
   * api(): the daemon's interface, or null without its token; fail(Error) and say(text) show messages; explain(text) shows why
   * there are no paths, or ''.
   */
  constructor({ api, fail, say, explain }) {
    this.#api = api;
    this.#fail = fail;
    this.#say = say;
    this.#explain = explain;
    byId('path').addEventListener('toggle', ({ target }) => {
      if (!target.open) return;
      target.scrollIntoView({ block: 'start' }); // it is the last section of the panel
      this.refresh(); // other clients may have added some
    });
    document.addEventListener('visibilitychange', () => (document.hidden ? this.#plan() : this.refresh()));
  }

  /** Reads the list and watches paths in progress. */
  async refresh() {
    const api = this.#api();
    const epoch = ++this.#epoch;
    if (!api) {
      this.#take([]);
      this.#explain(t('paths.joined'));
      return;
    }
    try {
      const paths = await api.paths();
      if (epoch !== this.#epoch) return;
      this.#explain('');
      this.#take(paths);
    } catch (error) {
      if (epoch !== this.#epoch) return;
      if ([401, 403].includes(error.status)) {
        this.#take([]);
        this.#explain(t('paths.forbidden', { reason: error.message }));
      }
      this.#plan(); // tries again later
    }
  }

  /** Adds a path that the daemon accepted from this page. */
  add(path) {
    this.#epoch += 1; // a list that is still loading does not contain it
    this.#paths = new Map([[path.id, path], ...this.#paths]);
    this.#show();
    byId('paths').firstElementChild.scrollIntoView({ block: 'nearest' });
    this.#plan();
  }

  /** Takes the list of paths. Known paths keep their order. New paths come before them, sorted by state: paths in progress first. */
  #take(paths) {
    const found = new Map(paths.map((path) => [path.id, path]));
    const rank = ({ state }) => (RANK.includes(state) ? RANK.indexOf(state) : RANK.length);
    const fresh = paths.filter(({ id }) => !this.#paths.has(id)).sort((a, b) => rank(a) - rank(b));
    const known = [...this.#paths.keys()].filter((id) => found.has(id)).map((id) => found.get(id));
    this.#paths = new Map([...fresh, ...known].map((path) => [path.id, path]));
    this.#show();
    this.#plan();
  }

  /** Watches as many paths as allowed and polls the list for the others. A hidden tab does neither. */
  #plan() {
    clearTimeout(this.#timer);
    for (const [id, watch] of this.#watches) if (document.hidden || !this.#paths.has(id)) watch.abort();
    if (document.hidden) return;
    const waiting = [...this.#paths.values()].filter((path) => isUnderWay(path) && !this.#watches.has(path.id))
      .sort((a, b) => RANK.indexOf(a.state) - RANK.indexOf(b.state));
    for (const { id } of waiting.splice(0, WATCHES_MAX - this.#watches.size)) this.#watch(id);
    this.#timer = waiting.length ? setTimeout(() => this.refresh(), LIST_MS) : null;
  }

  async #watch(id) {
    const abort = new AbortController();
    this.#watches.set(id, abort);
    let isOver = false;
    const told = (event, path) => {
      if (!this.#paths.has(id)) return;
      if (event === 'removed') this.#forget(id);
      else this.#paths.set(id, path);
      isOver = event !== 'progress';
      if (['done', 'failed'].includes(event)) this.#ended = t(`paths.ended.${event}`);
      this.#show();
      if (event === 'done') this.#tell(t('paths.told.done', { volume: path.volume, frames: path.frames }));
      if (event === 'failed') this.#tell(t('paths.told.failed', { volume: path.volume, reason: path.reason }));
    };
    try {
      await this.#api().watchPath(id, told, abort.signal);
    } catch (error) {
      if (error.status === 404) this.#forget(id);
    }
    this.#watches.delete(id);
    if (isOver || abort.signal.aborted || !this.#paths.has(id)) {
      this.#show();
      this.#plan();
      return;
    }
    // The stream broke off: reads the list again after a delay.
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.refresh(), LIST_MS);
  }

  /** Shows a notice if the list is not visible, otherwise the summary, which screen readers read aloud. */
  #tell(text) {
    if (!byId('paths').checkVisibility()) this.#say(text);
  }

  #forget(id) {
    this.#paths.delete(id);
  }

  // The list.

  #show() {
    const paths = [...this.#paths.values()];
    const owners = new Set(paths.map(({ owner }) => owner));
    const busy = paths.filter(isUnderWay).length;
    setText(byId('path-busy'), busy ? t('paths.busy', { count: busy }) : this.#ended);
    byId('paths-title').hidden = paths.length === 0;
    for (const id of this.#entries.keys()) if (!this.#paths.has(id)) this.#remove(id);
    paths.forEach((path, i) => {
      if (!this.#entries.has(path.id)) this.#entries.set(path.id, this.#entry(path));
      const { item, update } = this.#entries.get(path.id);
      update(path, owners.size > 1 ? path.owner : '');
      if (byId('paths').children[i] !== item) byId('paths').insertBefore(item, byId('paths').children[i] ?? null);
    });
  }

  #remove(id) {
    const { item } = this.#entries.get(id);
    const hadFocus = item.contains(document.activeElement);
    const next = item.nextElementSibling ?? item.previousElementSibling;
    item.remove();
    this.#entries.delete(id);
    if (hadFocus) (next?.querySelector('.delete') ?? byId('path').querySelector('summary')).focus();
  }

  #entry({ id }) {
    const item = byId('path-entry').content.firstElementChild.cloneNode(true);
    const find = (name) => item.querySelector(`.${name}`);
    item.dataset.id = id;
    find('save').addEventListener('click', () => this.#save(id));
    find('delete').addEventListener('click', () => this.#delete(id));
    return {
      item,
      update: (path, owner) => {
        const { volume, size, format, frames, done, fps, state } = path;
        item.dataset.state = state;
        setText(find('name'), volume);
        setText(find('about'), [`${size.join(' × ')} ${NAMES[format] ?? format}`, t('paths.about', { frames, fps }), owner].filter(Boolean).join(' · '));
        setText(find('state'), stateText(path));
        const bar = find('progress');
        bar.hidden = !isUnderWay(path);
        bar.max = frames;
        bar.value = done;
        bar.setAttribute('aria-label', t('paths.rendering', { volume }));
        setText(find('save'), t(format === 'webm' ? 'paths.save.movie' : 'paths.save.frames'));
        find('save').hidden = state !== 'done';
        setText(find('delete'), t(isUnderWay(path) ? 'paths.cancel' : 'paths.delete'));
      },
    };
  }

  // Actions.

  /** Starts the browser's download. Requests the path first, so that an error appears here. */
  async #save(id) {
    try {
      const api = this.#api();
      const path = await api.path(id);
      const link = document.createElement('a');
      link.href = api.pathFile(path);
      link.download = `${path.volume}-${id.slice(0, 8)}.${path.format === 'webm' ? 'webm' : 'tar'}`;
      link.click();
    } catch (error) {
      this.#lost(id, error);
    }
  }

  async #delete(id) {
    const path = this.#paths.get(id);
    const act = isUnderWay(path) ? 'cancel' : 'delete';
    if (!await ask(t(`paths.ask.${act}`, { volume: path.volume, frames: path.done }), t(`paths.ask.${act}.act`))) return;
    try {
      await this.#api().deletePath(id);
      this.#gone(id);
    } catch (error) {
      this.#lost(id, error);
    }
  }

  #gone(id) {
    this.#epoch += 1; // a list that is still loading may contain it
    this.#forget(id);
    this.#show();
    this.#plan();
  }

  /** Handles a failed action; a path that another client removed disappears. */
  #lost(id, error) {
    if (error.status === 404) this.#gone(id);
    this.#fail(error);
  }
}
