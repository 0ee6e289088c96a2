// SPDX-License-Identifier: Apache-2.0
// The line between the two pictures of a comparison.
import { t } from '../../core/text.js';
import { make } from '../controls/dom.js';

const STEP = 2; // percent per press of an arrow key

/** The line between A and B: a separator that pointer and keys move. */
export class Divider {
  #root; #moved;
  #percent = 50;

  /** root: the element whose width it divides; moved(percent). */
  constructor(root, moved) {
    this.#root = root;
    this.#moved = moved;
    this.element = make('div', {
      id: 'compare-divider', role: 'separator', tabindex: 0, hidden: true, 'aria-orientation': 'vertical', 'aria-label': t('compare.divider'),
      title: t('compare.divider.title'), 'aria-valuemin': 0, 'aria-valuemax': 100,
    });
    this.element.addEventListener('pointerdown', (event) => {
      this.element.setPointerCapture(event.pointerId);
      event.preventDefault();
      this.element.focus();
    });
    this.element.addEventListener('pointermove', (event) => this.element.hasPointerCapture(event.pointerId) && this.#follow(event));
    this.element.addEventListener('keydown', (event) => this.#key(event));
  }

  get percent() { return this.#percent; }

  set(percent) {
    this.#percent = Math.min(100, Math.max(0, percent));
    this.element.style.left = `${this.#percent}%`;
    this.element.style.setProperty('--at', String(this.#percent));
    this.element.setAttribute('aria-valuenow', String(Math.round(this.#percent)));
    this.#moved(this.#percent);
  }

  #follow({ clientX }) {
    const box = this.#root.getBoundingClientRect();
    this.set(100 * (clientX - box.left) / box.width);
  }

  #key(event) {
    const step = { ArrowLeft: -STEP, ArrowRight: STEP, PageDown: -5 * STEP, PageUp: 5 * STEP }[event.key];
    const end = { Home: 0, End: 100 }[event.key];
    if (step === undefined && end === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    this.set(end ?? this.#percent + step);
  }
}
