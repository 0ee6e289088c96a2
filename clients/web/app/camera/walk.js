// SPDX-License-Identifier: Apache-2.0
// Walk through the volume: dragging turns the head, keys move. The mouse turns towards the pointer, a finger holds the scene.
import { sphereAround } from '../../core/camera.js';
import { look, walk, withProjection } from '../../core/movement.js';
import { lengthText } from '../../core/lengths.js';
import { t } from '../../core/text.js';
import { byId, icon, make } from '../controls/dom.js';

const NAME = 'walk';
/** Directions [right, up, ahead] of the keys. */
const MOVES = {
  w: [0, 0, 1], arrowup: [0, 0, 1], s: [0, 0, -1], arrowdown: [0, 0, -1], a: [-1, 0, 0], arrowleft: [-1, 0, 0], d: [1, 0, 0],
  arrowright: [1, 0, 0], e: [0, 1, 0], q: [0, -1, 0],
};
const SPEED = 0.35; // radii of the volume per second
const SPEED_RANGE = [0.01, 10];
const SPEED_STEP = 1.25; // per notch of the wheel
const FAST = 3; // with Shift
const MOUSE_GAIN = 1.5;
const STEP_MAX_MS = 100; // after a pause

class Walk {
  #viewer; #modes; #orientation; #pad;
  #held = new Set(); // the keys of MOVES that are down
  #speed = SPEED;
  #isFast = false;
  #last = null; // the last point of the drag
  #before = 0; // the time of the last step, in ms
  #request = 0; // the animation frame of the next step

  constructor({ viewer, modes, orientation }) {
    this.#viewer = viewer;
    this.#modes = modes;
    this.#orientation = orientation;
    this.#pad = createPad((name) => this.#hold(name), (name) => this.release(name));
  }

  /** The mode, see modes.js. */
  get mode() {
    return {
      label: t('walk.label'), hint: t(window.matchMedia('(pointer: coarse)').matches ? 'walk.hint.touch' : 'walk.hint'), cursor: 'crosshair',
      enter: () => this.#enter(),
      leave: () => this.#leave(),
      down: (at) => { this.#last = at; },
      move: (at, event) => this.#look(at, event),
      wheel: (event) => this.#changeSpeed(-Math.sign(event.deltaY)),
      key: (event) => this.#press(event),
    };
  }

  #enter() {
    const viewer = this.#viewer;
    if (viewer.isReady && viewer.rig.projection === 'orthographic') {
      viewer.place(withProjection(viewer.rig, 'perspective', sphereAround(viewer.box)), performance.now());
    }
    this.#pad.hidden = false;
    if (viewer.isReady) this.#tellSpeed();
    viewer.emit('view', viewer.view);
  }

  #leave() {
    this.stop();
    this.#pad.hidden = true;
  }

  /** Turns the head. */
  #look(at, { pointerType, timeStamp }) {
    const viewer = this.#viewer;
    if (!viewer.isReady) return;
    const perPx = viewer.rig.fovY * Math.PI / 180 / viewer.viewport.height * (pointerType === 'mouse' ? -MOUSE_GAIN : 1);
    const [dx, dy] = [at[0] - this.#last[0], at[1] - this.#last[1]];
    this.#last = at;
    viewer.place(look(viewer.rig, this.#orientation.frame, dx * perPx, dy * perPx), timeStamp);
  }

  #changeSpeed(steps) {
    this.#speed = Math.min(SPEED_RANGE[1], Math.max(SPEED_RANGE[0], this.#speed * SPEED_STEP ** steps));
    this.#tellSpeed();
    return true;
  }

  get #radius() { return sphereAround(this.#viewer.box).radius; }

  #tellSpeed() {
    const speed = lengthText(Number((this.#speed * this.#radius).toPrecision(2)), this.#viewer.volume?.unit ?? '');
    this.#modes.say(t('walk.speed', { speed }));
  }

  // Keys that are held.

  #press(event) {
    this.#isFast = event.shiftKey;
    const name = event.key.toLowerCase();
    if (!(name in MOVES)) return false;
    this.#hold(name);
    return true;
  }

  #hold(name) {
    if (!this.#viewer.isReady) return;
    this.#held.add(name);
    if (this.#request) return;
    this.#before = performance.now() - 16;
    this.#request = requestAnimationFrame((now) => this.#advance(now));
  }

  release(name, isFast = this.#isFast) {
    this.#isFast = isFast;
    this.#held.delete(name);
  }

  stop() {
    this.#held.clear();
    cancelAnimationFrame(this.#request);
    this.#request = 0;
  }

  #advance(now) {
    const viewer = this.#viewer;
    this.#request = 0;
    const seconds = Math.min(now - this.#before, STEP_MAX_MS) / 1000;
    this.#before = now;
    const sum = [0, 0, 0];
    for (const name of this.#held) MOVES[name].forEach((part, i) => { sum[i] += part; });
    const way = this.#speed * this.#radius * seconds * (this.#isFast ? FAST : 1);
    if (sum.some(Boolean)) viewer.place(walk(viewer.rig, this.#orientation.frame, sum.map((part) => part * way)), now);
    if (this.#held.size > 0) this.#request = requestAnimationFrame((next) => this.#advance(next));
  }
}

export function install(app) {
  const { modes, toolbar } = app;
  const walking = new Walk(app);
  const button = toolbar.button({
    id: 'walk', icon: 'footprints', label: t('walk.label'), key: 'g', group: 'view', order: 30, isToggle: true, press: () => modes.toggle(NAME),
  });
  modes.add(NAME, walking.mode);
  modes.on('change', (name) => button.setAttribute('aria-pressed', String(name === NAME)));
  window.addEventListener('keyup', ({ key, shiftKey }) => walking.release(key.toLowerCase(), shiftKey));
  window.addEventListener('blur', () => walking.stop());
}

/** Two buttons for fingers; they are held. */
function createPad(hold, release) {
  const button = (name, sign, label) => {
    const made = make('button', { 'aria-label': label, title: label }, sign);
    made.addEventListener('pointerdown', (event) => {
      made.setPointerCapture(event.pointerId);
      hold(name);
    });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) made.addEventListener(end, () => release(name));
    made.addEventListener('contextmenu', (event) => event.preventDefault());
    return made;
  };
  const pad = make('div', { id: 'walk-pad', role: 'group', 'aria-label': t('walk.label'), hidden: true },
    button('w', icon('arrow-up'), t('walk.ahead')), button('s', icon('arrow-down'), t('walk.back')));
  byId('pane-3d').append(pad);
  return pad;
}
