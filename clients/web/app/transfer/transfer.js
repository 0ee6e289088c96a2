// SPDX-License-Identifier: Apache-2.0
// The section "Transfer function": the state of the editor, undo and redo, and the curve over the histogram. Colour maps, presets by kind
// of data, files, window and level, layers and edits are modules of their own; they call edit() and draw what onShow() tells.
import { stopsOf } from '../../core/color_maps.js';
import { readHistogram } from '../../core/histogram.js';
import { editsOf, isSameEdits } from '../../core/edits.js';
import { History } from '../../core/history.js';
import { chooseShown, whyIdle } from '../../core/choices.js';
import { isSameLayers, layersOf, withoutPhase } from '../../core/layers.js';
import { valueUnit } from '../../core/lengths.js';
import { findMap, withoutMap } from '../../core/map_finder.js';
import { isShownAlike, shownAs } from '../../core/projection.js';
import {
  EXTENT_MIN, POINTS_MAX, VALUE_MAX, colorAt, isSame, isSameGradient, leastGap, merge, tidy, within,
} from '../../core/transfer.js';
import { t } from '../../core/text.js';
import { nextFrame } from '../frames/animation.js';
import { Curve } from '../controls/curve.js';
import { byId, setText } from '../controls/dom.js';
import { onTheme } from '../shell/theme.js';
import { PointColor } from './transfer_color.js';
import { paintCurve, paintStrip } from './transfer_paint.js';

const KEEP_MS = 300;

export function install(app) {
  const { viewer, connection, participants, storage } = app;
  const { api } = connection;
  const transfer = new Transfer(viewer, {
    load: (isJoint) => api.histogram(connection.session.id, connection.session.token, isJoint),
    storage,
  });
  viewer.on('view', (view) => transfer.show(view, viewer.canControl ? null : participants.whyNot));
  connection.on('session', () => transfer.retry());
  app.transfer = transfer;
}

class Transfer {
  #viewer; #load; #storage; #curve; #color;
  #history = new History();
  #volume = null;
  #isKnown = false; // what the volume is
  #histogram = null;
  #problem = ''; // why there is no histogram
  #asked = null; // the volume whose histogram was asked for
  #why = null;
  #isPlanned = false;
  #note = ''; // about the last preset
  #timer = null; // until the tab remembers the state
  #listeners = new Set();
  #painters = new Set();

  /** load(isJoint) → the daemon's histogram of the session's volume; storage: {recall, remember} of this tab. */
  constructor(viewer, { load, storage }) {
    this.#viewer = viewer;
    this.#load = load;
    this.#storage = storage;
    this.#curve = new Curve(byId('transfer-curve'), {
      edit: (points, how) => this.edit({ points }, how), limit: POINTS_MAX, name: 'transfer',
      seal: () => this.#history.seal(),
    });
    byId('transfer-undo').addEventListener('click', ({ timeStamp }) => this.undo(timeStamp));
    byId('transfer-redo').addEventListener('click', ({ timeStamp }) => this.redo(timeStamp));
    byId('transfer-wide').addEventListener('click', () => this.#widen());
    this.#color = new PointColor(this, this.#curve);
    window.addEventListener('keydown', (event) => this.#keys(event));
    window.addEventListener('pagehide', () => this.#keep());
    onTheme(() => this.plan());
    byId('transfer').addEventListener('toggle', () => this.plan());
  }

  /** Calls told() after each change of the transfer function or of the control. */
  onShow(told) { this.#listeners.add(told); }
  /** Calls told([low, high]) after each drawing of the plot, with the values at its edges. */
  onPaint(told) { this.#painters.add(told); }

  get volume() { return this.#volume; }
  get state() { return this.#history.current; }
  /** Grows with each change of the state that undo takes back, and with undo and redo. */
  get steps() { return this.#history.steps; }
  get histogram() { return this.#histogram; }
  get isEditable() { return this.#viewer.canControl && this.state !== null; }
  /** The range of the editor's axis: the range of the histogram; until that is loaded, the range that the volume's description states. */
  get range() {
    const range = this.#histogram?.range ?? this.#viewer.volume?.range;
    if (range && range[1] - range[0] >= EXTENT_MIN && range[1] - range[0] <= VALUE_MAX) return range;
    const { points } = this.state;
    const [low, high] = [points[0].value, points.at(-1).value];
    return high - low >= EXTENT_MIN ? [low, high] : [low - 0.5, low + 0.5];
  }
  /** The unit of the values; '' = unknown. */
  get unit() { return valueUnit(this.#viewer.volume); }
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

  /** The points of a view as the state has them: with the colour map that another participant, or this one before a reload, has put over them. */
  #read(points) {
    const { range = [points[0].value, points.at(-1).value] } = this.#viewer.volume ?? {};
    return findMap(tidy(points), leastGap(this.#histogram?.range ?? range)) ?? { points, map: null };
  }

  /** Takes the view, whoever changed it. why: the reason that this participant may not change it, or null. */
  show(view, why = this.#why) {
    this.#why = why;
    const { points: given, gradient = [] } = view.transfer_function ?? {};
    if (!given?.length || !this.#viewer.isCurrent) return;
    const points = within(given);
    const [layers, edits, shown] = [layersOf(view), editsOf(view), shownAs(view)];
    const isKnown = Boolean(this.#viewer.volume);
    if (view.volume !== this.#volume || isKnown !== this.#isKnown) {
      if (view.volume !== this.#volume) this.#histogram = null;
      this.#volume = view.volume;
      this.#isKnown = isKnown;
      this.#note = '';
      this.#curve.selected = 0;
      this.#curve.showAll();
      this.#history.reset({ ...this.#recall(points, gradient) ?? { ...this.#read(points), gradient }, layers, edits, shown });
    } else if (!isSame(tidy(points), this.points) || !isSameGradient(gradient, this.state.gradient)) {
      this.#history.put({ ...this.#read(points), gradient, layers, edits, shown }, 'others');
    } else if (!isSameLayers(withoutPhase(layers), withoutPhase(this.state.layers)) || !isSameEdits(edits, this.state.edits) || !isShownAlike(shown, this.state.shown)) {
      this.#history.put({ ...this.state, layers, edits, shown }, shown.mode === this.state.shown.mode ? 'others' : null);
    } else if (!isSameLayers(layers, this.state.layers)) {
      this.#history.amend({ ...this.state, layers }); // the streaks moved
    }
    this.#ask();
    this.plan();
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
  get canUndo() { return this.isEditable && this.#history.canUndo; }
  get canRedo() { return this.isEditable && this.#history.canRedo; }

  #send(time) {
    const { points } = this;
    const { gradient, layers, edits, shown } = this.state;
    const { view } = this.#viewer;
    const old = view.transfer_function;
    const change = isSame(points, tidy(old.points)) ? {} : { points };
    if (!isSameGradient(gradient, old.gradient ?? [])) change.gradient = gradient;
    const patch = Object.keys(change).length ? { transfer_function: change } : {};
    if (!isSameLayers(layers, layersOf(view))) patch.layers = layers;
    if (!isSameEdits(edits, editsOf(view))) patch.edits = edits;
    if (!isShownAlike(shown, shownAs(view))) {
      const chosen = chooseShown({ ...view, layers }, shown);
      Object.assign(patch, chosen, chosen.transfer_function ? { transfer_function: { ...chosen.transfer_function, ...change } } : {});
    }
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#keep(), KEEP_MS);
    if (Object.keys(patch).length) this.#viewer.change(patch, time);
    this.plan();
  }

  // A reload gets the points back from the daemon, and from the tab which of them belong to a colour map.
  #keep() {
    clearTimeout(this.#timer);
    const { state } = this;
    if (state) this.#storage.remember('transfer', state.map ? JSON.stringify({ volume: this.#volume, points: this.points, state }) : '');
  }

  #recall(points, gradient) {
    try {
      const kept = JSON.parse(this.#storage.recall('transfer') || 'null');
      if (kept?.volume !== this.#volume || !isSame(kept.points, points)) return null;
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
    if (this.#asked === volume || !['grid', 'points'].includes(this.#viewer.kind)) return; // others have no values
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
    this.plan();
  }

  // Colour maps: {name, table (of an imported map, else null), range, isReversed, steps (0 = smooth)}.

  /** Takes the colours from a map {name, table}; range and shape of the map before it stay. */
  useMap({ name, table }, time) {
    if (!this.isEditable) return;
    const { points, map } = this.state;
    const [low, high] = [points[0].value, points.at(-1).value];
    const range = map?.range ?? (high > low ? [low, high] : [...this.range]);
    this.edit({ map: { isReversed: false, steps: 0, ...map, name, table, range } }, { time });
  }

  /** Changes the range or the shape of the map. */
  changeMap(change, time) {
    if (this.state?.map) this.edit({ map: { ...this.state.map, ...change } }, { time });
    this.plan();
  }

  /** Gives the colours of the map to the points, and drops the map. */
  endMap(time) {
    if (this.isEditable) this.edit({ points: withoutMap(this.points), map: null }, { time });
  }

  /** Replaces the transfer function by a preset or an imported one. gradient null: it stays. note: shown below the presets. */
  replace({ points, gradient, map = null }, time, note = '') {
    this.#curve.selected = 0;
    this.#note = note;
    this.edit({ ...(map ? { points, map } : this.#read(points)), gradient: gradient ?? this.state.gradient }, { time });
  }

  /** Shows a note below the presets, until the next one. */
  tell(note) {
    this.#note = note;
    this.plan();
  }

  // Drawing.

  /** Draws everything at the next animation frame. */
  plan() {
    if (this.#isPlanned || !this.state) return;
    this.#isPlanned = true;
    nextFrame(() => {
      this.#isPlanned = false;
      this.#draw();
    });
  }

  #draw() {
    const { isEditable, canUndo, canRedo } = this;
    for (const group of byId('transfer').querySelectorAll('fieldset')) group.disabled = !isEditable;
    byId('transfer-undo').disabled = !canUndo;
    byId('transfer-redo').disabled = !canRedo;
    setText(byId('transfer-why'), this.#why ?? '');
    byId('transfer-why').hidden = !this.#why;
    setText(byId('transfer-axis'), this.unit ? t('transfer.axis.unit', { unit: this.unit }) : t('transfer.axis'));
    const idle = whyIdle(this.#viewer.view);
    setText(byId('transfer-idle'), idle ? t(`transfer.idle.${idle}`) : '');
    byId('transfer-idle').hidden = !idle;
    setText(byId('transfer-note'), this.#problem ? t('transfer.nohistogram', { reason: this.#problem }) : this.#note);
    byId('transfer-note').hidden = !byId('transfer-note').textContent;
    for (const told of this.#listeners) told();
    if (!byId('transfer').open) return;
    const { points, stops } = this;
    this.#curve.show({
      points: this.state.points.map((p) => (stops ? { ...p, color: colorAt(points, p.value) } : p)), extent: this.#extent, gap: this.gap, isEditable,
      paint: (...where) => this.#paint(points, ...where), selected: () => this.#color.show(),
    });
    this.#color.show();
  }

  #paint(points, context, width, height, [low, high], top) {
    const frame = { width, height, low, high, top };
    const colors = paintCurve(context, points, this.#histogram, frame);
    paintStrip(byId('transfer-strip'), colors, width);
    for (const told of this.#painters) told([low, high]);
  }

  #widen() {
    const isWide = document.getElementById('panel').toggleAttribute('data-wide');
    byId('transfer-wide').setAttribute('aria-pressed', String(isWide));
  }

  // A text field outside of these panels keeps the browser's own undo.
  #keys(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey) return;
    const field = event.target.closest?.('input:not([type="range"], [type="checkbox"], [type="color"]), textarea, dialog');
    if (field && !field.closest('#transfer, #layers, #edit')) return;
    const key = event.key.toLowerCase();
    if (key === 'z' && !event.shiftKey) this.undo(event.timeStamp);
    else if ((key === 'z' && event.shiftKey) || key === 'y') this.redo(event.timeStamp);
    else return;
    event.preventDefault();
  }
}
