// SPDX-License-Identifier: Apache-2.0
// Measurements: the list, undo, and where lines, handles and labels lie.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  Changes, MeasureList, centerOf, handlesOf, labelBeside, linesOf, moveHandle, placeIn, pointsFromCorners, quickValue, shortNumber, ticks,
  unitOf, valueText,
} from '../../../clients/web/core/measures.js';

const PLANE = { origin: [0, 0, 5], right: [1, 0, 0], down: [0, 1, 0], normal: [0, 0, 1] };
const item = (id, more = {}) => ({ id, kind: 'marker', volume: 'v', points: [[0, 0, 0]], ...more });
const near = (a, b, slack = 1e-12) => a.forEach((part, i) => assert.ok(Math.abs(part - b[i]) <= slack, `${a} is not ${b}`));

test('the list follows the notifications, except for what this client changes', () => {
  const list = new MeasureList();
  list.take({ ids: ['a', 'b'], changed: [item('a'), item('b')] });
  assert.deepEqual(list.all.map((m) => m.id), ['a', 'b']);
  list.take({ ids: ['b', 'c'], changed: [item('c', { volume: 'w' }), item('b', { text: 'new' })] });
  assert.deepEqual(list.all.map((m) => [m.id, m.text]), [['b', 'new'], ['c', undefined]]);
  assert.deepEqual(list.of('w').map((m) => m.id), ['c']);
  list.put(item('mine'));
  list.put(item('b', { text: 'mine' }));
  list.take({ ids: ['b', 'c'], changed: [item('b', { text: 'theirs' })] }, (id) => id === 'mine' || id === 'b');
  assert.equal(list.get('b').text, 'mine');
  assert.ok(list.get('mine'), 'an item that the daemon does not know yet stays');
});

test('undo returns to the state before, redo to the one after; a new change drops what was undone', () => {
  const changes = new Changes();
  assert.equal(changes.undo(), null);
  changes.put({ id: 'a', before: null, after: 1 });
  changes.put({ id: 'a', before: 1, after: 2 });
  assert.deepEqual(changes.undo(), { id: 'a', item: 1 });
  assert.deepEqual(changes.undo(), { id: 'a', item: null });
  assert.deepEqual([changes.canUndo, changes.canRedo], [false, true]);
  assert.deepEqual(changes.redo(), { id: 'a', item: 1 });
  changes.put({ id: 'a', before: 1, after: 3 });
  assert.equal(changes.canRedo, false);
});

test('two corners make a rectangle or an ellipse in the plane', () => {
  assert.deepEqual(pointsFromCorners('rectangle', [1, 1, 5], [4, 3, 5], PLANE), [[1, 1, 5], [4, 1, 5], [1, 3, 5]]);
  assert.deepEqual(pointsFromCorners('ellipse', [1, 1, 5], [5, 3, 5], PLANE), [[3, 2, 5], [5, 2, 5], [3, 3, 5]]);
  assert.equal(pointsFromCorners('rectangle', [1, 1, 5], [1, 3, 5], PLANE), null);
});

test('each corner of a rectangle moves, and the opposite one stays', () => {
  const rectangle = { kind: 'rectangle', points: [[0, 0, 5], [4, 0, 5], [0, 2, 5]] };
  for (const handle of [0, 1, 2, 3]) {
    const before = handlesOf(rectangle);
    const to = [[-1, -1, 5], [6, -1, 5], [6, 3, 5], [-1, 3, 5]][handle];
    const after = handlesOf({ kind: 'rectangle', points: moveHandle(rectangle, handle, to) });
    near(after[handle], to);
    near(after[(handle + 2) % 4], before[(handle + 2) % 4]);
  }
  assert.equal(moveHandle(rectangle, 0, [4, 1, 5]), null, 'no area');
});

test('the ends of an ellipse change its axes, its centre moves it', () => {
  const ellipse = { kind: 'ellipse', points: [[0, 0, 5], [4, 0, 5], [0, 2, 5]] };
  assert.deepEqual(handlesOf(ellipse)[3], [-4, 0, 5]);
  near(moveHandle(ellipse, 1, [6, 1, 5])[1], [6, 0, 5]);
  near(moveHandle(ellipse, 3, [-7, 1, 5])[1], [7, 0, 5]);
  near(moveHandle(ellipse, 4, [0, -3, 5])[2], [0, 3, 5]);
  near(moveHandle(ellipse, 0, [1, 1, 5])[1], [5, 1, 5]);
  const [outline] = linesOf(ellipse);
  for (const [x, y] of outline) assert.ok(Math.abs((x / 4) ** 2 + (y / 2) ** 2 - 1) < 1e-12);
});

test('values of lines and angles are known at once', () => {
  assert.equal(quickValue({ kind: 'distance', points: [[1, 2, 3], [4, 6, 15]] }), 13);
  assert.equal(quickValue({ kind: 'angle', points: [[1, 0, 0], [0, 0, 0], [0, 2, 0]] }), 90);
  assert.equal(quickValue({ kind: 'angle', points: [[1, 0, 0], [0, 0, 0]] }), null);
  assert.equal(quickValue({ kind: 'rectangle', points: [] }), null);
  const arc = linesOf({ kind: 'angle', points: [[3, 0, 0], [0, 0, 0], [0, 6, 0]] })[1];
  near(arc[0], [1, 0, 0]);
  near(arc.at(-1), [0, 1, 0]);
});

test('a measurement lies in a plane, across it, or apart', () => {
  const line = (z0, z1) => ({ kind: 'distance', points: [[0, 0, z0], [9, 0, z1]] });
  assert.equal(placeIn(line(5, 5.4), PLANE, 0.5), 'in');
  assert.equal(placeIn(line(2, 9), PLANE, 0.5), 'across');
  assert.equal(placeIn(line(6, 9), PLANE, 0.5), 'apart');
  near(centerOf({ kind: 'rectangle', points: [[0, 0, 5], [4, 0, 5], [0, 2, 5]] }), [2, 1, 5]);
});

test('values have units as people write them', () => {
  assert.equal(valueText({ value: 12.34567, unit: 'mm' }), '12.35 mm');
  assert.equal(valueText({ value: 8, unit: 'mm^2' }), '8 mm²');
  assert.deepEqual(['um', 'um^2', 'um^3'].map((unit) => valueText({ value: 8, unit })), ['8 µm', '8 µm²', '8 µm³']);
  assert.equal(valueText({ value: 89.999999, unit: 'deg' }), '90°');
  assert.equal(valueText({ value: 5, unit: '' }), '5');
  assert.equal(valueText({ value: null, unit: '' }, 'none'), 'none');
  assert.equal(shortNumber(0), '0');
  assert.equal(shortNumber(1.23456e-9), '1.235e-9');
});

test('a label does not touch its line, whatever the direction', () => {
  for (let degrees = 0; degrees < 360; degrees += 15) {
    const [dx, dy] = [Math.cos(degrees * Math.PI / 180) * 100, Math.sin(degrees * Math.PI / 180) * 100];
    const [a, b] = [{ x: 200, y: 200 }, { x: 200 + dx, y: 200 + dy }];
    const at = labelBeside(a, b, 60, 16, 6);
    const corners = [[-30, -8], [30, -8], [30, 8], [-30, 8]].map(([x, y]) => [at.x + x, at.y + y]);
    const sides = corners.map(([x, y]) => ((x - a.x) * dy - (y - a.y) * dx) / 100);
    assert.ok(Math.max(...sides) < -5.9 || Math.min(...sides) > 5.9, `${degrees}°: ${sides}`);
  }
});

test('ticks are round and lie in the range', () => {
  assert.deepEqual(ticks(0, 10, 4), [0, 5, 10]);
  assert.deepEqual(ticks(-0.31, 0.92, 3), [0, 0.5]);
  assert.deepEqual(ticks(1000, 1400, 4), [1000, 1100, 1200, 1300, 1400]);
  assert.deepEqual(ticks(7, 7, 4), [7]);
});

test('the unit of a value follows from its kind', () => {
  assert.deepEqual(['distance', 'profile', 'rectangle', 'ellipse', 'angle', 'marker'].map((kind) => unitOf(kind, { unit: 'mm', fields: [{ unit: 'HU' }] })), ['mm', 'mm', 'mm^2', 'mm^2', 'deg', 'HU']);
  assert.deepEqual(['distance', 'rectangle', 'angle', 'marker'].map((kind) => unitOf(kind, { unit: '' })), ['', '', 'deg', '']);
});
