// SPDX-License-Identifier: Apache-2.0
// Standard views, the projection, and the upright camera: a menu of the toolbar, and keys.
import { sphereAround } from '../../core/camera.js';
import { withProjection } from '../../core/movement.js';
import { VIEWS, anglesOf, orientationOf, viewDirection } from '../../core/orientation.js';
import { t } from '../../core/text.js';
import { make, setText } from '../controls/dom.js';
import { Menu } from '../controls/menu.js';

/** The anatomical letter or the axis of the side that a standard view shows, for its text. */
function sideOf(orientation, name) {
  const direction = viewDirection(orientation.frame, name);
  const axis = direction.findIndex((part) => Math.abs(part) === 1);
  return axis < 0 ? {} : { side: orientation.letter(axis, direction[axis]) };
}

class Views {
  #viewer; #orientation; #storage; #menu; #upright;
  #items = []; // [{item, show()}]
  #isUpright;

  constructor({ viewer, orientation, storage, shortcuts, toolbar }) {
    this.#viewer = viewer;
    this.#orientation = orientation;
    this.#storage = storage;
    this.#isUpright = storage.recall('upright') === 'yes';
    const standard = VIEWS.map((name, i) => this.#add({
      name, key: String(i + 1), values: () => sideOf(orientation, name), act: (time) => this.#turn(name, time),
    }));
    const project = (time) => this.#project(time);
    const flat = this.#add({ name: 'orthographic', key: 't', act: project, isOn: () => viewer.rig?.projection === 'orthographic' });
    const toggle = (time) => this.#toggleUpright(time);
    this.#upright = this.#add({ name: 'upright', key: 'u', act: toggle, isOn: () => this.#isUpright });
    shortcuts.add(VIEWS.map((name, i) => String(i + 1)), ({ key, timeStamp }) => this.#turn(VIEWS[Number(key) - 1], timeStamp), t('views.keys'));
    shortcuts.add('t', ({ timeStamp }) => project(timeStamp), t('views.orthographic'));
    shortcuts.add('u', ({ timeStamp }) => toggle(timeStamp), t('views.upright'));

    const show = () => this.#items.forEach((item) => item.show());
    this.#menu = new Menu({ id: 'views-menu', label: t('views.label'), groups: [standard, [flat, this.#upright]], show });
    const button = toolbar.button({
      id: 'views', icon: 'compass', label: t('views.label'), group: 'view', order: 10, press: () => this.#menu.toggle(button),
    });
    button.setAttribute('aria-haspopup', 'menu');
    button.setAttribute('aria-expanded', 'false');
  }

  /** Makes an item of the menu. isOn() makes it a switch. */
  #add({ name, key, act, isOn = null, values = () => ({}) }) {
    const label = make('span');
    const item = make('button', {
      role: isOn ? 'menuitemcheckbox' : 'menuitem', tabindex: -1, 'data-name': name, press: ({ timeStamp }) => act(timeStamp),
    }, label, make('kbd', { text: key.toUpperCase() }));
    const show = () => {
      setText(label, t(`views.${name}`, values()));
      if (isOn) item.setAttribute('aria-checked', String(isOn()));
    };
    this.#items.push({ item, show });
    return item;
  }

  /** Follows who may change the view. The upright camera belongs to this window. */
  show() {
    for (const { item } of this.#items) item.disabled = !this.#viewer.canControl && item !== this.#upright;
    this.#menu.show();
  }

  /** Follows the orientation of the volume. */
  orient() {
    this.#viewer.upright = this.#isUpright ? this.#orientation.frame : null;
    this.#menu.show();
  }

  #turn(name, time) {
    this.#orientation.turnTo(viewDirection(this.#orientation.frame, name), time);
  }

  #project(time) {
    const viewer = this.#viewer;
    if (!viewer.isReady) return;
    const other = viewer.rig.projection === 'orthographic' ? 'perspective' : 'orthographic';
    viewer.place(withProjection(viewer.rig, other, sphereAround(viewer.box)), time);
    viewer.emit('view', viewer.view);
  }

  #toggleUpright(time) {
    this.#isUpright = !this.#isUpright;
    this.#storage.remember('upright', this.#isUpright ? 'yes' : 'no');
    this.orient();
    if (this.#isUpright) this.#level(time);
  }

  /** Removes the roll of the camera. */
  #level(time) {
    const viewer = this.#viewer;
    if (!viewer.isReady) return;
    const { frame, glide } = this.#orientation;
    const { azimuth, elevation } = anglesOf(frame, viewer.orientation);
    glide.to({ ...viewer.rig, orientation: orientationOf(frame, { azimuth, elevation }) }, time);
  }
}

export function install(app) {
  const views = new Views(app);
  app.viewer.on('view', () => views.show());
  app.orientation.on('change', () => views.orient());
}
