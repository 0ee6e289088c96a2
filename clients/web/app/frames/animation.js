// SPDX-License-Identifier: Apache-2.0
// Animation frames of the display.

let planned = 0;

/** How many calls of nextFrame() have not run yet. */
export const plannedFrames = () => planned;

/** Runs `then` at the next animation frame, or soon in a hidden tab, which has no animation frames. */
export function nextFrame(then) {
  let isDone = false;
  planned += 1;
  const once = () => {
    if (isDone) return;
    isDone = true;
    planned -= 1;
    then();
  };
  requestAnimationFrame(once);
  setTimeout(once, 100);
}

/** Limits of the frame rate that the page asks for. A slower animation is due to a busy machine rather than to its display. */
const FPS_MIN = 60;
const FPS_MAX = 120;
const REFRESH_SAMPLES = 21;

/** Measures the refresh rate of the display in Hz, within [FPS_MIN, FPS_MAX]. In a hidden tab it resolves when the tab is visible. */
export function refreshRate() {
  return new Promise((resolve) => {
    const intervals = [];
    let before = 0;
    const next = (now) => {
      if (before) intervals.push(now - before);
      before = now;
      if (intervals.length < REFRESH_SAMPLES) requestAnimationFrame(next);
      else resolve(Math.round(Math.min(FPS_MAX, Math.max(FPS_MIN, 1000 / intervals.sort((a, b) => a - b)[REFRESH_SAMPLES >> 1]))));
    };
    requestAnimationFrame(next);
  });
}
