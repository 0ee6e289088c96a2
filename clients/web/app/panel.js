// SPDX-License-Identifier: Apache-2.0
// The panel at the left: folds in a fixed order, and errors of the daemon beside the controls that they refer to.
import { t } from '../core/text.js';
import { byId, make } from './dom.js';
import { Complaints } from './fields.js';

/** Places of the sections. A new section takes a number between its neighbours. */
export const ORDER = Object.freeze({
  volumes: 10, transfer: 20, layers: 25, slices: 30, clip: 40, edit: 42, measure: 50, compare: 60, capture: 70, path: 80, people: 90, picture: 100,
});
const NARROW = '(max-width: 640px), (max-height: 480px)';

export class Panel {
  #root; #body; #complaints; #storage;

  constructor(storage) {
    this.#root = byId('panel');
    this.#body = byId('panel-body');
    this.#storage = storage;
    this.#complaints = new Complaints(this.#body);
    byId('panel-toggle').addEventListener('click', () => this.toggle());
    for (const fold of this.#body.querySelectorAll(':scope > details')) this.#follow(fold);
    this.toggle(!window.matchMedia(NARROW).matches);
  }

  toggle(isOpen = this.#root.dataset.open !== 'true') {
    this.#root.dataset.open = String(isOpen);
    document.body.toggleAttribute('data-panel', isOpen);
    const button = byId('panel-toggle');
    button.setAttribute('aria-expanded', String(isOpen));
    button.setAttribute('aria-label', t(isOpen ? 'panel.hide' : 'panel.show'));
    if (!isOpen && this.#body.contains(document.activeElement)) button.focus(); // else the next Tab would begin at the top of the page
    this.#body.hidden = !isOpen;
  }

  /**
   * Makes a fold of the panel and returns its body. id: of the <details>; order: see ORDER; isOpen: at the first visit, later the tab
   * remembers it.
   */
  section({ id, title, order, isOpen = false }) {
    const body = make('div', { class: 'fold-body' });
    const fold = make('details', { class: 'fold', id, 'data-order': order, open: isOpen }, make('summary', {}, make('h2', { text: title })), body);
    const next = [...this.#body.children].find((other) => Number(other.dataset.order) > order);
    this.#body.insertBefore(fold, next ?? null);
    this.#follow(fold);
    return body;
  }

  /** Opens the panel and the section with this id, and shows it. */
  reveal(id) {
    this.toggle(true);
    byId(id).open = true;
    byId(id).scrollIntoView?.({ block: 'nearest' });
  }

  #follow(fold) {
    const known = this.#storage.recall(`fold:${fold.id}`);
    if (known) fold.open = known === 'open';
    fold.addEventListener('toggle', () => this.#storage.remember(`fold:${fold.id}`, fold.open ? 'open' : 'closed'));
  }

  /** Shows below a field's control why the daemon refused it. False if no visible control represents the field. */
  complain(pointer, text) {
    return this.#complaints.show(pointer, text);
  }
}
