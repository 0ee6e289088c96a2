// SPDX-License-Identifier: Apache-2.0
// A curve of points with everything to edit it: the plot, the selected point in numbers, and zoom along both axes. The transfer
// function and its gradient axis are curves. Parts are found by data-part below the root.
import { numberText } from '../../core/lengths.js';
import { addPoint, movePoint, opacityAt, placePoint, removePoint, middleBeside } from '../../core/transfer.js';
import { t } from '../../core/text.js';
import { setText } from './dom.js';
import { showNumber } from './fields.js';
import { Plot } from './plot.js';

const ZOOM = 1.6;
let gestures = 0;

/** Five digits are enough for a field, and fewer than the daemon keeps. */
const digits = (value) => String(Number(value.toPrecision(5)));

export class Curve {
  #parts; #plot; #edit; #limit; #name; #gesture = '';
  #points = [];
  #extent = [0, 1];
  #gap = 1e-5;
  #xs = null; // null: the whole extent
  #isEditable = false;
  #dirty = new Set(); // fields with text that is not taken yet
  /** @type {any} */
  #view = { paint: () => {}, mode: '' };
  selected = 0;

  /**
   * edit(points, {gesture, time}) takes changed points; limit: the largest number of them; name: of its texts.
   * seal() ends a gesture.
   */
  constructor(root, { edit, limit, name, seal }) {
    this.#edit = edit;
    this.#limit = limit;
    this.#name = name;
    this.#parts = Object.fromEntries([...root.querySelectorAll('[data-part]')].map((part) => [part.dataset.part, part]));
    const { plot, add, remove, before, after, x, y, top, closer, farther, all } = this.#parts;
    this.#plot = new Plot(plot, {
      begin: () => this.#begin(),
      select: (index) => this.select(index),
      move: (index, at, time) => this.#change(movePoint(this.#points, index, { value: at.x, opacity: at.y }, this.#gap), time),
      add: (at, time) => this.#add(at, time),
      remove: (index, time) => this.#remove(index, time),
      end: seal,
      zoom: (factor, share) => this.#zoom(factor, share),
    });
    add.addEventListener('click', ({ timeStamp }) => {
      this.#begin();
      const value = middleBeside(this.#points, this.selected, this.#extent);
      const made = this.#add({ x: value, y: this.#points.length ? opacityAt(this.#points, value) : 1 }, timeStamp);
      if (made >= 0) this.select(made);
    });
    remove.addEventListener('click', ({ timeStamp }) => this.#remove(this.selected, timeStamp));
    before.addEventListener('click', () => this.#step(-1));
    after.addEventListener('click', () => this.#step(1));
    x.addEventListener('change', ({ timeStamp }) => this.#type(x, timeStamp, (value) => placePoint(this.#points, this.selected, value, this.#gap)));
    y.addEventListener('change', ({ timeStamp }) => this.#type(y, timeStamp, (opacity) => ({
      points: movePoint(this.#points, this.selected, { opacity }, this.#gap), index: this.selected,
    })));
    for (const field of [x, y]) {
      field.addEventListener('input', () => this.#dirty.add(field));
      field.addEventListener('blur', () => this.#draw(true));
    }
    top?.addEventListener('change', () => this.#draw());
    closer.addEventListener('click', () => this.#zoom(1 / ZOOM));
    farther.addEventListener('click', () => this.#zoom(ZOOM));
    all.addEventListener('click', () => this.showAll());
  }

  #begin() {
    gestures += 1;
    this.#gesture = `edit ${gestures}`;
  }

  #change(points, time, gesture = this.#gesture) {
    if (!this.#isEditable) return;
    this.#points = points; // show() comes with the next animation frame, perhaps after the next change
    this.#edit(points, { gesture, time });
  }

  #add({ x, y }, time) {
    if (!this.#isEditable || this.#points.length >= this.#limit) return -1;
    const { points, index } = addPoint(this.#points, { value: x, opacity: y, color: this.#points.length ? undefined : [1, 1, 1] }, this.#gap);
    if (index >= 0) {
      this.selected = index;
      this.#change(points, time);
    }
    return index;
  }

  #remove(index, time) {
    this.#begin();
    const points = this.#view.mode === 'gradient' ? this.#points.filter((_, i) => i !== index) : removePoint(this.#points, index);
    if (points.length === this.#points.length) return;
    const hadFocus = this.#parts.plot.contains(document.activeElement);
    this.selected = Math.max(0, Math.min(index, points.length - 1));
    this.#change(points, time);
    if (hadFocus) this.#plot.focus(this.selected);
  }

  #type(field, time, act) {
    const value = field.valueAsNumber;
    if (Number.isFinite(value) && this.#points[this.selected]) {
      this.#begin();
      const { points, index } = act(value);
      this.selected = index;
      this.#change(points, time);
    }
    this.#draw(true);
  }

  #step(by) {
    const count = this.#points.length;
    if (count) this.select((this.selected + by + count) % count);
    this.#reveal();
  }

  select(index) {
    this.selected = index;
    this.#draw(true);
    this.#view.selected?.();
  }

  get xs() { return this.#xs ?? this.#extent; }
  get top() { return Number(this.#parts.top?.value ?? 1); }
  get point() { return this.#points[this.selected] ?? null; }

  /** Moves the visible range so that the selected point is inside. */
  #reveal() {
    const { value } = this.point ?? {};
    const [low, high] = this.xs;
    if (!this.#xs || (value >= low && value <= high)) return;
    const half = (high - low) / 2;
    this.#xs = this.#hold([value - half, value + half]);
    this.#draw();
  }

  #hold([low, high]) {
    const [least, most] = this.#extent;
    const span = Math.max((most - least) * 1e-4, Math.min(high - low, most - least));
    const from = Math.min(Math.max(low, least), most - span);
    return [from, from + span];
  }

  /** Zooms about a share of the width, or else about the selected point if it is visible. */
  #zoom(factor, share = null) {
    const [low, high] = this.xs;
    const value = this.point?.value;
    const at = share ?? (value >= low && value <= high ? (value - low) / (high - low) : 0.5);
    const fixed = low + (high - low) * at;
    const span = (high - low) * factor;
    const xs = this.#hold([fixed - span * at, fixed + span * (1 - at)]);
    this.#xs = xs[1] - xs[0] >= (this.#extent[1] - this.#extent[0]) * 0.999 ? null : xs;
    this.#draw();
  }

  showAll(xs = null) {
    this.#xs = xs;
    this.#draw();
  }

  /** extent: of all values; gap: the least distance between two; paint(context, width, height, xs, top); mode 'gradient' may have no points. */
  show({ points, extent, gap, isEditable, ...view }) {
    this.#points = points;
    this.#extent = extent;
    this.#gap = gap;
    this.#isEditable = isEditable;
    this.#view = view;
    this.selected = Math.max(0, Math.min(this.selected, points.length - 1));
    this.#draw();
  }

  #draw(isTyped = false) {
    const { xs, top } = this;
    const { count, x, y, add, remove, low, high, all } = this.#parts;
    const points = this.#points;
    const text = ({ value, opacity }) => t(`curve.${this.#name}.text`, { x: digits(value), y: showNumber(opacity) });
    this.#plot.show({
      points: points.map((p) => ({ x: p.value, y: p.opacity, color: `rgb(${p.color.map((part) => Math.round(part * 255)).join(' ')})`, text: text(p) })),
      selected: this.selected, xs, top, isEditable: this.#isEditable,
      name: (i) => t(`curve.${this.#name}.point`, { number: i + 1, count: points.length }),
      paint: (context, width, height) => this.#view.paint(context, width, height, xs, top),
    });
    setText(count, points.length ? t('curve.count', { number: this.selected + 1, count: points.length }) : t('curve.none'));
    for (const [field, value] of [[x, this.point?.value], [y, this.point?.opacity]]) {
      field.disabled = !this.point;
      if (isTyped) this.#dirty.delete(field);
      if (!this.#dirty.has(field)) field.value = value === undefined ? '' : digits(value);
    }
    add.disabled = points.length >= this.#limit;
    remove.disabled = points.length <= (this.#view.mode === 'gradient' ? 0 : 1);
    setText(low, numberText(digits(xs[0])));
    setText(high, numberText(digits(xs[1])));
    all.disabled = !this.#xs;
  }
}
