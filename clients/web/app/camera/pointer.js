// SPDX-License-Identifier: Apache-2.0
// Maps mouse, touch, pen, wheel and keys to actions of the viewer, or gives a drag to the mode that owns the pointer (modes.js). The page
// and the element <splat-view> use it.

const KEY_TURN = 4 * Math.PI / 180;
const KEY_PAN_PX = 24;
const KEY_ZOOM = 1.12;
const WHEEL_STEP = 0.0015; // change of the logarithm of the distance per px of wheel
const PINCH_STEP = 0.01; // the same for a trackpad's pinch, which arrives as a wheel event with ctrl
const LINE_PX = 32;
const PAGE_PX = 400;
const GLIDE_MS = 70;
const DOUBLE_TAP_MS = 300;
const TAP_PX = 12;

/** The place of a pointer event in CSS px of an element. */
export function place(canvas, event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

/** A drag or pinch with the pointers that are down. It starts again whenever a finger or button is added or removed. */
class Gesture {
  #canvas; #viewer; #modes;
  #pointers = new Map(); // id → place
  #kind = 'none'; // orbit, pan, pinch, or tool: the drag belongs to the mode
  #from = null; // orbit: where the drag began
  #start = null; // orbit: the orientation there
  #last = null; // pan: the last point; pinch: the last {middle, spread}

  constructor(canvas, viewer, modes) {
    this.#canvas = canvas;
    this.#viewer = viewer;
    this.#modes = modes;
  }

  get count() { return this.#pointers.size; }

  down(event) {
    this.#pointers.set(event.pointerId, place(this.#canvas, event));
    this.#begin(event, event.button === 2 || event.button === 1 || event.shiftKey);
  }

  move(event) {
    const at = place(this.#canvas, event);
    if (!this.#pointers.has(event.pointerId)) {
      this.#modes.hover(at, event);
      return;
    }
    this.#pointers.set(event.pointerId, at);
    switch (this.#kind) {
      case 'orbit': this.#orbit(at, event.timeStamp); break;
      case 'tool': this.#modes.move(at, event); break;
      case 'pan': this.#pan(at, event.timeStamp); break;
      case 'pinch': this.#pinch(event.timeStamp); break;
      default:
    }
  }

  end(event) {
    if (!this.#pointers.delete(event.pointerId)) return;
    if (this.#kind === 'tool' && event.type === 'pointerup') this.#modes.up(place(this.#canvas, event), event);
    this.#begin(event, false);
  }

  #begin(event, isPan) {
    if (this.#kind === 'tool') this.#modes.cancel();
    if (this.count >= 2) {
      this.#kind = 'pinch';
      this.#last = this.#fingers;
    } else if (this.count === 1) {
      [this.#from] = this.#pointers.values();
      this.#last = this.#from;
      this.#start = this.#viewer.orientation;
      const isTool = event.type === 'pointerdown' && !isPan && this.#modes.down(this.#from, event);
      this.#kind = isPan ? 'pan' : isTool ? 'tool' : 'orbit';
    } else {
      this.#kind = 'none';
    }
    this.#canvas.dataset.mode = this.#kind;
  }

  /** {middle, spread} of the first two pointers. */
  get #fingers() {
    const [a, b] = this.#pointers.values();
    return { middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], spread: Math.max(10, Math.hypot(a[0] - b[0], a[1] - b[1])) };
  }

  #orbit(at, time) {
    this.#start ??= this.#viewer.orientation;
    if (this.#start) this.#viewer.turn(this.#start, this.#from, at, time);
  }

  #pan(at, time) {
    this.#viewer.pan([at[0] - this.#last[0], at[1] - this.#last[1]], time);
    this.#last = at;
  }

  #pinch(time) {
    const last = this.#last;
    const now = this.#fingers;
    this.#viewer.zoom(last.spread / now.spread, last.middle, time);
    this.#viewer.pan([now.middle[0] - last.middle[0], now.middle[1] - last.middle[1]], time);
    this.#last = now;
  }
}

/** modes: {down, move, up, cancel, hover, double}, see modes.js. */
export function attachPointers(canvas, viewer, modes) {
  const gesture = new Gesture(canvas, viewer, modes);
  let tap = null;
  canvas.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'mouse' && event.button > 2) return;
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    gesture.down(event);
    if (event.button === 1) event.preventDefault();
  });
  canvas.addEventListener('pointermove', (event) => gesture.move(event));
  canvas.addEventListener('pointerup', (event) => {
    if (event.pointerType === 'touch' && gesture.count === 1) tap = doubleTap(tap, canvas, event, viewer, modes);
    gesture.end(event);
  });
  canvas.addEventListener('pointercancel', (event) => gesture.end(event));
  canvas.addEventListener('lostpointercapture', (event) => gesture.end(event));
  canvas.addEventListener('dblclick', (event) => {
    if (!modes.double(place(canvas, event), event)) viewer.fit(event.timeStamp);
  });
}

// touch-action: none also disables the browser's double tap, and with it dblclick in some browsers.
function doubleTap(before, canvas, event, viewer, modes) {
  const at = place(canvas, event);
  const isSecond = before && event.timeStamp - before.time < DOUBLE_TAP_MS
    && Math.hypot(at[0] - before.at[0], at[1] - before.at[1]) < TAP_PX;
  if (isSecond && !modes.double(at, event)) viewer.fit(event.timeStamp);
  return isSecond ? null : { at, time: event.timeStamp };
}

// A notch of the wheel is spread over several animation frames, except with reduced motion.
export function attachWheel(canvas, viewer, modes) {
  const reduced = window.matchMedia('(prefers-reduced-motion: reduce)');
  let rest = 0;
  let at = [0, 0];
  let time = 0;
  let before = 0;
  const glide = (now) => {
    const part = reduced.matches || Math.abs(rest) < 0.002 ? 1 : 1 - Math.exp(-Math.min(now - before, 50) / GLIDE_MS);
    before = now;
    viewer.zoom(Math.exp(rest * part), at, time);
    rest *= 1 - part;
    time = now;
    if (rest !== 0) requestAnimationFrame(glide);
  };
  canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    if (modes.wheel(event)) return;
    const unit = [1, LINE_PX, PAGE_PX][event.deltaMode] ?? 1;
    const step = event.deltaY * unit * (event.ctrlKey ? PINCH_STEP : WHEEL_STEP);
    const isResting = rest === 0;
    rest = Math.min(Math.max(rest + step, -3), 3);
    at = place(canvas, event);
    if (!isResting || rest === 0) return;
    time = event.timeStamp;
    before = performance.now() - 16;
    requestAnimationFrame(glide);
  }, { passive: false });
}

/**
 * The keys that move the camera: [keys, act(event)].
 * @returns {[string[], (event: KeyboardEvent) => void][]}
 */
export function cameraKeys(viewer) {
  const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const middle = () => [viewer.viewport.width / 2, viewer.viewport.height / 2];
  /** @type {(of: any) => [string[], (event: KeyboardEvent) => void]} */
  const arrow = ([key, [x, y]]) => [[key], ({ shiftKey, timeStamp }) => {
    if (shiftKey) viewer.pan([-x * KEY_PAN_PX, -y * KEY_PAN_PX], timeStamp);
    else viewer.orbit(x * KEY_TURN, y * KEY_TURN, 0, timeStamp);
  }];
  return [...Object.entries(turns).map(arrow),
    [['+', '='], ({ timeStamp }) => viewer.zoom(1 / KEY_ZOOM, middle(), timeStamp)],
    [['-', '_'], ({ timeStamp }) => viewer.zoom(KEY_ZOOM, middle(), timeStamp)],
    [[','], ({ timeStamp }) => viewer.orbit(0, 0, KEY_TURN, timeStamp)],
    [['.'], ({ timeStamp }) => viewer.orbit(0, 0, -KEY_TURN, timeStamp)],
    [['0', 'Home'], ({ timeStamp }) => { viewer.reset(timeStamp); }],
    [['f'], ({ timeStamp }) => viewer.fit(timeStamp)],
  ];
}
