// SPDX-License-Identifier: Apache-2.0
// A menu below a button of the toolbar, for pointer, keys and screen readers.
import { byId, make } from './dom.js';

/** A menu below a button of the toolbar. */
export class Menu {
  #root; #show;
  #button = null;

  /** groups: the items, between lines; show() updates them before they are shown. */
  constructor({ id, label, groups, show }) {
    this.#show = show;
    this.#root = make('div', { id, class: 'menu', role: 'menu', 'aria-label': label, hidden: true },
      ...groups.map((items) => make('div', { role: 'group' }, ...items)));
    byId('toolbar').after(this.#root);
    this.#root.addEventListener('keydown', (event) => this.#key(event));
    this.#root.addEventListener('click', ({ target }) => target.closest('[role="menuitem"]') && this.close());
    document.addEventListener('pointerdown', ({ target }) => {
      if (!this.#root.contains(target) && !this.#button?.contains(target)) this.close();
    });
    this.#root.addEventListener('focusout', ({ relatedTarget }) => {
      if (relatedTarget && !this.#root.contains(relatedTarget)) this.close();
    });
  }

  get #items() { return [...this.#root.querySelectorAll('button:not(:disabled)')]; }

  show() {
    this.#show();
  }

  toggle(button) {
    if (!this.#root.hidden) {
      this.close();
      return;
    }
    this.#button = button;
    this.show();
    this.#root.hidden = false;
    button.setAttribute('aria-expanded', 'true');
    const place = button.getBoundingClientRect();
    const tools = this.#root.parentElement.getBoundingClientRect();
    const space = tools.width - this.#root.offsetWidth;
    this.#root.style.left = `${Math.max(Math.min(0, space), Math.min(place.left - tools.left, space))}px`;
    this.#items[0]?.focus();
  }

  close() {
    if (this.#root.hidden) return;
    const hadFocus = this.#root.contains(document.activeElement);
    this.#root.hidden = true;
    this.#button.setAttribute('aria-expanded', 'false');
    if (hadFocus) (this.#button.checkVisibility() ? this.#button : byId('screen')).focus();
  }

  #key(event) {
    const items = this.#items;
    const at = items.indexOf(document.activeElement);
    const next = {
      ArrowDown: (at + 1) % items.length, ArrowUp: (at - 1 + items.length) % items.length, Home: 0, End: items.length - 1,
    }[event.key];
    if (next !== undefined) items[next].focus();
    else if (event.key === 'Escape') this.close();
    else return;
    event.preventDefault();
  }
}
