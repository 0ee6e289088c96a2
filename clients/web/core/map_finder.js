// SPDX-License-Identifier: Apache-2.0
// The colour map in the points of a view. The daemon stores the points that merge() makes, so that each participant finds the map, its range
// and the points of the opacity in them. An imported map is known to the page that imported it; others see its points.
import { MAP_NAMES, STEPS_MAX, stopsOf } from './color_maps.js';
import { isSame, merge, opacityAt, tidy } from './transfer.js';

const COLOR = 1.2e-4; // tidy() rounds to 1e-4
const OPACITY = 3e-5;
const PLACE = 5e-5; // of the range: half of the distance between two steps

const isLike = (a, b) => a.every((part, k) => Math.abs(part - b[k]) <= COLOR);

/** The shapes of all maps: [{map, stops}]. */
let shapes = null;
function allShapes() {
  shapes ??= MAP_NAMES.flatMap((name) => [false, true].flatMap((isReversed) => Array.from({ length: STEPS_MAX + 1 }, (_, steps) => ({ name, table: null, isReversed, steps }))))
    .map((map) => ({ map, stops: stopsOf(map) })).filter(({ stops }) => stops.length > 2);
  return shapes;
}

/** The range over which the points have the colours of these stops, or null. All stops are points. */
function rangeOf(points, stops) {
  const [low, high] = [stops[0][1], stops.at(-1)[1]];
  const first = points.find(({ color }, i) => isLike(color, low) && !isLike(points[i + 1]?.color ?? high, low));
  const last = points.findLast(({ color }, i) => isLike(color, high) && !isLike(points[i - 1]?.color ?? low, high));
  if (!first || !last || first.value >= last.value) return null;
  const [from] = stops.findLast(([, color]) => isLike(color, low)); // the end of the first step, if it has steps
  const [to] = stops.find(([, color]) => isLike(color, high));
  const span = (last.value - first.value) / (to - from);
  const start = first.value - from * span;
  const colors = stops.map(([t, color]) => ({ value: start + t * span, color }));
  const found = colors.map(({ value }) => points.find((point) => Math.abs(point.value - value) <= PLACE * span)?.value);
  return found.includes(undefined) ? null : [found[0], found.at(-1)];
}

/** Leaves out the points that only carry a colour: they lie at a stop, on the line between their neighbours. */
function opacityPoints(points, stops, [low, high]) {
  const isStop = ({ value }) => stops.some(([t]) => Math.abs(low + t * (high - low) - value) <= PLACE * (high - low));
  const kept = [...points];
  while (kept.length > 1 && isStop(kept[0]) && kept[0].opacity === kept[1].opacity) kept.shift();
  while (kept.length > 1 && isStop(kept.at(-1)) && kept.at(-1).opacity === kept.at(-2).opacity) kept.pop();
  for (let i = kept.length - 2; i > 0; i -= 1) {
    const rest = [kept[i - 1], kept[i + 1]];
    if (isStop(kept[i]) && Math.abs(opacityAt(rest, kept[i].value) - kept[i].opacity) <= OPACITY) kept.splice(i, 1);
  }
  return kept;
}

/** {points, map} whose merge() gives these points, as the daemon keeps them; null = they have the colours of no map. gap: leastGap(). */
export function findMap(given, gap) {
  for (const shape of allShapes()) {
    const { map, stops } = shape;
    const range = stops.length <= given.length && rangeOf(given, stops);
    if (!range) continue;
    const points = opacityPoints(given, stops, range);
    if (!isSame(tidy(merge(points, stops, range, gap)), given)) continue;
    shapes = [shape, ...shapes.filter((other) => other !== shape)]; // tried first after the next edit
    return { points, map: { ...map, range } };
  }
  return null;
}

/** The points with one colour that differs too little to be seen, so that findMap() finds no map in them. */
export const withoutMap = ([first, ...rest]) => [{ ...first, color: first.color.map((part, k) => (k ? part : part + (part > 0.5 ? -2e-4 : 2e-4))) }, ...rest];
