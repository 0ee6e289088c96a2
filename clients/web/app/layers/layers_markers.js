// SPDX-License-Identifier: Apache-2.0
// Marks of the surfaces' values above the histogram of the transfer function: each is a slider, moved by mouse, touch, pen and keyboard.
import { numberText } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { make, setAttribute } from '../controls/dom.js';
import { cssColor } from './layers.js';

const KEY_STEP = 0.01; // of the visible range
const KEY_FINE = 0.1; // with Shift, of a step
const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

export class LayerMarkers {
  #root; #layers;
  #xs = [0, 1];
  #drag = null; // {id, index, offset in values}

  /** root: an element as wide as the plot. */
  constructor(root, layers) {
    this.#root = root;
    this.#layers = layers;
    for (const [name, act] of Object.entries({
      pointerdown: (event) => this.#press(event), pointermove: (event) => this.#pull(event), pointerup: (event) => this.#release(event),
      pointercancel: (event) => this.#release(event), keydown: (event) => this.#key(event),
      focusin: ({ target }) => this.#layers.select(Number(target.dataset.index)),
    })) root.addEventListener(name, act);
  }

  #valueAt(clientX) {
    const { left, width } = this.#root.getBoundingClientRect();
    const [low, high] = this.#xs;
    return low + (high - low) * (clientX - left) / width;
  }

  #move(index, value, time) {
    const [low, high] = this.#xs;
    this.#layers.change(index, { value: this.#layers.round(Math.min(high, Math.max(low, value)), this.#xs) }, time);
  }

  #press(event) {
    const mark = event.target.closest('button');
    event.stopPropagation(); // else the plot adds a point
    if (!mark || event.button !== 0 || !this.#layers.isEditable) return;
    const index = Number(mark.dataset.index);
    event.preventDefault();
    mark.focus({ preventScroll: true });
    mark.setPointerCapture(event.pointerId);
    this.#layers.begin();
    this.#drag = { id: event.pointerId, index, offset: this.#layers.list[index].value - this.#valueAt(event.clientX), from: event.clientX };
  }

  #pull(event) {
    const drag = this.#drag;
    if (drag?.id !== event.pointerId || event.clientX === drag.from) return;
    drag.from = NaN;
    this.#move(drag.index, this.#valueAt(event.clientX) + drag.offset, event.timeStamp);
  }

  #release(event) {
    if (this.#drag?.id !== event.pointerId) return;
    this.#drag = null;
    this.#layers.end();
  }

  #key(event) {
    const mark = event.target.closest('button');
    if (!mark || !this.#layers.isEditable || event.ctrlKey || event.altKey || event.metaKey) return;
    const index = Number(mark.dataset.index);
    const [low, high] = this.#xs;
    if (KEYS[event.key]) {
      if (!event.repeat) this.#layers.begin();
      this.#move(index, this.#layers.list[index].value + KEYS[event.key] * KEY_STEP * (event.shiftKey ? KEY_FINE : 1) * (high - low), event.timeStamp);
    } else if (event.key === 'Delete' || event.key === 'Backspace') {
      this.#layers.remove(index, event.timeStamp);
    } else {
      return;
    }
    event.stopPropagation();
    event.preventDefault();
  }

  /** xs: the values at the edges of the plot. */
  show(xs) {
    const { list, selected, isEditable } = this.#layers;
    const [low, high] = this.#xs = xs;
    const surfaces = list.map((layer, index) => ({ layer, index })).filter(({ layer }) => layer.type === 'surface');
    while (this.#root.children.length > surfaces.length) this.#root.lastChild.remove();
    while (this.#root.children.length < surfaces.length) this.#root.append(make('button', { role: 'slider' }));
    surfaces.forEach(({ layer, index }, i) => {
      const mark = /** @type {HTMLElement} */ (this.#root.children[i]);
      mark.dataset.index = String(index);
      mark.style.left = `${100 * (layer.value - low) / (high - low)}%`;
      mark.style.setProperty('--color', cssColor(layer.color));
      mark.hidden = layer.value < low || layer.value > high;
      mark.toggleAttribute('data-selected', index === selected);
      mark.toggleAttribute('data-off', !layer.visible);
      setAttribute(mark, 'aria-label', t('layers.mark', { name: this.#layers.nameOf(index) }));
      setAttribute(mark, 'aria-valuemin', low);
      setAttribute(mark, 'aria-valuemax', high);
      setAttribute(mark, 'aria-valuenow', layer.value);
      setAttribute(mark, 'aria-valuetext', numberText(this.#layers.round(layer.value)));
      setAttribute(mark, 'aria-disabled', String(!isEditable));
      mark.title = t('layers.mark', { name: this.#layers.nameOf(index) });
    });
  }
}
