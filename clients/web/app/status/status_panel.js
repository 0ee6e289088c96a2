// SPDX-License-Identifier: Apache-2.0
// What the status line stands for: where the latency goes, what the network carries, the real detail and why it is reduced, and graphs
// of the last minute. The line itself says when the daemon is overloaded or the computer is offline.
import { LatencyMeter, PARTS, isNetworkSlow, judged, limitOf, overloadOf, splitLatency } from '../../core/latency.js';
import { policyText } from '../../core/policy.js';
import { Series, polylines, roundTop } from '../../core/series.js';
import { t } from '../../core/text.js';
import { byId, make, setText, svg } from '../controls/dom.js';
import { shortBytes } from './status.js';

const GRAPH = [232, 34]; // px
const rate = (bytes) => (bytes >= 1e6 ? `${(bytes / 1e6).toFixed(1)} MB/s` : `${Math.round(bytes / 1e3)} kB/s`);
const milliseconds = (ms) => `${ms < 10 ? ms.toFixed(1) : Math.round(ms)} ms`;

/** Values of the last minute: a line, its newest value and the top of its scale. */
class Graph {
  #series; #empty; #least; #format; #drawing; #value; #top;

  /** empty: the value of a second without any, null = a gap; least: the smallest top of the scale; format(value) → text. */
  constructor(name, { merge, empty = null, least, format }) {
    this.#series = new Series({ merge });
    this.#empty = empty;
    this.#least = least;
    this.#format = format;
    const [width, height] = GRAPH;
    this.#drawing = svg('svg', { class: 'graph', viewBox: `0 -1 ${width} ${height + 2}`, preserveAspectRatio: 'none', 'aria-hidden': 'true' });
    this.#value = make('dd');
    this.#top = make('span', { class: 'top' });
    this.element = make('div', { 'data-graph': name }, make('dl', {}, make('dt', { text: t(`stats.${name}`), title: t(`stats.${name}.title`) }), this.#value),
      make('div', { class: 'trace' }, this.#drawing, this.#top));
  }

  put(time, value) {
    this.#series.put(time, value);
  }

  show(now, text = null) {
    const values = this.#series.values(now, this.#empty);
    const top = roundTop(values, this.#least);
    const last = values.findLast((value) => value !== null);
    setText(this.#value, text ?? (last === undefined ? '–' : this.#format(last)));
    setText(this.#top, this.#format(top));
    this.#drawing.replaceChildren(...polylines(values, ...GRAPH, top).map((points) => svg('polyline', { points })));
  }
}

export function install(app) {
  app.statusPanel = new StatusPanel(app);
}

class StatusPanel {
  #app; #root; #toggle; #load; #total; #bar; #values; #about; #graphs;
  #meter = new LatencyMeter();
  #error = null;
  #policy = null;
  #dropped = null;

  constructor(app) {
    this.#app = app;
    this.#graphs = {
      latency: new Graph('latency', { merge: 'mean', least: 20, format: milliseconds }),
      fps: new Graph('fps', { merge: 'sum', empty: 0, least: 10, format: (value) => String(Math.round(value)) }),
      bandwidth: new Graph('bandwidth', { merge: 'sum', empty: 0, least: 1e5, format: rate }),
      dropped: new Graph('dropped', { merge: 'sum', empty: 0, least: 5, format: (value) => String(Math.round(value)) }),
    };
    this.#build();
    app.connection.on('state', ({ state, error }) => {
      this.#error = state === 'lost' ? error : null;
      if (state !== 'live') return;
      this.#meter.clear();
      this.#dropped = null;
    });
    app.connection.on('frame', ({ bytes }) => this.#graphs.bandwidth.put(performance.now(), bytes));
    app.connection.on('notification', ({ method, params }) => this.#notified(method, params));
    app.frames.on('drawn', (drawn) => this.#drew(drawn));
    window.addEventListener('online', () => this.#refresh());
    window.addEventListener('offline', () => this.#refresh());
    app.status.onRefresh(() => this.#refresh());
  }

  /** The mean latency of the last second and its parts in ms, or null. */
  get latency() { return this.#meter.mean(); }
  get isOpen() { return !this.#root.hidden; }

  #build() {
    this.#total = make('dd');
    this.#bar = make('div', { class: 'bar', 'aria-hidden': 'true' }, ...PARTS.map((name) => make('span', { 'data-part': name })));
    this.#values = new Map(PARTS.map((name) => [name, make('dd')]));
    this.#about = make('p', { class: 'about' });
    const part = (name) => make('div', { 'data-part': name, title: t(`stats.part.${name}.title`) }, make('dt', { text: t(`stats.part.${name}`) }), this.#values.get(name));
    this.#root = make('section', { id: 'stats', 'aria-label': t('stats.label'), hidden: true },
      make('header', {}, make('h2', { text: t('stats.label') }), make('button', { id: 'stats-close', 'aria-label': t('common.close'), text: '×', press: () => this.#open(false) })),
      make('dl', { class: 'total' }, make('dt', { text: t('stats.total'), title: t('stats.total.title') }), this.#total),
      this.#bar, make('dl', { class: 'parts' }, ...PARTS.map(part)),
      make('div', { class: 'graphs' }, ...Object.values(this.#graphs).map(({ element }) => element)), this.#about);
    this.#root.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape') return;
      event.preventDefault();
      this.#open(false);
    });
    this.#load = make('span', { id: 'status-load', role: 'status', hidden: true });
    this.#toggle = make('button', {
      id: 'stats-toggle', 'aria-expanded': 'false', 'aria-controls': 'stats', text: t('stats.toggle'), title: t('stats.toggle.title'),
      press: () => this.#open(this.#root.hidden),
    });
    byId('status').append(this.#load, this.#toggle);
    byId('status').after(this.#root);
  }

  #open(isOpen) {
    this.#root.hidden = !isOpen;
    this.#toggle.setAttribute('aria-expanded', String(isOpen));
    if (isOpen) this.#refresh();
    else this.#toggle.focus();
  }

  #notified(method, params) {
    if (method === 'stream.policy') this.#policy = params;
    if (method !== 'stream.stats') return;
    if (this.#dropped !== null) this.#graphs.dropped.put(performance.now(), Math.max(0, params.dropped - this.#dropped));
    this.#dropped = params.dropped;
  }

  #drew({ frame, latency, decodeMs }) {
    const now = performance.now();
    this.#graphs.fps.put(now, 1);
    if (latency === null) return;
    this.#meter.put(now, latency, splitLatency(latency, frame, { waited: this.#app.viewer.updates.waited, decode: decodeMs ?? 0, link: this.#app.status.stats }));
    this.#graphs.latency.put(now, latency);
  }

  get #overload() {
    const { isMoving, detail, shortage } = this.#app.status;
    return overloadOf({ isOnline: navigator.onLine, error: this.#error, latency: this.latency, policy: this.#policy, isMoving, detail }) ?? shortage;
  }

  #refresh() {
    const overload = this.#overload;
    setText(this.#load, overload ? t(`load.${overload}`) : '');
    this.#load.hidden = !overload;
    const isBad = overload === 'offline' || overload === 'busy';
    this.#load.dataset.kind = isBad ? 'bad' : 'warm';
    this.#load.setAttribute('aria-live', isBad ? 'polite' : 'off'); // what comes and goes with each turn would be told again and again
    this.#load.title = overload ? t(`load.${overload}.title`) : '';
    this.#app.status.explain(policyText(judged(this.#policy, this.latency)));
    if (this.#root.hidden) return;
    const now = performance.now();
    const mean = this.latency;
    setText(this.#total, mean ? milliseconds(mean.total) : '–');
    for (const [i, name] of PARTS.entries()) {
      setText(this.#values.get(name), mean ? milliseconds(mean[name]) : '–');
      this.#bar.children[i].style.flexGrow = mean ? String(mean[name]) : '0';
    }
    const { stats } = this.#app.status;
    this.#graphs.latency.show(now);
    this.#graphs.fps.show(now);
    this.#graphs.bandwidth.show(now);
    this.#graphs.dropped.show(now, stats.dropped === undefined ? '–' : String(stats.dropped));
    setText(this.#about, this.#describe(stats));
  }

  /** Lines about detail, network and backend. */
  #describe(stats) {
    const { latency } = this;
    const lines = [policyText(judged(this.#policy, latency))];
    if (latency) {
      const [name, ms] = limitOf(latency);
      lines.push(t(`stats.limit.${name}`, { ms: milliseconds(ms), total: milliseconds(latency.total) }));
    }
    if (stats.bandwidth > 0) {
      const key = isNetworkSlow(this.#policy, this.latency) ? 'stats.network' : 'stats.network.least'; // a fast link shows only what was sent
      lines.push(t(key, { rate: rate(stats.bandwidth), rtt: milliseconds(stats.rtt_ms), window: stats.window }));
    }
    if (stats.bricks) {
      const { bricks } = stats;
      lines.push(t('stats.bricks', { ...bricks, memory: shortBytes(stats.memory) }));
      if (bricks.lost > 0) {
        const [from, end] = bricks.lost_at;
        lines.push(t('stats.bricks.lost', { count: bricks.lost, from: from.join(', '), to: end.map((side) => side - 1).join(', ') }));
      }
    }
    if (stats.backend) lines.push(t('stats.backend', { backend: stats.backend, device: stats.device || '–' }));
    return lines.filter(Boolean).join('\n');
  }
}
