// SPDX-License-Identifier: Apache-2.0
// Rows of the controls of a layer, and the buttons that hide and remove it.
import { t } from '../../core/text.js';
import { icon, make } from '../controls/dom.js';

/** "#ff8000" of a colour [1, 0.5, 0], and back. */
export const hexOf = (color) => `#${color.map((part) => Math.round(part * 255).toString(16).padStart(2, '0')).join('')}`;
const colorOf = (hex) => [1, 3, 5].map((i) => Number((parseInt(hex.slice(i, i + 2), 16) / 255).toFixed(4)));

/** Rounds to the digits that fields show. */
export const digits = (value) => Number(value.toPrecision(6));

/** The button that hides and shows what is called `name`. */
export const makeEye = (name, press) => make('button', { class: 'eye', 'aria-label': t('layers.show', { name }), title: t('layers.show', { name }), press });

/** Shows in an item of a list whether it is visible. */
export function showEye(item, isVisible) {
  const eye = item.querySelector('.eye');
  if (eye.getAttribute('aria-pressed') === String(isVisible)) return;
  eye.setAttribute('aria-pressed', String(isVisible));
  eye.replaceChildren(icon(isVisible ? 'eye' : 'eye-off'));
  item.toggleAttribute('data-off', !isVisible);
}

/** The button that removes what is called `name`. */
export const makeRemover = (name, press) => make('button', { class: 'small', 'aria-label': t('layers.remove', { name }), title: t('layers.remove', { name }), press }, icon('trash-2'));

/** A row of a label, a slider and what stands for its value. */
export function sliderRow({ id, label, title, slider, value = make('output', { for: id }) }) {
  return make('div', { class: 'row', title }, make('label', { for: id, text: label }), slider, value);
}

/** Streams a slider as one step for undo. */
export function onSlide(layers, slider, change) {
  slider.addEventListener('pointerdown', () => layers.begin());
  slider.addEventListener('keydown', ({ repeat }) => repeat || layers.begin());
  slider.addEventListener('input', ({ timeStamp }) => change(slider.valueAsNumber, timeStamp));
  slider.addEventListener('change', () => layers.end());
}

/** The same for a field of a colour. */
export function onColor(layers, input, change) {
  input.addEventListener('pointerdown', () => layers.begin());
  input.addEventListener('input', ({ timeStamp }) => change(colorOf(input.value), timeStamp));
  input.addEventListener('change', () => layers.end());
}
