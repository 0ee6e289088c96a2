// SPDX-License-Identifier: Apache-2.0
// The toolbar over the picture: groups of icons with tooltips. Groups that do not fit move into a menu with their names; on a phone
// that is all of them. Arrow keys move between the buttons; the toolbar is one stop of the Tab key.
import { t } from '../../core/text.js';
import { nextFrame } from '../frames/animation.js';
import { icon, isOffered, make } from '../controls/dom.js';

/** The order of the groups, and of new ones after them. */
const GROUPS = Object.freeze(['layout', 'view', 'tools', 'measure', 'compare', 'capture']);

export class Toolbar {
  #root; #menu; #more; #shortcuts;
  #groups = new Map(); // name → element
  #announced = new Map(); // id → {button, press(event)}
  #isPlanned = false;

  constructor(root, shortcuts) {
    this.#root = root;
    this.#shortcuts = shortcuts;
    this.#menu = make('div', { id: 'toolbar-menu', hidden: true });
    this.#more = make('button', {
      id: 'toolbar-more', 'aria-label': t('toolbar.more'), title: t('toolbar.more'), 'aria-expanded': 'false', 'aria-controls': 'toolbar-menu',
      press: () => this.#open(this.#menu.hidden),
    });
    this.#more.append(icon('ellipsis'));
    root.append(this.#more, this.#menu);
    root.addEventListener('keydown', (event) => this.#key(event));
    root.addEventListener('focusin', ({ target }) => this.#rove(target.closest('button')));
    this.#menu.addEventListener('click', ({ target }) => target.closest('button') && this.#open(false));
    document.addEventListener('pointerdown', ({ target }) => !root.contains(target) && this.#open(false));
    new ResizeObserver(() => this.plan()).observe(root.parentElement);
  }

  /**
   * Adds a button and returns it. icon: a name of icons.svg; label: its name and, with the key, its tooltip; key: a shortcut, or none;
   * group: one of GROUPS or a new one; isToggle: it has aria-pressed, which the caller sets; press(event). order: its place in the group
   * (default: last). needs: it appears only where this has a meaning (core/kinds.js).
   */
  button({ id, press, ...options }) {
    const known = this.#announced.get(id);
    if (!known) return this.#make({ id, press, ...options });
    this.#announced.delete(id);
    known.press = press;
    return known.button;
  }

  /** Adds a button whose feature comes later: button() with its id sets what it does. ask(act) calls act() as soon as the feature is there. */
  announce(options, ask) {
    const known = { press: (event) => ask(() => known.press(event)) };
    known.button = this.button({ ...options, press: (event) => known.press(event) });
    this.#announced.set(options.id, known);
  }

  #make({ id, icon: name, label, key = null, group = 'tools', isToggle = false, order = 1000, needs = null, press }) {
    const button = make('button', {
      id, class: 'tool', 'aria-label': label, title: key ? t('toolbar.tip', { label, key: key.toUpperCase() }) : label, tabindex: '-1',
      'data-order': order, 'data-needs': needs ?? false, ...(isToggle ? { 'aria-pressed': 'false' } : {}), press,
    }, icon(name), make('span', { class: 'label', text: label }));
    if (key) this.#shortcuts.add(key, (event) => !button.disabled && press(event), label, needs);
    this.#insert(this.#group(group), button, order);
    this.plan();
    return button;
  }

  #insert(group, element, order) {
    const next = [...group.children].find((other) => Number(other.dataset.order) > order);
    group.insertBefore(element, next ?? null);
  }

  #group(name) {
    if (!this.#groups.has(name)) {
      const rank = GROUPS.includes(name) ? GROUPS.indexOf(name) : GROUPS.length;
      const made = make('div', { class: 'tools', role: 'group', 'data-group': name, 'data-order': rank });
      this.#groups.set(name, made);
    }
    return this.#groups.get(name);
  }

  get #ordered() {
    return [...this.#groups.values()].sort((a, b) => a.dataset.order - b.dataset.order);
  }

  /** Arranges the groups at the next animation frame; call it when buttons appear or disappear. */
  plan() {
    if (this.#isPlanned) return;
    this.#isPlanned = true;
    nextFrame(() => { // an observer of sizes must not change sizes itself
      this.#isPlanned = false;
      this.#arrange();
    });
  }

  /** Shows as many groups as fit and puts the others into the menu. */
  #arrange() {
    const focused = this.#root.contains(document.activeElement) ? document.activeElement : null;
    const groups = this.#ordered;
    for (const group of groups) {
      this.#root.insertBefore(group, this.#more);
      group.hidden = [...group.children].every(({ dataset }) => !isOffered(dataset.needs));
    }
    this.#more.hidden = false;
    const space = this.#root.parentElement.clientWidth;
    let shown = window.matchMedia('(max-width: 640px)').matches ? 0 : groups.length;
    Object.assign(this.#root.style, { width: 'max-content', maxWidth: 'none' }); // its natural width
    const widths = groups.map((group) => group.getBoundingClientRect().width);
    const frame = this.#root.offsetWidth - widths.reduce((a, b) => a + b, 0) - this.#more.offsetWidth;
    Object.assign(this.#root.style, { width: '', maxWidth: '' });
    const width = (count) => frame + widths.slice(0, count).reduce((a, b) => a + b, 0) + (count < groups.length ? this.#more.offsetWidth : 0);
    while (shown > 0 && width(shown) > space) shown -= 1;
    this.#menu.replaceChildren(...groups.slice(shown));
    this.#more.hidden = shown === groups.length;
    if (this.#more.hidden) this.#open(false);
    this.#root.hidden = groups.length === 0;
    focused?.focus();
    this.#rove(this.#buttons.find((button) => button.tabIndex === 0) ?? this.#buttons[0]);
  }

  get #buttons() {
    return [...this.#root.querySelectorAll('button')].filter((button) => button.checkVisibility());
  }

  #open(isOpen) {
    if (this.#menu.hidden !== isOpen) return;
    const hadFocus = this.#menu.contains(document.activeElement);
    this.#menu.hidden = !isOpen;
    this.#more.setAttribute('aria-expanded', String(isOpen));
    if (isOpen) this.#menu.querySelector('button:not(:disabled)')?.focus();
    else if (hadFocus) this.#more.focus();
  }

  /** Makes one button the stop of the Tab key. */
  #rove(current) {
    if (!current) return;
    for (const button of this.#root.querySelectorAll('button')) button.tabIndex = button === current ? 0 : -1;
  }

  #key(event) {
    if (event.key === 'Escape' && !this.#menu.hidden) {
      this.#open(false);
      event.preventDefault();
      return;
    }
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    const buttons = this.#buttons.filter((button) => !button.disabled);
    const at = buttons.indexOf(document.activeElement);
    if (!step || at < 0 || event.ctrlKey || event.altKey || event.metaKey) return;
    buttons[(at + step + buttons.length) % buttons.length].focus();
    event.preventDefault();
  }
}
