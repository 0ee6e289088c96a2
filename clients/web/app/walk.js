// SPDX-License-Identifier: Apache-2.0
// Walk through the volume: dragging turns the head, keys move. The mouse turns towards the pointer, a finger holds the scene.
import { sphereAround } from '../core/camera.js';
import { look, walk, withProjection } from '../core/movement.js';
import { lengthText } from '../core/lengths.js';
import { t } from '../core/text.js';
import { byId, icon, make } from './dom.js';

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

export function install(app) {
  const { viewer, modes, toolbar, orientation } = app;
  const held = new Set();
  let speed = SPEED;
  let last = null; // of a drag
  let before = 0;
  let request = 0;
  let isFast = false;

  const radius = () => sphereAround(viewer.box).radius;
  const tell = () => {
    const text = lengthText(Number((speed * radius()).toPrecision(2)), viewer.volume?.unit ?? '');
    modes.say(t('walk.speed', { speed: text }));
  };

  const advance = (now) => {
    request = 0;
    const seconds = Math.min(now - before, STEP_MAX_MS) / 1000;
    before = now;
    const sum = [0, 0, 0];
    for (const name of held) MOVES[name].forEach((part, i) => { sum[i] += part; });
    const way = speed * radius() * seconds * (isFast ? FAST : 1);
    if (sum.some(Boolean)) viewer.place(walk(viewer.rig, orientation.frame, sum.map((part) => part * way)), now);
    if (held.size > 0) request = requestAnimationFrame(advance);
  };
  const hold = (name) => {
    if (!viewer.isReady) return;
    held.add(name);
    if (request) return;
    before = performance.now() - 16;
    request = requestAnimationFrame(advance);
  };
  const stop = () => {
    held.clear();
    cancelAnimationFrame(request);
    request = 0;
  };

  const pad = createPad(hold, (name) => held.delete(name));
  const button = toolbar.button({
    id: 'walk', icon: 'footprints', label: t('walk.label'), key: 'g', group: 'view', order: 30, isToggle: true, press: () => modes.toggle(NAME),
  });
  modes.add(NAME, {
    label: t('walk.label'), hint: t('walk.hint'), cursor: 'crosshair',
    enter() {
      if (viewer.isReady && viewer.rig.projection === 'orthographic') {
        viewer.place(withProjection(viewer.rig, 'perspective', sphereAround(viewer.box)), performance.now());
      }
      pad.hidden = false;
      if (viewer.isReady) tell();
      viewer.emit('view', viewer.view);
    },
    leave() {
      stop();
      pad.hidden = true;
    },
    down(at) { last = at; },
    move(at, event) {
      if (!viewer.isReady) return;
      const perPx = viewer.rig.fovY * Math.PI / 180 / viewer.viewport.height * (event.pointerType === 'mouse' ? -MOUSE_GAIN : 1);
      const [dx, dy] = [at[0] - last[0], at[1] - last[1]];
      last = at;
      viewer.place(look(viewer.rig, orientation.frame, dx * perPx, dy * perPx), event.timeStamp);
    },
    wheel(event) {
      speed = Math.min(SPEED_RANGE[1], Math.max(SPEED_RANGE[0], speed * SPEED_STEP ** -Math.sign(event.deltaY)));
      tell();
      return true;
    },
    key(event) {
      isFast = event.shiftKey;
      const name = event.key.toLowerCase();
      if (!(name in MOVES)) return false;
      hold(name);
      return true;
    },
  });
  window.addEventListener('keyup', (event) => {
    isFast = event.shiftKey;
    held.delete(event.key.toLowerCase());
  });
  window.addEventListener('blur', stop);
  modes.on('change', (name) => button.setAttribute('aria-pressed', String(name === NAME)));
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
