// SPDX-License-Identifier: Apache-2.0
// Standard views, the projection, and the upright camera: a menu of the toolbar, and keys.
import { sphereAround } from '../core/camera.js';
import { withProjection } from '../core/movement.js';
import { VIEWS, anglesOf, orientationOf, viewDirection } from '../core/orientation.js';
import { t } from '../core/text.js';
import { byId, make, setText } from './dom.js';

export function install(app) {
  const { viewer, orientation, storage, shortcuts, toolbar } = app;
  const items = [];

  /** Makes a line of the menu. isOn() makes it a switch. */
  const add = ({ name, key, act, isOn = null, values = () => ({}) }) => {
    const label = make('span');
    const item = make('button', {
      role: isOn ? 'menuitemcheckbox' : 'menuitem', tabindex: -1, 'data-name': name, press: ({ timeStamp }) => act(timeStamp),
    }, label, make('kbd', { text: key.toUpperCase() }));
    const show = () => {
      setText(label, t(`views.${name}`, values()));
      if (isOn) item.setAttribute('aria-checked', String(isOn()));
    };
    items.push({ item, show });
    return item;
  };

  const side = (name) => {
    const direction = viewDirection(orientation.frame, name);
    const axis = direction.findIndex((part) => Math.abs(part) === 1);
    return axis < 0 ? {} : { side: orientation.letter(axis, direction[axis]) };
  };
  const turn = (name, time) => orientation.turnTo(viewDirection(orientation.frame, name), time);
  const standard = VIEWS.map((name, i) => add({ name, key: String(i + 1), values: () => side(name), act: (time) => turn(name, time) }));
  shortcuts.add(VIEWS.map((name, i) => String(i + 1)), ({ key, timeStamp }) => turn(VIEWS[Number(key) - 1], timeStamp), t('views.keys'));
  const project = (time) => {
    if (!viewer.isReady) return;
    const other = viewer.rig.projection === 'orthographic' ? 'perspective' : 'orthographic';
    viewer.place(withProjection(viewer.rig, other, sphereAround(viewer.box)), time);
    viewer.emit('view', viewer.view);
  };
  const flat = add({ name: 'orthographic', key: 't', act: project, isOn: () => viewer.rig?.projection === 'orthographic' });
  shortcuts.add('t', ({ timeStamp }) => project(timeStamp), t('views.orthographic'));

  let isUpright = storage.recall('upright') === 'yes';
  const lock = () => { viewer.upright = isUpright ? orientation.frame : null; };
  const level = (time) => {
    if (!viewer.isReady) return;
    const { azimuth, elevation } = anglesOf(orientation.frame, viewer.orientation);
    orientation.glide.to({ ...viewer.rig, orientation: orientationOf(orientation.frame, { azimuth, elevation }) }, time);
  };
  const toggleUpright = (time) => {
    isUpright = !isUpright;
    storage.remember('upright', isUpright ? 'yes' : 'no');
    lock();
    if (isUpright) level(time);
    menu.show();
  };
  const upright = add({ name: 'upright', key: 'u', isOn: () => isUpright, act: toggleUpright });
  shortcuts.add('u', ({ timeStamp }) => toggleUpright(timeStamp), t('views.upright'));

  const menu = new Menu([standard, [flat, upright]], () => items.forEach(({ show }) => show()));
  const button = toolbar.button({ id: 'views', icon: 'compass', label: t('views.label'), group: 'view', order: 10, press: () => menu.toggle(button) });
  button.setAttribute('aria-haspopup', 'menu');
  button.setAttribute('aria-expanded', 'false');
  viewer.on('view', () => {
    for (const { item } of items) item.disabled = !viewer.canControl && item !== upright;
    menu.show();
  });
  orientation.on('change', () => {
    lock();
    menu.show();
  });
}

/** A menu below a button of the toolbar. */
class Menu {
  #root; #show;
  #button = null;

  constructor(groups, show) {
    this.#show = show;
    this.#root = make('div', { id: 'views-menu', class: 'menu', role: 'menu', 'aria-label': t('views.label'), hidden: true },
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
