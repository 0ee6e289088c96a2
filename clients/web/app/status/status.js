// SPDX-License-Identifier: Apache-2.0
// The status line: figures of the last second.
import { detailPercent, shortageOf } from '../../core/detail.js';
import { contentsText, kindOf } from '../../core/kinds.js';
import { numberText } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { sizesOf } from '../../core/vertical.js';
import { nameOf } from '../../core/volume_names.js';
import { byId, setText } from '../controls/dom.js';

const WINDOW_MS = 1000;
const REFRESH_MS = 250;

/** 1234567 → "1.23 M" */
export function shortNumber(n) {
  if (!Number.isFinite(n)) return '';
  if (n >= 1e6) return `${(n / 1e6).toFixed(2)} M`;
  if (n >= 1e3) return `${(n / 1e3).toFixed(n >= 1e5 ? 0 : 1)} k`;
  return String(Math.round(n));
}

/** The distances of samples, with their unit. */
function spacingText(volume, spacing) {
  const { numbers, unit } = sizesOf(volume, spacing, (size) => numberText(Number(size.toPrecision(4))));
  return `${numbers} ${unit || t('status.nounit')}`;
}

const kilobytes = (n) => `${(n / 1000).toFixed(n < 1e5 ? 1 : 0)} kB`;

/** 1234567 → "1.2 MB" */
export function shortBytes(n) {
  if (n >= 1e9) return `${(n / 1e9).toFixed(2)} GB`;
  return n >= 1e6 ? `${(n / 1e6).toFixed(1)} MB` : kilobytes(n);
}

export function install(app) {
  const { connection, screen, frames, viewer } = app;
  const status = new StatusLine(byId('status'), screen);
  connection.on('state', ({ state }) => status.setState(state));
  connection.on('notification', ({ method, params }) => {
    if (method === 'stream.stats') status.setStats(params);
  });
  frames.on('drawn', ({ frame, latency }) => status.drew(frame, latency));
  for (const [source, event] of [[viewer, 'view'], [connection, 'volumes']]) source.on(event, () => status.setVolume(viewer.volume));
  app.status = status;
}

class StatusLine {
  #root; #fields = new Map();
  #frames = [];
  #stats = {};
  #latency = null;
  #newest = null;
  #screen;
  #isLive = false;
  #about = null; // the title of the field itself
  #detail = null;
  #told = new Set();

  constructor(root, screen) {
    this.#root = root;
    this.#screen = screen;
    for (const item of root.querySelectorAll('[data-key]')) {
      this.#fields.set(item.dataset.key, item.querySelector('dd'));
    }
    setInterval(() => this.#refresh(), REFRESH_MS);
  }

  get latencyMs() { return this.#latency; }
  get stats() { return this.#stats; }
  /** Of the newest picture in percent (core/detail.js); null without one. */
  get detail() { return this.#detail; }
  /** Why the newest picture shows less of its volume than its pixels ask for (core/detail.js); null = it shows all of it. */
  get shortage() { return shortageOf(this.#newest, this.#stats.bricks); }
  /** True while pictures of a moving view are shown. */
  get isMoving() { return this.#frames.length > 0 && !this.#newest?.isFinal; }

  /** told() runs after each refresh, so that all figures are of the same picture. */
  onRefresh(told) { this.#told.add(told); }

  setState(state) {
    const field = this.#root.querySelector('#status-state');
    field.dataset.state = state;
    field.textContent = t(`status.state.${state}`);
    this.#isLive = state === 'live';
    if (!this.#isLive) this.#frames = [];
  }

  /** Shows which volume the picture is of: its file, how many samples it has, and how far apart they are. */
  setVolume(volume) {
    const { dims, spacing } = volume?.whole ?? volume ?? {};
    const isGrid = kindOf(volume) === 'grid';
    setText(this.#fields.get('file'), volume ? nameOf(volume) : '');
    this.#fields.get('file').parentElement.title = volume?.source ?? '';
    setText(this.#fields.get('dims'), volume ? (isGrid && dims ? dims.join(' × ') : contentsText(volume)) : '');
    setText(this.#fields.get('spacing'), isGrid && spacing ? spacingText(volume, spacing) : '');
  }

  /** Shows the value under the pointer; '' = none. */
  setValue(text) { setText(this.#fields.get('value'), text); }

  /** Shows the number of participants, and the holder of control if it is not this page. */
  setParticipants({ count, holder, mayChange }) {
    const field = this.#fields.get('participants');
    const who = mayChange ? '' : t(holder ? 'status.controls' : 'status.watching', { name: holder?.name });
    field.textContent = [who, count > 1 ? t('status.people', { count }) : ''].filter(Boolean).join(', ');
  }

  setStats(stats) {
    this.#stats = { ...this.#stats, bricks: undefined, ...stats };
  }

  /** Explains the detail of frames in the title of its field. */
  explain(text) {
    const { parentElement: item } = this.#fields.get('detail');
    this.#about ??= item.title;
    const title = `${this.#about}\n${text}`;
    if (item.title !== title) item.title = title;
  }

  /** Records a drawn frame; latency in ms, or null. */
  drew(frame, latency) {
    this.#frames.push(performance.now());
    if (latency !== null) this.#latency = latency;
    const isAsBefore = frame.isFinal === this.#newest?.isFinal;
    this.#newest = frame;
    if (!isAsBefore) this.#refresh();
  }

  #refresh() {
    const now = performance.now();
    this.#frames = this.#frames.filter((time) => now - time <= WINDOW_MS);
    const frame = this.#newest;
    const set = (key, text) => {
      const field = this.#fields.get(key);
      if (field.textContent !== text) field.textContent = text;
    };
    const isResting = this.#frames.length === 0 && frame?.isFinal;
    set('fps', !frame || !this.#isLive ? '' : isResting ? t('status.resting') : String(this.#frames.length));
    set('latency', this.#latency === null ? '' : `${Math.round(this.#latency)} ms`);
    this.#detail = frame ? detailPercent(frame, this.#screen.size, this.#stats.coarse, this.#screen.pixels, this.#stats.bricks) : null;
    set('detail', frame ? `${this.#detail} %` : '');
    set('size', frame ? `${frame.width} × ${frame.height}` : '');
    set('bytes', frame ? kilobytes(frame.bytes) : '');
    set('render', frame ? `${((frame.renderUs + frame.encodeUs) / 1000).toFixed(0)} ms` : '');
    set('backend', this.#stats.backend ?? '');
    set('splats', shortNumber(this.#stats.splats));
    for (const told of this.#told) told();
  }
}
