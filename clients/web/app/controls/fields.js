// SPDX-License-Identifier: Apache-2.0
// Rows of the panel for one field of the view each: <div class="row" data-pointer="/filter/mode"> with a select, a slider, or
// an input for a number, which is null while it is empty. A slider is null at its lowest step if its scale says so.
// Errors of the daemon about a field appear below its row.
import { allows, choose, isChoice, matters, valueAt } from '../../core/choices.js';
import { numberText } from '../../core/lengths.js';
import { logarithmic } from '../../core/slider.js';
import { t } from '../../core/text.js';

const IDENTITY = { at: Number, of: Number };
const SCALES = {
  '/compositing/slab': logarithmic(0.05, 64),
  '/shading/smoothing': { at: (place) => (place < 0 ? null : place), of: (value) => value ?? -1 }, // automatic is the step below 0
};

/** Rounds to three digits: 0.7, 12.5, -1790. */
const threeDigits = (value) => Number(value.toPrecision(3));

/** Formats a number with three digits: 0.7, 12.5, −1790. */
export const showNumber = (value) => numberText(threeDigits(value));

/** Sets the text beside a slider and its value for screen readers. */
export function showValue(slider, text) {
  slider.setAttribute('aria-valuetext', text);
  slider.closest('.row').querySelector('output').textContent = text;
}

/** Sets a select. A newer daemon may have choices that the page does not know. */
function showChoice(select, value) {
  if (![...select.options].some((option) => option.value === value)) select.add(new Option(value, value));
  select.value = value;
}

export class Fields {
  #rows = [];

  /** Uses all rows below `root` whose fields are choices. */
  constructor(root, { viewer, notice }) {
    for (const row of root.querySelectorAll('.row[data-pointer]')) {
      const { pointer } = row.dataset;
      if (!isChoice(pointer)) continue;
      const control = row.querySelector('select, input');
      const [isSlider, isNumber] = [control.type === 'range', control.type === 'number'];
      const scale = SCALES[pointer] ?? IDENTITY;
      const read = () => (isSlider ? scale.at(control.valueAsNumber) : control.value);
      const readNumber = () => (Number.isFinite(control.valueAsNumber) ? control.valueAsNumber : null);
      control.addEventListener(isSlider ? 'input' : 'change', (event) => {
        const value = isNumber ? readNumber() : read();
        const patch = choose(viewer.view, pointer, value);
        viewer.change(patch, event.timeStamp);
        if (patch.layers) notice.show(t('picture.projection.alone'));
      });
      this.#rows.push({ row, pointer, control, isSlider, isNumber, scale });
    }
  }

  show(view) {
    for (const { row, pointer, control, isSlider, isNumber, scale } of this.#rows) {
      const value = valueAt(view, pointer);
      control.disabled = !matters(view, pointer);
      row.toggleAttribute('data-idle', control.disabled);
      if (isSlider) {
        control.value = scale.of(value);
        const { unit } = control.dataset;
        showValue(control, value === null ? t('picture.auto') : unit ? `${showNumber(value)} ${unit}` : showNumber(value));
      } else if (isNumber) {
        if (document.activeElement !== control || control.valueAsNumber !== value) control.value = value ?? '';
      } else {
        showChoice(control, value);
        for (const option of control.options) option.disabled = !allows(view, pointer, option.value);
      }
    }
  }
}

/** Shows errors of the daemon below the controls that they refer to. */
export class Complaints {
  #root;

  /** An element with data-pointer below `root` represents that field and all fields below it without an element of their own. */
  constructor(root) {
    this.#root = root;
    root.addEventListener('input', () => this.clear(), { capture: true });
    root.addEventListener('click', ({ target }) => target.closest('button') && this.clear(), { capture: true });
  }

  /** Shows `text` beside the field. False if no visible control represents the field. */
  show(pointer, text) {
    const isAbout = (place) => pointer === place || pointer.startsWith(`${place}/`);
    const [place] = [...this.#root.querySelectorAll('[data-pointer]')].filter((element) => isAbout(element.dataset.pointer))
      .sort((a, b) => b.dataset.pointer.length - a.dataset.pointer.length);
    if (!place || place.closest('[hidden], details:not([open])')) return false;
    this.clear();
    const complaint = document.createElement('p');
    complaint.className = 'complaint';
    complaint.id = 'complaint';
    complaint.setAttribute('role', 'alert');
    complaint.textContent = text;
    if (place.classList.contains('row')) place.after(complaint);
    else place.append(complaint);
    for (const control of place.querySelectorAll('select, input')) {
      control.setAttribute('aria-invalid', 'true');
      control.setAttribute('aria-describedby', 'complaint');
    }
    complaint.scrollIntoView?.({ block: 'nearest' });
    return true;
  }

  clear() {
    document.getElementById('complaint')?.remove();
    for (const control of this.#root.querySelectorAll('[aria-invalid]')) {
      control.removeAttribute('aria-invalid');
      control.removeAttribute('aria-describedby');
    }
  }
}
