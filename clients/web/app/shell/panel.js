// SPDX-License-Identifier: Apache-2.0
// The panel: folds in a fixed order, and errors of the daemon beside the controls that they refer to. On a phone it is a sheet (sheet.js).
import { t } from '../../core/text.js';
import { byId, make } from '../controls/dom.js';
import { Complaints } from '../controls/fields.js';

/** Places of the sections. A new section takes a number between its neighbours. */
export const ORDER = Object.freeze({
  volumes: 10, time: 15, transfer: 20, channels: 22, layers: 25, slices: 30, clip: 40, edit: 42, measure: 50, compare: 60, capture: 70, path: 80, people: 90, picture: 100,
});
/** Windows whose panel is a sheet: at the bottom in portrait, else at the left. The same as in sheet.css. */
export const NARROW = '(max-width: 640px), (max-height: 480px)';

export class Panel {
  #root; #body; #complaints; #storage;
  #announced = new Map(); // id → body
  #height = 'closed';

  constructor(storage) {
    this.#root = byId('panel');
    this.#body = byId('panel-body');
    this.#storage = storage;
    this.#complaints = new Complaints(this.#body);
    byId('panel-toggle').addEventListener('click', () => this.toggle());
    for (const fold of this.#body.querySelectorAll(':scope > details')) this.#follow(fold);
    this.set(window.matchMedia(NARROW).matches ? 'closed' : 'half');
  }

  /** closed, half or full; half and full differ in a sheet at the bottom only. */
  get height() { return this.#height; }
  get isClosed() { return this.#height === 'closed'; }

  set(height) {
    const isOpen = height !== 'closed';
    this.#height = height;
    this.#root.dataset.open = String(isOpen);
    this.#root.dataset.height = height;
    if (isOpen) document.body.dataset.panel = height;
    else delete document.body.dataset.panel;
    byId('panel-size').setAttribute('aria-pressed', String(height === 'full'));
    const button = byId('panel-toggle');
    button.setAttribute('aria-expanded', String(isOpen));
    button.setAttribute('aria-label', t(isOpen ? 'panel.hide' : 'panel.show'));
    if (!isOpen && this.#root.contains(document.activeElement)) button.focus(); // else the next Tab would begin at the top of the page
    this.#body.hidden = !isOpen;
  }

  toggle(isOpen = this.#height === 'closed') {
    if (isOpen !== (this.#height !== 'closed')) this.set(isOpen ? 'half' : 'closed');
  }

  /**
   * Makes a fold of the panel and returns its body. id: of the <details>; order: see ORDER; isOpen: at the first visit, later the tab
   * remembers it. needs: the fold appears only where this has a meaning (core/kinds.js). For an announced section the id is enough.
   */
  section({ id, title = '', order = 0, isOpen = false, needs = null }) {
    const known = this.#announced.get(id);
    this.#announced.delete(id);
    if (known) return known;
    const body = make('div', { class: 'fold-body' });
    const fold = make('details', { class: 'fold', id, 'data-order': order, 'data-needs': needs ?? false, open: isOpen }, make('summary', {}, make('h2', { text: title })), body);
    const next = [...this.#body.children].find((other) => Number(other.dataset.order) > order);
    this.#body.insertBefore(fold, next ?? null);
    this.#follow(fold);
    return body;
  }

  /** Makes the fold of a feature that comes later and calls section() with the same id. */
  announce(options) { this.#announced.set(options.id, this.section(options)); }

  /** Opens the panel and the section with this id, and shows it. */
  reveal(id) {
    this.toggle(true);
    byId(id).open = true;
    byId(id).scrollIntoView?.({ block: 'nearest' });
  }

  /** Opens the section with this id, and shows it if the panel is open. */
  unfold(id) {
    byId(id).open = true;
    if (!this.isClosed) byId(id).scrollIntoView?.({ block: 'nearest' });
  }

  #follow(fold) {
    const known = this.#storage.recall(`fold:${fold.id}`);
    if (known) fold.open = known === 'open';
    let isPressed = false;
    fold.querySelector('summary').addEventListener('click', () => { isPressed = true; });
    fold.addEventListener('toggle', () => {
      this.#storage.remember(`fold:${fold.id}`, fold.open ? 'open' : 'closed');
      if (isPressed && fold.open) fold.scrollIntoView({ block: 'nearest' });
      isPressed = false;
    });
  }

  /** Shows below a field's control why the daemon refused it. False if no visible control represents the field. */
  complain(pointer, text) {
    return this.#complaints.show(pointer, text);
  }
}
