// SPDX-License-Identifier: Apache-2.0
// Messages that wait for an answer, at the lower right. They stay until the user answers or closes them, unless they have a time.
import { t } from '../../core/text.js';
import { make } from '../controls/dom.js';

export class Prompts {
  #root;
  #shown = new Map(); // by id: {element, text, timer}

  constructor(root) {
    this.#root = root;
  }

  /**
   * Shows a message, or another text of the message `id`. actions: [{label, press()}], which also close it; ms: closes it after that
   * time; isUrgent: screen readers interrupt for it.
   */
  show(id, { text, actions = [], ms = 0, isUrgent = false }) {
    const before = this.#shown.get(id);
    clearTimeout(before?.timer);
    if (before?.text !== text) {
      const close = make('button', { class: 'close', text: '×', 'aria-label': t('notice.close'), press: () => this.hide(id) });
      const answers = actions.map(({ label, press }) => make('button', {
        text: label,
        press: () => {
          this.hide(id);
          press();
        },
      }));
      const element = make('div', { class: 'prompt', 'data-id': id, role: isUrgent ? 'alert' : 'status' }, make('p', { text }), close,
        ...(answers.length ? [make('div', { class: 'buttons' }, ...answers)] : []));
      if (before) before.element.replaceWith(element);
      else this.#root.append(element);
      this.#shown.set(id, { element, text });
    }
    this.#shown.get(id).timer = ms ? setTimeout(() => this.hide(id), ms) : null;
  }

  hide(id) {
    const shown = this.#shown.get(id);
    if (!shown) return;
    clearTimeout(shown.timer);
    shown.element.remove();
    this.#shown.delete(id);
  }

  /** Hides the messages whose id begins with `start`, except those in `kept`. */
  hideOthers(start, kept) {
    for (const id of [...this.#shown.keys()]) if (id.startsWith(start) && !kept.includes(id)) this.hide(id);
  }
}
