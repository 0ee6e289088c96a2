// SPDX-License-Identifier: Apache-2.0
// Maps mouse, touch, pen, wheel and keyboard to actions of the viewer.

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

/**
 * commands: {help(), panel(), pick([x, y] in the viewport), window} for what does not move the camera. window (window_level.js): while
 * it is on, a drag with one finger or the left button, and the arrow keys, go to it.
 */
export function attachInput(canvas, viewer, commands) {
  attachPointers(canvas, viewer, commands.window);
  attachWheel(canvas, viewer);
  let pointer = null;
  canvas.addEventListener('pointermove', (event) => { pointer = place(canvas, event); });
  attachKeys(viewer, commands, () => pointer);
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
}

function place(canvas, event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

function attachPointers(canvas, viewer, window) {
  const pointers = new Map();
  let mode = 'none';
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
  const begin = (isPan) => {
    if (mode === 'window') window.end();
    if (pointers.size >= 2) {
      mode = 'pinch';
      last = pinch();
    } else if (pointers.size === 1) {
      mode = isPan ? 'pan' : window.isOn ? 'window' : 'orbit';
      [last] = points();
      from = last;
      start = viewer.orientation;
      if (mode === 'window') window.begin();
    } else {
      mode = 'none';
    }
    canvas.dataset.mode = mode;
  };

  canvas.addEventListener('pointerdown', (event) => {
    if (event.pointerType === 'mouse' && event.button > 2) return;
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(canvas, event));
    begin(event.button === 2 || event.button === 1 || event.shiftKey);
    if (event.button === 1) event.preventDefault();
  });
  canvas.addEventListener('pointermove', (event) => {
    if (!pointers.has(event.pointerId)) return;
    const at = place(canvas, event);
    pointers.set(event.pointerId, at);
    const time = event.timeStamp;
    if (mode === 'orbit') {
      start ??= viewer.orientation;
      if (start) viewer.turn(start, from, at, time);
    } else if (mode === 'window') {
      window.drag(at[0] - from[0], at[1] - from[1], time);
    } else if (mode === 'pan') {
      viewer.pan([at[0] - last[0], at[1] - last[1]], time);
      last = at;
    } else if (mode === 'pinch') {
      const now = pinch();
      viewer.zoom(last.spread / now.spread, last.middle, time);
      viewer.pan([now.middle[0] - last.middle[0], now.middle[1] - last.middle[1]], time);
      last = now;
    }
  });
  const end = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    begin(false);
  };
  canvas.addEventListener('pointerup', (event) => {
    if (event.pointerType === 'touch' && pointers.size === 1) tap = doubleTap(tap, canvas, event, viewer);
    end(event);
  });
  canvas.addEventListener('pointercancel', end);
  canvas.addEventListener('lostpointercapture', end);
  canvas.addEventListener('dblclick', (event) => viewer.fit(event.timeStamp));
}

// touch-action: none also disables the browser's double tap, and with it dblclick in some browsers.
function doubleTap(before, canvas, event, viewer) {
  const at = place(canvas, event);
  const isSecond = before && event.timeStamp - before.time < DOUBLE_TAP_MS
    && Math.hypot(at[0] - before.at[0], at[1] - before.at[1]) < TAP_PX;
  if (isSecond) viewer.fit(event.timeStamp);
  return isSecond ? null : { at, time: event.timeStamp };
}

// A notch of the wheel is spread over several animation frames, except with reduced motion.
function attachWheel(canvas, viewer) {
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

function attachKeys(viewer, { help, panel, pick, window: windowLevel }, pointer) {
  const turns = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const middle = () => [viewer.viewport.width / 2, viewer.viewport.height / 2];
  const act = (event) => {
    const time = event.timeStamp;
    const turn = turns[event.key];
    if (turn && event.shiftKey) {
      viewer.pan([-turn[0] * KEY_PAN_PX, -turn[1] * KEY_PAN_PX], time);
    } else if (turn && windowLevel.isOn) {
      windowLevel.step(-turn[0], turn[1], time);
    } else if (turn) {
      viewer.orbit(turn[0] * KEY_TURN, turn[1] * KEY_TURN, 0, time);
    } else {
      switch (event.key) {
        case '+': case '=': viewer.zoom(1 / KEY_ZOOM, middle(), time); break;
        case '-': case '_': viewer.zoom(KEY_ZOOM, middle(), time); break;
        case ',': viewer.orbit(0, 0, KEY_TURN, time); break;
        case '.': viewer.orbit(0, 0, -KEY_TURN, time); break;
        case '0': case 'Home': viewer.reset(time); break;
        case 'f': case 'F': viewer.fit(time); break;
        case 'p': case 'P': panel(); break;
        case 'v': case 'V': pick(pointer() ?? middle()); break;
        case 'w': case 'W': windowLevel.toggle(); break;
        case '?': help(); break;
        default: return false;
      }
    }
    return true;
  };
  window.addEventListener('keydown', (event) => {
    if (event.altKey || event.ctrlKey || event.metaKey || event.defaultPrevented) return;
    if (event.target.closest?.('input, select, textarea, dialog')) return;
    if (act(event)) event.preventDefault();
  });
}
