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

/** modes: {down, move, up, cancel, hover, double}, see modes.js. */
export function attachPointers(canvas, viewer, modes) {
  const pointers = new Map();
  let gesture = 'none'; // orbit, pan, pinch, or tool: the drag belongs to the mode
  let from = null; // orbit: the start of the drag and the orientation there
  let start = null;
  let last = null; // pan: the last point; pinch: the last {middle, spread}
  let tap = null;

  const points = () => [...pointers.values()];
  const pinch = () => {
    const [a, b] = points();
    return {
      middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2],
      spread: Math.max(10, Math.hypot(a[0] - b[0], a[1] - b[1])),
    };
  };
  // A gesture restarts whenever a finger or button is added or removed.
  const begin = (event, isPan) => {
    if (gesture === 'tool') modes.cancel();
    if (pointers.size >= 2) {
      gesture = 'pinch';
      last = pinch();
    } else if (pointers.size === 1) {
      [last] = points();
      from = last;
      start = viewer.orientation;
      const isTool = event.type === 'pointerdown' && !isPan && modes.down(from, event);
      gesture = isPan ? 'pan' : isTool ? 'tool' : 'orbit';
    } else {
      gesture = 'none';
    }
    canvas.dataset.mode = gesture;
  };

  canvas.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'mouse' && event.button > 2) return;
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(canvas, event));
    begin(event, event.button === 2 || event.button === 1 || event.shiftKey);
    if (event.button === 1) event.preventDefault();
  });
  canvas.addEventListener('pointermove', (event) => {
    const at = place(canvas, event);
    if (!pointers.has(event.pointerId)) {
      modes.hover(at, event);
      return;
    }
    pointers.set(event.pointerId, at);
    const time = event.timeStamp;
    if (gesture === 'orbit') {
      start ??= viewer.orientation;
      if (start) viewer.turn(start, from, at, time);
    } else if (gesture === 'tool') {
      modes.move(at, event);
    } else if (gesture === 'pan') {
      viewer.pan([at[0] - last[0], at[1] - last[1]], time);
      last = at;
    } else if (gesture === 'pinch') {
      const now = pinch();
      viewer.zoom(last.spread / now.spread, last.middle, time);
      viewer.pan([now.middle[0] - last.middle[0], now.middle[1] - last.middle[1]], time);
      last = now;
    }
  });
  const end = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    if (gesture === 'tool' && event.type === 'pointerup') modes.up(place(canvas, event), event);
    begin(event, false);
  };
  canvas.addEventListener('pointerup', (event) => {
    if (event.pointerType === 'touch' && pointers.size === 1) tap = doubleTap(tap, canvas, event, viewer, modes);
    end(event);
  });
  canvas.addEventListener('pointercancel', end);
  canvas.addEventListener('lostpointercapture', end);
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
