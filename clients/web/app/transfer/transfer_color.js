// SPDX-License-Identifier: Apache-2.0
// The colour of the selected point of the transfer function: a colour field, and three numbers from 0 to 255.
import { colorAt, paintPoint } from '../../core/transfer.js';
import { byId } from '../controls/dom.js';
import { hexOf } from '../layers/layers_rows.js';

export class PointColor {
  #transfer; #curve;
  #numbers = [...byId('transfer-rgb').querySelectorAll('input')];

  constructor(transfer, curve) {
    this.#transfer = transfer;
    this.#curve = curve;
    const field = byId('transfer-color');
    field.addEventListener('input', ({ timeStamp }) => {
      this.#set([1, 3, 5].map((i) => parseInt(field.value.slice(i, i + 2), 16) / 255), timeStamp, 'color');
    });
    field.addEventListener('change', () => transfer.seal());
    for (const number of this.#numbers) {
      number.addEventListener('change', ({ timeStamp }) => {
        const color = this.#numbers.map(({ valueAsNumber }) => Math.min(255, Math.max(0, valueAsNumber)) / 255);
        if (color.every(Number.isFinite)) this.#set(color, timeStamp, null);
        transfer.plan();
      });
    }
  }

  #set(color, time, gesture) {
    const { points, state, gap } = this.#transfer;
    const { map } = state;
    const at = this.#curve.point?.value;
    const index = map ? points.findIndex(({ value }) => Math.abs(value - at) <= gap) : this.#curve.selected;
    if (index < 0) return;
    // The colour of one point ends a colour map: its colours become points.
    this.#curve.selected = index;
    this.#transfer.edit({ points: paintPoint(map ? points : state.points, index, color), map: null }, { gesture, time });
  }

  show() {
    const { point } = this.#curve;
    const color = (point && (this.#transfer.stops ? colorAt(this.#transfer.points, point.value) : point.color)) ?? [0, 0, 0];
    byId('transfer-color').value = hexOf(color);
    this.#numbers.forEach((field, i) => {
      if (document.activeElement !== field) field.value = String(Math.round(color[i] * 255));
    });
  }
}
