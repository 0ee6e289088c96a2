// SPDX-License-Identifier: Apache-2.0
// The tools of the picture. One at a time owns the pointer; "navigate" is the default. A bar below the toolbar names the mode, shows what
// it measures, and ends it; so does Escape.
//
// A mode is {label, hint, cursor, enter(), leave(), down(at, event), move(at, event), up(at, event), hover(at, event), double(at, event),
// wheel(event), key(event), cancel()}; everything is optional. `at` is [x, y] in CSS px of the 3-D picture.
//   down … up   one drag with the left button, the pen or one finger. Other buttons, Shift and two fingers always navigate.
//   hover       the pointer moves with no button pressed
//   key         a key on the page; true if the mode used it
//   cancel      the drag ended without a result: a second finger came, or the mode ends; undo what down() began
//   wheel       true if the mode used it; otherwise the wheel zooms
// A mode that also works on slices (pane.js) has `panes` with down, move, up, hover, double, cancel and cursor; they get the pane as third argument,
// and `at` in px of that pane. `isForPanes` means that it works there alone.
//
// A mode takes the focus to the picture or to a pane, so that its keys work. When it ends, what had the focus gets it back, unless the pointer
// was used in between.
import { Emitter } from '../../core/emitter.js';
import { t } from '../../core/text.js';
import { byId, setText } from '../controls/dom.js';

const NAVIGATE = 'navigate';

/** Events: change (the name of the new mode). */
export class Modes extends Emitter {
  #modes = new Map([[NAVIGATE, {}]]);
  #name = NAVIGATE;
  #surface;
  #isDragging = false;
  #pane = null; // of the drag; null = the 3-D picture
  #before = null; // what had the focus before the mode; null = it stays where it is

  /** surface: the element that gets the pointer of the 3-D picture. */
  constructor(surface) {
    super();
    this.#surface = surface;
    byId('mode-done').addEventListener('click', () => this.leave());
    const bar = byId('mode-bar');
    new ResizeObserver(() => document.body.style.setProperty('--bar', `${bar.offsetHeight}px`)).observe(bar);
    window.addEventListener('keydown', (event) => {
      if (event.key !== 'Escape' || event.defaultPrevented || this.#name === NAVIGATE || event.target.closest?.('dialog')) return;
      event.preventDefault();
      this.leave();
    });
  }

  get current() { return this.#name; }
  get isNavigating() { return this.#name === NAVIGATE; }

  add(name, mode) {
    if (this.#modes.has(name)) throw new Error(`there is a mode ${name} already`);
    this.#modes.set(name, mode);
  }

  /** Adds members to a mode of another feature, such as `panes`. */
  extend(name, members) {
    Object.assign(this.#modes.get(name), members);
  }

  #part(pane) {
    const mode = this.#modes.get(this.#name);
    return (pane ? mode.panes : mode) ?? {};
  }

  /** The cursor of the mode in a pane. */
  cursorIn(pane) { return this.#part(pane).cursor ?? ''; }

  enter(name) {
    const mode = this.#modes.get(name);
    if (!mode) throw new Error(`there is no mode ${name}`);
    if (name === this.#name) return;
    this.cancel();
    const before = this.#modes.get(this.#name);
    const focused = document.activeElement;
    if (this.isNavigating) this.#before = focused;
    this.#name = name;
    before.leave?.();
    this.#show(mode);
    mode.enter?.();
    if (this.isNavigating) this.#returnFocus(focused);
    else this.#takeFocus(mode, focused);
    this.emit('change', name);
  }

  /** The visible elements in which a mode works: the picture and the panes. */
  #homesOf(mode) {
    return [...(mode.isForPanes ? [] : [this.#surface]), ...(mode.panes ? document.querySelectorAll('.pane-body canvas.slice') : [])]
      .filter((element) => element.checkVisibility());
  }

  #takeFocus(mode, focused) {
    const homes = this.#homesOf(mode);
    if (homes.includes(focused)) return;
    const body = focused?.closest('.pane-body');
    (homes.find((home) => body?.contains(home)) ?? homes[0])?.focus({ preventScroll: true });
  }

  #returnFocus(focused) {
    const before = this.#before;
    const isInBar = byId('mode-bar').contains(focused);
    const isInPicture = focused === this.#surface || focused === document.body || focused?.matches('canvas.slice');
    this.#before = null;
    if (!isInBar && !isInPicture) return; // another part of the page has it
    if (before?.isConnected && before !== document.body && before.checkVisibility()) before.focus({ preventScroll: true });
    else if (isInBar) this.#surface.focus({ preventScroll: true });
  }

  /** Returns to navigation; with a name, only from that mode. */
  leave(name = this.#name) {
    if (name !== this.#name || name === NAVIGATE) return;
    this.enter(NAVIGATE);
  }

  toggle(name) {
    if (this.#name === name) this.leave();
    else this.enter(name);
  }

  /** Shows what the current mode measures, in bold, and another hint if there is one. */
  say(text, hint = null) {
    setText(byId('mode-text'), text);
    if (hint !== null) setText(byId('mode-hint'), hint);
  }

  #show({ label = '', hint = '', cursor = '' }) {
    byId('mode-bar').hidden = this.isNavigating;
    this.#surface.dataset.tool = this.#name;
    this.#surface.style.cursor = cursor;
    this.say(label, hint);
    byId('mode-done').title = t('mode.done.title');
  }

  // For pointer.js.

  /** Starts a drag; true if the mode takes it. */
  down(at, event, pane = null) {
    const part = this.#part(pane);
    this.#before = null;
    if (!part.down || part.down(at, event, pane) === false) return false;
    this.#isDragging = true;
    this.#pane = pane;
    return true;
  }

  move(at, event, pane = null) {
    if (this.#isDragging) this.#part(pane).move?.(at, event, pane);
  }

  up(at, event, pane = null) {
    if (!this.#isDragging) return;
    this.#isDragging = false;
    this.#part(pane).up?.(at, event, pane);
  }

  cancel() {
    if (!this.#isDragging) return;
    this.#isDragging = false;
    this.#part(this.#pane).cancel?.(this.#pane);
  }

  hover(at, event, pane = null) { this.#part(pane).hover?.(at, event, pane); }

  /** True if the mode has an action for a double click. */
  double(at, event, pane = null) {
    const { double } = this.#part(pane);
    double?.(at, event, pane);
    return Boolean(double) || !this.isNavigating;
  }

  wheel(event) { return this.#modes.get(this.#name).wheel?.(event) === true; }
  key(event) { return this.#modes.get(this.#name).key?.(event) === true; }
}
