// SPDX-License-Identifier: Apache-2.0
// The panel "Transfer function": points over the histogram, their colours, colour maps, presets by kind of data, undo and redo.
import { MAP_NAMES, STEPS_MAX, stopsOf } from '../core/color_maps.js';
import { logHeights, readHistogram } from '../core/histogram.js';
import { History } from '../core/history.js';
import { KINDS, presetOf } from '../core/tissue.js';
import {
  EXTENT_MIN, POINTS_MAX, VALUE_MAX, colorAt, isSame, isSameGradient, leastGap, merge, opacityAt, paintPoint, stretchAll, tidy, windowOf, within,
} from '../core/transfer.js';
import { t } from '../core/text.js';
import { nextFrame } from './animation.js';
import { Curve } from './curve.js';
import { byId, setText } from './dom.js';
import { showNumber } from './fields.js';
import { themeColor } from './theme.js';

const OWN = ''; // the choice "colours of the points"
const LEVEL_REACH = 600; // px of a drag for the whole range
const KEEP_MS = 300;
const WINDOW_REACH = 180; // px of a drag for a factor e

const hex = (color) => `#${color.map((part) => Math.round(part * 255).toString(16).padStart(2, '0')).join('')}`;
const css = (color) => `rgb(${color.map((part) => Math.round(part * 255)).join(' ')})`;

export function install(app) {
  const { viewer, connection, participants, storage } = app;
  const { api } = connection;
  const transfer = new Transfer(viewer, {
    load: (isJoint) => api.histogram(connection.session.id, connection.session.token, isJoint),
    loadDefault: (id) => api.volumeView(id), storage,
  });
  viewer.on('view', (view) => transfer.show(view, viewer.canControl ? null : participants.whyNot));
  connection.on('session', () => transfer.retry());
  app.transfer = transfer;
}

class Transfer {
  #viewer; #load; #loadDefault; #storage; #curve;
  #history = new History();
  #volume = null;
  #histogram = null;
  #problem = ''; // why there is no histogram
  #asked = null; // the volume whose histogram was asked for
  #why = null;
  #isPlanned = false;
  #start = null; // of a drag in the picture: {state, window}
  #custom = null; // an imported colour map: {name, table}
  #note = '';
  #timer = null;
  #listeners = new Set();

  /**
   * load(isJoint) → the daemon's histogram of the session's volume; loadDefault(volume) → its default view; storage: {recall, remember}
   * of this tab.
   */
  constructor(viewer, { load, loadDefault, storage }) {
    this.#viewer = viewer;
    this.#load = load;
    this.#loadDefault = loadDefault;
    this.#storage = storage;
    this.#curve = new Curve(byId('transfer-curve'), {
      edit: (points, how) => this.edit({ points }, how), limit: POINTS_MAX, name: 'transfer',
      seal: () => this.#history.seal(),
    });
    byId('transfer-undo').addEventListener('click', ({ timeStamp }) => this.undo(timeStamp));
    byId('transfer-redo').addEventListener('click', ({ timeStamp }) => this.redo(timeStamp));
    byId('transfer-wide').addEventListener('click', () => this.#widen());
    this.#attachColors();
    this.#attachMaps();
    this.#attachKinds();
    window.addEventListener('keydown', (event) => this.#keys(event));
    window.addEventListener('pagehide', () => this.#keep());
    window.matchMedia('(prefers-color-scheme: light)').addEventListener('change', () => this.#plan());
    byId('transfer').addEventListener('toggle', () => this.#plan());
  }

  /** Calls told() after each change of the transfer function or of the control. */
  onShow(told) { this.#listeners.add(told); }

  get volume() { return this.#volume; }
  get state() { return this.#history.current; }
  get histogram() { return this.#histogram; }
  get isEditable() { return this.#viewer.canControl && this.state !== null; }
  /** The range of values of the volume, as far as it is known. */
  get range() {
    const range = this.#histogram?.range ?? this.#viewer.volume?.range;
    if (range && range[1] - range[0] >= EXTENT_MIN && range[1] - range[0] <= VALUE_MAX) return range;
    const { points } = this.state;
    const [low, high] = [points[0].value, points.at(-1).value];
    return high - low >= EXTENT_MIN ? [low, high] : [low - 0.5, low + 0.5];
  }
  get gap() { return leastGap(this.range); }
  get #extent() {
    const { points } = this.state;
    return [Math.min(this.range[0], points[0].value), Math.max(this.range[1], points.at(-1).value)];
  }
  get stops() { return this.state.map && stopsOf(this.state.map); }
  /** The points as the daemon gets them. */
  get points() { return this.#pointsOf(this.state); }

  #pointsOf({ points, map }) {
    return tidy(map ? merge(points, stopsOf(map), map.range, this.gap) : points);
  }

  // The state and the view.

  /** Takes the view, whoever changed it. why: the reason that this participant may not change it, or null. */
  show(view, why = this.#why) {
    this.#why = why;
    const { points: given, gradient = [] } = view.transfer_function ?? {};
    if (!given?.length || !this.#viewer.isCurrent) return;
    const points = within(given);
    if (view.volume !== this.#volume) {
      this.#volume = view.volume;
      this.#histogram = null;
      this.#note = '';
      this.#curve.selected = 0;
      this.#curve.showAll();
      this.#history.reset(this.#recall(points, gradient) ?? { points, gradient, map: null });
      byId('transfer-kind').value = '';
    } else if (!isSame(tidy(points), this.points) || !isSameGradient(gradient, this.state.gradient)) {
      this.#history.put({ points, gradient, map: null }, 'others');
    }
    this.#ask();
    this.#plan();
  }

  /**
   * Changes the state and the view. Changes of one gesture count as one step for undo.
   * @param {object} change @param {{gesture?: string | null, time?: number}} [how]
   */
  edit(change, { gesture = null, time } = {}) {
    if (!this.isEditable) return;
    this.#history.put({ ...this.state, ...change }, gesture);
    this.#send(time);
  }

  undo(time) { if (this.isEditable && this.#history.undo()) this.#send(time); }
  redo(time) { if (this.isEditable && this.#history.redo()) this.#send(time); }
  seal() { this.#history.seal(); }

  #send(time) {
    const { points } = this;
    const { gradient } = this.state;
    const old = this.#viewer.view.transfer_function;
    const patch = isSame(points, tidy(old.points)) ? {} : { points };
    if (!isSameGradient(gradient, old.gradient ?? [])) patch.gradient = gradient;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#keep(), KEEP_MS);
    if (Object.keys(patch).length) this.#viewer.change({ transfer_function: patch }, time);
    this.#plan();
  }

  // A reload gets the points back from the daemon, and from the tab which of them belong to a colour map.
  #keep() {
    clearTimeout(this.#timer);
    const { state, points } = this;
    if (state) this.#storage.remember('transfer', state.map ? JSON.stringify({ volume: this.#volume, points, state }) : '');
  }

  #recall(points, gradient) {
    try {
      const kept = JSON.parse(this.#storage.recall('transfer') || 'null');
      if (kept?.volume !== this.#volume || !isSame(kept.points, points)) return null;
      if (kept.state.map.table) this.#custom = { name: kept.state.map.name, table: kept.state.map.table };
      return { ...kept.state, gradient };
    } catch {
      return null;
    }
  }

  /** Asks again for a histogram that could not be read, in a new session. */
  retry() {
    if (this.#problem) this.#asked = null;
    if (this.state) this.#ask();
  }

  async #ask() {
    const volume = this.#volume;
    if (this.#asked === volume) return;
    this.#asked = volume;
    this.#problem = '';
    let problem = '';
    try {
      const histogram = readHistogram(await this.#load(false));
      if (histogram.volume !== volume) problem = t('transfer.othervolume');
      else if (volume === this.#volume) this.#histogram = histogram;
    } catch (error) {
      problem = error.message;
    }
    if (volume === this.#volume) this.#problem = problem;
    this.#plan();
  }

  // Colours of points.

  #attachColors() {
    const set = (color, time, gesture) => {
      const merged = this.points;
      const at = this.#curve.point?.value;
      const { map } = this.state;
      const index = map ? merged.findIndex((p) => Math.abs(p.value - at) <= this.gap) : this.#curve.selected;
      if (index < 0) return;
      // The colour of one point ends a colour map: its colours become points.
      this.#curve.selected = index;
      this.edit({ points: paintPoint(map ? merged : this.state.points, index, color), map: null }, { gesture, time });
    };
    byId('transfer-color').addEventListener('input', ({ target, timeStamp }) => {
      set([1, 3, 5].map((i) => parseInt(target.value.slice(i, i + 2), 16) / 255), timeStamp, 'color');
    });
    byId('transfer-color').addEventListener('change', () => this.seal());
    const parts = [...byId('transfer-rgb').querySelectorAll('input')];
    for (const part of parts) {
      part.addEventListener('change', ({ timeStamp }) => {
        const values = parts.map((field) => Math.min(255, Math.max(0, field.valueAsNumber)) / 255);
        if (values.every(Number.isFinite)) set(values, timeStamp, null);
        this.#plan();
      });
    }
  }

  #showColor() {
    const { point } = this.#curve;
    const color = point && (this.stops ? colorAt(this.points, point.value) : point.color);
    byId('transfer-color').value = hex(color ?? [0, 0, 0]);
    [...byId('transfer-rgb').querySelectorAll('input')].forEach((field, i) => {
      if (document.activeElement !== field) field.value = Math.round((color?.[i] ?? 0) * 255);
    });
  }

  // Colour maps.

  #attachMaps() {
    const choice = byId('transfer-map');
    choice.replaceChildren(new Option(t('transfer.map.points'), OWN), ...MAP_NAMES.map((id) => new Option(t(`map.${id}`), id)));
    byId('transfer-steps').max = STEPS_MAX;
    choice.addEventListener('change', ({ timeStamp }) => this.useMap(choice.value, timeStamp));
    byId('transfer-reverse').addEventListener('change', ({ target, timeStamp }) => this.#changeMap({ isReversed: target.checked }, timeStamp));
    byId('transfer-steps').addEventListener('change', ({ target, timeStamp }) => {
      const steps = Math.round(Math.min(STEPS_MAX, Math.max(0, target.valueAsNumber || 0)));
      this.#changeMap({ steps }, timeStamp);
    });
    for (const [i, id] of ['transfer-map-low', 'transfer-map-high'].entries()) {
      byId(id).addEventListener('change', ({ target, timeStamp }) => {
        const range = this.state.map?.range.with?.(i, target.valueAsNumber) ?? this.state.map?.range.map((v, k) => (k === i ? target.valueAsNumber : v));
        if (range?.every(Number.isFinite) && range[1] > range[0]) this.#changeMap({ range }, timeStamp);
        this.#plan();
      });
    }
  }

  #changeMap(change, time) {
    if (this.state?.map) this.edit({ map: { ...this.state.map, ...change } }, { time });
    this.#plan();
  }

  /** Chooses a colour map by its id, or the colours of the points. */
  useMap(id, time) {
    if (!this.isEditable) return;
    if (id === OWN) {
      this.edit({ points: this.points, map: null }, { time });
      return;
    }
    const { points, map } = this.state;
    const [low, high] = [points[0].value, points.at(-1).value];
    const range = map?.range ?? (high > low ? [low, high] : [...this.range]);
    const custom = id === 'custom' && this.#custom;
    this.edit({ map: { isReversed: false, steps: 0, ...map, name: custom ? custom.name : id, table: custom ? custom.table : null, range } }, { time });
  }

  /** Takes an imported colour map {name, table}. */
  takeMap({ name, table }, time) {
    this.#custom = { name, table };
    this.useMap('custom', time);
  }

  #showMap() {
    const { map } = this.state;
    const choice = byId('transfer-map');
    let option = [...choice.options].find(({ value }) => value === 'custom');
    if (this.#custom && !option) choice.add(option = new Option('', 'custom'));
    if (option) option.text = this.#custom?.name ?? t('transfer.map.imported');
    choice.value = map ? (map.table ? 'custom' : map.name) : OWN;
    for (const id of ['transfer-map-shape', 'transfer-map-range']) byId(id).hidden = !map;
    if (!map) return;
    byId('transfer-reverse').checked = map.isReversed;
    for (const [id, value] of [['transfer-steps', map.steps], ['transfer-map-low', map.range[0]], ['transfer-map-high', map.range[1]]]) {
      if (document.activeElement !== byId(id) || byId(id).valueAsNumber === value) byId(id).value = Number(value.toPrecision(6));
    }
  }

  // Presets by kind of data.

  #attachKinds() {
    const choice = byId('transfer-kind');
    choice.append(...KINDS.map((id) => new Option(t(`kind.${id}`), id)));
    choice.addEventListener('change', ({ timeStamp }) => {
      if (choice.value === 'default') this.#useDefault(timeStamp);
      if (!KINDS.includes(choice.value) || !this.#histogram) return;
      const { points, map, note } = presetOf(choice.value, this.#histogram);
      const range = [points[0].value, points.at(-1).value];
      this.#note = `${note[0].toUpperCase()}${note.slice(1)}.`;
      this.#curve.selected = 0;
      this.edit({ points, gradient: [], map: map && { name: map, table: null, isReversed: false, steps: 0, range } }, { time: timeStamp });
    });
  }

  async #useDefault(time) {
    const volume = this.#volume;
    try {
      const { points, gradient } = (await this.#loadDefault(volume)).transfer_function;
      if (volume === this.#volume) this.replace({ points, gradient }, time);
    } catch (error) {
      this.#note = t('transfer.default.failed', { reason: error.message });
      this.#plan();
    }
  }

  /** Replaces the transfer function by an imported one. gradient null: it stays. */
  replace({ points, gradient }, time) {
    this.#curve.selected = 0;
    this.#note = '';
    this.edit({ points, gradient: gradient ?? this.state.gradient, map: null }, { time });
  }

  // Window and level: a drag in the picture stretches and moves all values.

  beginWindow() {
    this.#start = this.isEditable ? { state: this.state, window: windowOf(this.state.points, this.range), gesture: `window ${performance.now()}` } : null;
  }

  /** dx, dy: from the start of the drag in px; to the right widens the window, upwards raises the level. */
  dragWindow(dx, dy, time) {
    if (!this.#start) return;
    const { state, window: from, gesture } = this.#start;
    const [low, high] = this.range;
    const width = Math.min(Math.max(from.width * Math.exp(dx / WINDOW_REACH), (high - low) * 1e-3), (high - low) * 10);
    const level = Math.min(Math.max(from.level - dy / LEVEL_REACH * (high - low), low - (high - low)), high + (high - low));
    this.edit(stretchAll(state, from, { level, width }), { gesture, time });
  }

  endWindow() {
    this.#start = null;
    this.seal();
  }

  get windowText() {
    if (!this.state) return '';
    const { level, width } = windowOf(this.state.points, this.range);
    return t('window.values', { width: showNumber(width), level: showNumber(level) });
  }

  // Drawing.

  #plan() {
    if (this.#isPlanned || !this.state) return;
    this.#isPlanned = true;
    nextFrame(() => {
      this.#isPlanned = false;
      this.#draw();
    });
  }

  #draw() {
    const { isEditable } = this;
    for (const group of byId('transfer').querySelectorAll('fieldset')) group.disabled = !isEditable;
    byId('transfer-undo').disabled = !isEditable || !this.#history.canUndo;
    byId('transfer-redo').disabled = !isEditable || !this.#history.canRedo;
    setText(byId('transfer-why'), this.#why ?? '');
    byId('transfer-why').hidden = !this.#why;
    byId('transfer-kind').disabled = !this.#histogram;
    setText(byId('transfer-note'), this.#problem ? t('transfer.nohistogram', { reason: this.#problem }) : this.#note);
    byId('transfer-note').hidden = !byId('transfer-note').textContent;
    for (const told of this.#listeners) told();
    if (!byId('transfer').open) return;
    const { points, stops } = this;
    this.#curve.show({
      points: this.state.points.map((p) => (stops ? { ...p, color: colorAt(points, p.value) } : p)), extent: this.#extent, gap: this.gap, isEditable,
      paint: (...where) => this.#paint(points, ...where), selected: () => this.#showColor(),
    });
    this.#showColor();
    this.#showMap();
  }

  #paint(points, context, width, height, [low, high], top) {
    const columns = Math.max(1, Math.round(width));
    const xOf = (value) => (value - low) / (high - low) * width;
    const yOf = (opacity) => height * (1 - Math.min(1, opacity / top));
    if (this.#histogram) {
      context.fillStyle = themeColor('--bars');
      context.beginPath();
      context.moveTo(0, height);
      logHeights(this.#histogram, low, high, columns).forEach((part, i) => {
        context.lineTo(i * width / columns, height * (1 - part));
        context.lineTo((i + 1) * width / columns, height * (1 - part));
      });
      context.lineTo(width, height);
      context.fill();
    }
    const shape = new Path2D();
    shape.moveTo(0, yOf(opacityAt(points, low)));
    for (const { value, opacity } of points) if (value > low && value < high) shape.lineTo(xOf(value), yOf(opacity));
    shape.lineTo(width, yOf(opacityAt(points, high)));
    const area = new Path2D(shape);
    area.lineTo(width, height);
    area.lineTo(0, height);
    const colors = context.createLinearGradient(0, 0, width, 0);
    const at = (value) => Math.min(1, Math.max(0, (value - low) / (high - low)));
    colors.addColorStop(0, css(colorAt(points, low)));
    for (const { value, color } of points) if (value > low && value < high) colors.addColorStop(at(value), css(color));
    colors.addColorStop(1, css(colorAt(points, high)));
    context.globalAlpha = 0.55;
    context.fillStyle = colors;
    context.fill(area);
    context.globalAlpha = 1;
    context.strokeStyle = themeColor('--text');
    context.lineWidth = 1.5;
    context.stroke(shape);
    this.#paintStrip(colors, width);
  }

  #paintStrip(colors, width) {
    const strip = byId('transfer-strip');
    const ratio = window.devicePixelRatio || 1;
    const size = Math.round(width * ratio);
    if (strip.width !== size || strip.height !== 1) [strip.width, strip.height] = [size, 1];
    const context = strip.getContext('2d');
    context.setTransform(ratio, 0, 0, 1, 0, 0);
    context.fillStyle = colors;
    context.fillRect(0, 0, width, 1);
  }

  #widen() {
    const isWide = document.getElementById('panel').toggleAttribute('data-wide');
    byId('transfer-wide').setAttribute('aria-pressed', String(isWide));
  }

  // A text field outside of this panel keeps the browser's own undo.
  #keys(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const field = event.target.closest?.('input:not([type="range"], [type="checkbox"], [type="color"]), textarea, dialog');
    if (field && !byId('transfer').contains(field)) return;
    const key = event.key.toLowerCase();
    if (key === 'z' && !event.shiftKey) this.undo(event.timeStamp);
    else if ((key === 'z' && event.shiftKey) || key === 'y') this.redo(event.timeStamp);
    else return;
    event.preventDefault();
  }
}
