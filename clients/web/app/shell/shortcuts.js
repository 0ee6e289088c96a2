// SPDX-License-Identifier: Apache-2.0
// Keys of the page. A key works everywhere but in fields and dialogs. The list of controls shows the keys that have a label.
import { isOffered, make } from '../controls/dom.js';

const FIELDS = 'input, select, textarea, dialog';

export class Shortcuts {
  #list; #first;
  #keys = new Map(); // by key, letters in lower case

  /** list: the <tbody> that shows the keys. first(event) sees every key before the others; true if it used the key. */
  constructor(list, first) {
    this.#list = list;
    this.#first = first;
    window.addEventListener('keydown', (event) => this.#press(event));
  }

  /**
   * keys: one or several values of KeyboardEvent.key; letters work in both cases. press(event) may return false: then the browser handles
   * the key. label: what the list of controls shows, or '' for a key that index.html lists itself. needs: the key works only where this
   * has a meaning (core/kinds.js). Throws if a key is taken.
   */
  add(keys, press, label = '', needs = null) {
    const all = [keys].flat();
    for (const key of all.map((name) => name.toLowerCase())) {
      if (this.#keys.has(key)) throw new Error(`the key ${key} is taken`);
      this.#keys.set(key, { press, needs });
    }
    if (label) {
      const names = all.flatMap((key, i) => [...(i ? [' '] : []), make('kbd', { text: key.length === 1 ? key.toUpperCase() : key })]);
      this.#list.append(make('tr', { 'data-needs': needs ?? false }, make('th', { text: label }), make('td'), make('td'), make('td', {}, ...names)));
    }
  }

  #press(event) {
    if (event.altKey || event.ctrlKey || event.metaKey || event.defaultPrevented) return;
    if (event.target.closest?.(FIELDS)) return;
    if (this.#first(event)) {
      event.preventDefault();
      return;
    }
    const { press, needs } = this.#keys.get(event.key.toLowerCase()) ?? {};
    if (press && isOffered(needs) && press(event) !== false) event.preventDefault();
  }
}
