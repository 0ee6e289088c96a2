// SPDX-License-Identifier: Apache-2.0
// Chooses the numbers that colour streaks or points: their own values, the lengths of their vectors, or another field of the file. The other
// field is loaded as a volume. Two fields have the numbers of the first and the last colour.
import { coloringField } from '../../core/color_bar.js';
import { MAGNITUDE, hasVectors } from '../../core/layers.js';
import { numberText, roundValue } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { make } from '../controls/dom.js';

const ENDS = ['color_low', 'color_high'];
const PLAIN = { color_low: null, color_high: null }; // the range of the new numbers

/** The number in a field; null if it is empty. */
const numberOf = (input) => (Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : null);

export class ColorByRow {
  #layers; #select; #ends; #range;
  #index = -1;
  #shown = '';

  /** id: the id of the control in the page. */
  constructor(layers, id) {
    this.#layers = layers;
    this.#select = make('select', { id });
    this.#select.addEventListener('change', ({ timeStamp }) => {
      const { kind } = this.#select.selectedOptions[0].dataset;
      if (kind === 'field') this.#load(this.#select.value);
      else layers.change(this.#index, { color_by: this.#select.value, ...PLAIN }, timeStamp);
    });
    this.#ends = ENDS.map((name) => make('input', { type: 'number', step: 'any', 'data-end': name, 'aria-label': t(`layers.${name}`) }));
    this.#ends.forEach((input) => {
      input.addEventListener('input', () => this.#ends.forEach((end) => end.setCustomValidity('')));
      input.addEventListener('change', ({ timeStamp }) => this.#setRange(input, timeStamp));
    });
    this.#range = make('div', { class: 'row', role: 'group', 'aria-label': t('layers.color_range.label'), title: t('layers.color_range.title') },
      make('span', { text: t('layers.color_range') }), make('span', { class: 'range' }, this.#ends[0], '–', this.#ends[1]));
    this.root = make('div', {},
      make('div', { class: 'row', title: t('layers.color_by.title') }, make('label', { for: id, text: t('layers.color_by') }), this.#select),
      this.#range);
  }

  /** An empty field is the end of the data. */
  #setRange(input, time) {
    const [low, high] = this.#ends.map(numberOf);
    input.setCustomValidity(low !== null && high !== null && low >= high ? t('layers.color_range.order') : '');
    if (input.reportValidity()) this.#layers.change(this.#index, { color_low: low, color_high: high }, time);
  }

  #showRange() {
    const layer = this.#layer;
    const numbers = layer.color_by ? coloringField(layer, (id) => this.#layers.volumeOf({ id })) : null;
    this.#range.hidden = !numbers;
    ENDS.forEach((name, i) => {
      const [input, value] = [this.#ends[i], layer[name] ?? null];
      const limits = numbers?.field.range;
      input.placeholder = limits ? numberText(roundValue(limits[i], limits)) : '';
      if (document.activeElement === input && numberOf(input) !== value) return; // it is being typed
      input.setCustomValidity('');
      input.value = value === null ? '' : String(value);
    });
  }

  get #layer() { return this.#layers.list[this.#index]; }

  /** [value, name, kind]. kind: 'own' values, 'length' of the vectors, a loaded 'volume', or a 'field' that is not loaded. */
  #options() {
    const { color_by: chosen = '' } = this.#layer;
    const volume = this.#layers.volumeOf(this.#layer);
    const own = volume?.fields?.[0]?.name ?? '';
    const named = chosen && chosen !== MAGNITUDE ? this.#layers.fieldName(chosen) : '';
    const others = (this.#layers.mayOpen && volume?.other_fields ? volume.other_fields : []).filter((name) => name !== MAGNITUDE && name !== named);
    return [
      ['', own || t('layers.color_by.own'), 'own'],
      ...(hasVectors(volume) && own !== MAGNITUDE ? [[MAGNITUDE, t('layers.color_by.length'), 'length']] : []),
      ...(named ? [[chosen, named, 'volume']] : []),
      ...others.map((name) => [name, name, 'field']),
    ];
  }

  async #load(field) {
    const index = this.#index;
    this.show(index); // until it is loaded
    await this.#layers.loadField(index, field, (id) => this.#layers.change(index, { color_by: id, ...PLAIN }, performance.now()));
  }

  show(index) {
    this.#index = index;
    const options = this.#options();
    this.root.hidden = options.length < 2;
    const shown = JSON.stringify(options);
    if (shown !== this.#shown) {
      this.#shown = shown;
      this.#select.replaceChildren(...options.map(([value, name, kind]) => {
        const option = new Option(name, value);
        option.dataset.kind = kind;
        return option;
      }));
    }
    this.#select.selectedIndex = Math.max(0, options.findIndex(([value, , kind]) => value === (this.#layer.color_by ?? '') && kind !== 'field'));
    this.#showRange();
  }
}
