// SPDX-License-Identifier: Apache-2.0
// What a hand does: a turn, a zoom or a pan, as a camera at each moment. Angles in radians, times in seconds.
export const TICK_MS = 1000 / 60; // between two updates
export const TURN = 34 * Math.PI / 180; // per second
const ZOOM = Math.log(4) / 2.5; // change of the logarithm of the distance per second
const PAN = 0.35; // of the distance: how far the target moves aside
const PAN_PERIOD = 4; // seconds of a pan to and fro

const add = (a, b, factor = 1) => a.map((x, i) => x + factor * b[i]);
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

/** The vector turned around a unit vector (Rodrigues' formula). */
const turned = (vector, axis, angle) =>
  add(add(vector.map((x) => x * Math.cos(angle)), cross(axis, vector), Math.sin(angle)), axis, dot(axis, vector) * (1 - Math.cos(angle)));

/** False in the gaps of a hand that moves with gaps: it moves at every second, third or fourth tick (33 to 67 ms). */
export const isActive = (move, tick) => move !== 'gaps' || [0, 2, 5].includes(tick % 9);

/** How far a hand is that swings between 0 and 1, one way per second, as smoothly as hands do: with the least jerk (Flash and Hogan 1985). */
function swing(time) {
  const u = time % 1;
  const part = u ** 3 * (10 - 15 * u + 6 * u * u);
  return Math.floor(time) % 2 ? 1 - part : part;
}

const turn = ({ position, target, up }, angle) => ({ position: add(target, turned(add(position, target, -1), unit(up), angle)), target, up });

export const MOVES = {
  turn: (camera, time) => turn(camera, TURN * time),
  sway: (camera, time) => turn(camera, TURN * swing(time)),
  gaps: (camera, time) => MOVES.turn(camera, time),
  zoom: ({ position, target, up }, time) => ({ position: add(target, add(position, target, -1), Math.exp(-ZOOM * time)), target, up }),
  pan: ({ position, target, up }, time) => {
    const back = add(position, target, -1);
    const right = unit(cross(up, back));
    const aside = PAN * Math.hypot(...back) * Math.tan(Math.PI / 12) * Math.sin(2 * Math.PI * time / PAN_PERIOD);
    return { position: add(position, right, aside), target: add(target, right, aside), up };
  },
};

/** Moves the pressed mouse of a page over a canvas {x, y, width, height}, or turns its wheel, for a time in seconds. isBack: zooms out. */
export async function moveInPage(page, move, { x, y, width, height }, seconds, isBack = false) {
  const [middleX, middleY] = [x + width / 2, y + height / 2];
  const side = Math.min(width, height);
  const reach = 0.3 * side; // a drag goes to and fro, so that it stays on the canvas
  // The arcball of the page turns by twice the angle between two of its points; its radius is 0.75 of the side.
  const speed = move !== 'pan' ? TURN * 0.75 * side / 2 : 2 * Math.PI * 0.1 * side / PAN_PERIOD;
  const at = (time) => {
    if (move === 'sway') return middleX + speed * (swing(time) - 0.5);
    const way = (speed * time + reach) % (4 * reach);
    return middleX + (way < 2 * reach ? way - reach : 3 * reach - way);
  };
  await page.mouse.move(move === 'zoom' ? middleX : at(0), middleY);
  if (move !== 'zoom') await page.mouse.down({ button: move === 'pan' ? 'right' : 'left' });
  const begin = performance.now();
  const events = []; // a hand does not wait for the page
  let tick = 0;
  for (let due = begin; due < begin + 1000 * seconds; due = Math.max(due + TICK_MS, performance.now())) {
    await new Promise((resolve) => { setTimeout(resolve, due - performance.now()); });
    tick += 1;
    if (isActive(move, tick)) events.push(move === 'zoom' ? page.mouse.wheel(0, (isBack ? 1 : -1) * ZOOM * TICK_MS / 1000 / 0.0015) : page.mouse.move(at((performance.now() - begin) / 1000), middleY));
  }
  await Promise.all(events);
  if (move !== 'zoom') await page.mouse.up({ button: move === 'pan' ? 'right' : 'left' });
}
