// SPDX-License-Identifier: Apache-2.0
// Points of a transfer function, undo and redo, colour maps.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { MAP_NAMES, colorOfStops, simplify, stopsOf, tableOf } from '../../../clients/web/core/color_maps.js';
import { History } from '../../../clients/web/core/history.js';
import {
  OPACITY_MAX, POINTS_MAX, VALUE_MAX, addPoint, colorAt, curveOf, gradientOf, isSame, leastGap, merge, middleBeside, movePoint, opacityAt, placePoint, removePoint,
  showsValues, stretchAll, tidy, windowOf, within,
} from '../../../clients/web/core/transfer.js';
import { compare } from '../../support/compare.mjs';

const points = [
  { value: 0, opacity: 0, color: [0, 0, 0] }, { value: 100, opacity: 0.5, color: [1, 0, 0] }, { value: 200, opacity: 0.2, color: [1, 1, 1] },
];
const gap = leastGap([0, 200]);
const values = (list) => list.map((p) => p.value);

test('opacity and colour are linear between points and constant outside', () => {
  assert.deepEqual([-5, 0, 50, 100, 150, 200, 300].map((v) => opacityAt(points, v)), [0, 0, 0.25, 0.5, 0.35, 0.2, 0.2]);
  assert.deepEqual([[-9, 0], [-9, 1], [-9, 300], [300, 301]].map((range) => showsValues(points, range)), [false, true, true, true]);
  const peak = [{ value: 1, opacity: 0 }, { value: 2, opacity: 0.5 }, { value: 3, opacity: 0 }];
  assert.deepEqual([[0, 9], [3, 9]].map((range) => showsValues(peak, range)), [true, false], 'between the ends');
  assert.deepEqual([-5, 50, 150, 300].map((v) => colorAt(points, v)), [[0, 0, 0], [0.5, 0, 0], [1, 0.5, 0.5], [1, 1, 1]]);
});

test('an added point takes the colour of the curve; points never coincide', () => {
  const { points: more, index } = addPoint(points, { value: 50, opacity: 0.1 }, gap);
  assert.equal(index, 1);
  assert.deepEqual(more[1], { value: 50, opacity: 0.1, color: [0.5, 0, 0] });
  const beside = addPoint(points, { value: 100, opacity: 2 }, gap);
  assert.equal(beside.index, 2);
  assert.ok(beside.points[2].value > 100);
  assert.equal(beside.points[2].opacity, OPACITY_MAX);
  assert.deepEqual(values(addPoint(points, { value: 300, opacity: 0 }, gap).points), [0, 100, 200, 300]);
});

test('the number of points is limited', () => {
  const many = Array.from({ length: POINTS_MAX }, (_, i) => ({ value: i, opacity: 0, color: [0, 0, 0] }));
  assert.deepEqual(addPoint(many, { value: 0.5, opacity: 0 }, gap), { points: many, index: -1 });
});

test('a dragged point stops at its neighbours, a typed value passes them', () => {
  const dragged = movePoint(points, 1, { value: 500, opacity: -1 }, gap);
  compare(dragged[1].value, '<', 200);
  compare(dragged[1].value, '>', 199.9);
  assert.equal(dragged[1].opacity, 0);
  const typed = placePoint(points, 0, 150, gap);
  assert.deepEqual([values(typed.points), typed.index], [[100, 150, 200], 1]);
  assert.deepEqual(placePoint(points, 1, 120, gap).index, 1);
});

test('the last point stays', () => {
  assert.deepEqual(values(removePoint(points, 1)), [0, 200]);
  assert.equal(removePoint([points[0]], 0).length, 1);
});

test('a point without a pointer goes into the gap beside the selected one', () => {
  assert.deepEqual([0, 1, 2].map((i) => middleBeside(points, i, [0, 200])), [50, 150, 150]);
  assert.equal(middleBeside(points, 2, [0, 400]), 300);
});

test('window and level stretch every value, the colour map included', () => {
  const from = windowOf(points, [0, 255]);
  assert.deepEqual(from, { level: 100, width: 200 });
  const state = stretchAll({ points, gradient: [], map: { name: 'turbo', range: [0, 200] } }, from, { level: 60, width: 50 });
  assert.deepEqual(values(state.points), [35, 60, 85]);
  assert.deepEqual(state.map.range, [35, 85]);
});

test('the points of a colour map keep the opacity and take the colours of the map', () => {
  for (const steps of [0, 4]) {
    const stops = stopsOf({ name: 'viridis', steps });
    const all = merge(points, stops, [0, 200], gap);
    assert.deepEqual(values(all), [...values(all)].sort((a, b) => a - b));
    for (const v of [0, 13, 99, 100, 180, 200]) {
      compare(Math.abs(opacityAt(all, v) - opacityAt(points, v)), '<', 1e-3, `${steps} steps: ${v}`);
      colorAt(all, v).forEach((part, k) => compare(Math.abs(part - colorOfStops(stops, v / 200)[k]), '<', 0.02, `${steps} steps: ${v}`));
    }
  }
  const many = Array.from({ length: 250 }, (_, i) => ({ value: i, opacity: 0.1, color: [0, 0, 0] }));
  compare(merge(many, stopsOf({ name: 'turbo' }), [0, 249.5], 1e-4).length, '<=', POINTS_MAX);
});

test('colour maps: ends, reverse, steps; simplified by at most 3/255', () => {
  for (const name of MAP_NAMES) {
    const [first, last] = [tableOf(name)[0][1], tableOf(name).at(-1)[1]];
    const forward = stopsOf({ name });
    const back = stopsOf({ name, isReversed: true });
    assert.deepEqual([forward[0], forward.at(-1)], [[0, first], [1, last]], name);
    assert.deepEqual([back[0], back.at(-1)], [[0, last], [1, first]], name);
    for (let t = 0; t <= 1; t += 1 / 64) {
      const exact = colorOfStops(tableOf(name), t);
      colorOfStops(forward, t).forEach((part, k) => compare(Math.abs(part - exact[k]), '<', 0.0121, `${name} at ${t}`));
    }
    const steps = stopsOf({ name, steps: 5 });
    assert.deepEqual([0, 0.1, 0.19].map((t) => colorOfStops(steps, t)), [first, first, first], name);
    assert.deepEqual(colorOfStops(steps, 0.9), last, name);
    assert.equal(new Set(steps.map(([, color]) => String(color))).size, 5, name);
  }
  assert.equal(tableOf('viridis').length, 33);
  assert.equal(simplify([[0, [0, 0, 0]], [0.5, [0.5, 0.5, 0.5]], [1, [1, 1, 1]]]).length, 2);
});

test('rounding keeps lists equal for comparison and drops values that it makes equal', () => {
  const odd = [{ value: 1 / 3, opacity: 0.123456789, color: [1 / 3, 0, 0] }, { value: 1 / 3 + 1e-12, opacity: 1, color: [0, 0, 0] }];
  assert.equal(tidy(odd).length, 1);
  assert.ok(isSame(tidy(points), points));
  assert.ok(!isSame(points, movePoint(points, 1, { opacity: 0.51 }, gap)));
  assert.ok(!isSame(points, points.slice(1)));
});

test('values beyond all that can be subtracted meet at the limit', () => {
  const extreme = [-1.7e308, -1e305, 0, 5e-324, 1.6e308].map((value) => ({ ...points[0], value }));
  assert.deepEqual(values(within(extreme)), [-VALUE_MAX, 0, 5e-324, VALUE_MAX]);
  assert.deepEqual(values(tidy(extreme)), [-VALUE_MAX, 0, 5e-324, VALUE_MAX]);
  assert.ok(isSame(tidy(extreme), tidy(within(extreme))));
  assert.ok(Number.isFinite(windowOf(within(extreme), [0, 1]).width));
});

test('the gradient axis is a curve and back', () => {
  const gradient = [{ magnitude: 0, scale: 0 }, { magnitude: 12, scale: 1 }];
  assert.deepEqual(gradientOf(curveOf(gradient)), gradient);
  assert.deepEqual(gradientOf([{ value: -5, opacity: 0.5 }, ...curveOf(gradient)]), [{ magnitude: 0, scale: 0.5 }, gradient[1]], 'magnitudes are not negative');
  assert.deepEqual(gradientOf([{ value: -1, opacity: OPACITY_MAX }]), [{ magnitude: 0, scale: 1 }]);
});

test('undo and redo: a gesture is one step, a new change drops what was undone', () => {
  const history = new History();
  assert.equal(history.current, null);
  history.reset('a');
  assert.deepEqual([history.canUndo, history.canRedo, history.undo(), history.redo()], [false, false, null, null]);
  for (const state of ['b', 'c', 'd']) history.put(state, 'drag 1');
  history.put('e', 'drag 2');
  history.seal();
  history.put('f', 'drag 2');
  assert.deepEqual([history.undo(), history.undo(), history.undo()], ['e', 'd', 'a']);
  assert.deepEqual([history.canUndo, history.redo(), history.redo()], [false, 'd', 'e']);
  history.put('g');
  assert.deepEqual([history.canRedo, history.undo()], [false, 'e']);
  history.put('h', 'drag 2');
  assert.equal(history.undo(), 'e', 'after undo a gesture starts a new step');
});

test('undo is limited', () => {
  const history = new History();
  history.reset(0);
  for (let i = 1; i < 1000; i += 1) history.put(i);
  let count = 0;
  while (history.undo() !== null) count += 1;
  compare(count, '<', 200);
});
