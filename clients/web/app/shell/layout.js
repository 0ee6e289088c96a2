// SPDX-License-Identifier: Apache-2.0
// The panes of the page: a grid in <main>. The pane "3d" holds the picture and exists always; others add panes for slices or comparisons.
// The frames of the session have the size of the pane "3d".
import { Emitter } from '../../core/emitter.js';
import { make } from '../controls/dom.js';

const PICTURE = '3d';
const SLICES = ['four', 'slices'];

/** Events: change (the name of the new layout). */
export class Layout extends Emitter {
  #root;
  #panes = new Map(); // id → {element, layouts}
  #layouts = new Map([[PICTURE, {}], ['four', {}], ['slices', { hasPicture: false }]]);
  #name = PICTURE;

  /** root: <main> with the pane "3d" in it. */
  constructor(root) {
    super();
    this.#root = root;
    this.#panes.set(PICTURE, { element: root.querySelector('#pane-3d'), layouts: null });
    this.#show();
  }

  get current() { return this.#name; }

  /**
   * Adds a pane and returns the element to fill; its title stands in the upper left corner. layouts: the layouts that show the pane. Panes
   * stand in the order in which they were added, after the picture.
   */
  pane(id, title, { layouts = SLICES } = {}) {
    if (this.#panes.has(id)) throw new Error(`there is a pane ${id} already`);
    const body = make('div', { class: 'pane-body' });
    const element = make('section', { class: 'pane', id: `pane-${id}`, 'aria-label': title },
      body, make('p', { class: 'pane-title', text: title, 'aria-hidden': 'true' }));
    this.#panes.set(id, { element, layouts });
    this.#root.append(element);
    this.#show();
    return body;
  }

  /** Adds a layout. hasPicture: it shows the pane "3d". */
  add(name, { hasPicture = true } = {}) {
    this.#layouts.set(name, { hasPicture });
  }

  /** The element that fills a pane. */
  body(id) { return this.#panes.get(id).element.querySelector('.pane-body'); }

  /** True if the current layout has panes with slices. */
  get showsSlices() { return SLICES.includes(this.#name); }

  set(name) {
    if (!this.#layouts.has(name)) throw new Error(`there is no layout ${name}`);
    if (name === this.#name) return;
    this.#name = name;
    this.#show();
    this.emit('change', name);
  }

  /** True if the current layout shows this pane. */
  isShown(id) {
    return !this.#panes.get(id).element.hidden;
  }

  #show() {
    const { hasPicture = true } = this.#layouts.get(this.#name);
    let count = 0;
    for (const [id, { element, layouts }] of this.#panes) {
      const isShown = id === PICTURE ? hasPicture : layouts.includes(this.#name);
      element.hidden = !isShown;
      count += Number(isShown);
    }
    this.#root.dataset.layout = this.#name;
    this.#root.dataset.panes = String(Math.min(count, 4));
  }
}

/** The buttons for layouts that have panes of their own. */
export function layoutButton({ toolbar, layout }, { name, icon: sign, label, key, order, needs = null }) {
  const button = toolbar.button({
    id: `layout-${name}`, icon: sign, label, key, order, group: 'layout', isToggle: true, needs, press: () => layout.set(name),
  });
  const show = () => button.setAttribute('aria-pressed', String(layout.current === name));
  layout.on('change', show);
  show();
  return button;
}
