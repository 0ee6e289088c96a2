// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { volumeBox } from '../../../clients/web/core/camera.js';
import {
  WHOLE, alongAxis, anchorOf, axisOf, axisPlane, boxEdges, boxMiddle, depthOf, dragAlong, dragFace, faceCoordinate, faceMiddle, flipPlane, fractionAt,
  moveBox, moveFace, planeAt, planeFrom, planesOn, positionOf, reach, reconcile, section, shiftPlane, sight, tiltPlane,
} from '../../../clients/web/core/clip.js';
import { IDENTITY, add, dot, length, rotate, scale, subtract } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

test('a face moves alone until it meets the opposite face, which it then pushes', () => {
  const box = moveFace(WHOLE, 0, 1, 0.3);
  assert.deepEqual(box, [[0, 0.3, 0], [1, 1, 1]]);
  assert.deepEqual(WHOLE, [[0, 0, 0], [1, 1, 1]], 'the argument is not modified');
  assert.deepEqual(moveFace(box, 1, 1, 0.2), [[0, 0.2, 0], [1, 0.2, 1]]);
  assert.deepEqual(moveFace(moveFace(box, 1, 2, 0.5), 0, 2, 0.75), [[0, 0.3, 0.75], [1, 1, 0.75]]);
});

test('the extent of a box along a normal is that of its corners', () => {
  const next = random(3);
  for (let round = 0; round < 50; round += 1) {
    const q = unitQuaternion(next);
    const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => rotate(q, axis));
    const direction = [0, 1, 2].map((row) => columns.map((column) => column[row]));
    const volume = { dims: [4, 7, 3], spacing: [1, 0.5, 3], origin: [next() * 9, next() * 9, next() * 9], direction };
    const normal = [next() * 5, next(), next() * 1e-3];
    const ends = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => {
      const steps = volume.dims.map((n, i) => ((corner >> i) & 1 ? n - 0.5 : -0.5) * volume.spacing[i]);
      return dot(normal, steps.reduce((p, step, i) => add(p, scale(columns[i], step)), volume.origin));
    });
    close(reach(volumeBox(volume), normal), [Math.min(...ends), Math.max(...ends)], 1e-9);
  }
});

test('a rectilinear volume ends half a sample distance beyond its samples', () => {
  const volume = { dims: [4, 3, 2], spacing: [2, 1, 5], origin: [10, 0, 0], coordinates: [[0, 1, 2, 6], null, [0, 5]] };
  const box = volumeBox(volume);
  close(reach(box, [1, 0, 0]), [9.5, 18]);
  close(reach(box, [0, 1, 0]), [-0.5, 2.5]);
  close(reach(box, [0, 0, 1]), [-2.5, 7.5]);
});

test('the depth of a plane is the fraction of the volume that it cuts away, for any length of the normal', () => {
  const box = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0.5, 0.5, 1] });
  assert.deepEqual(planeAt(box, [0, 0, 1], 0.25), { normal: [0, 0, 1], offset: 15 });
  assert.deepEqual(planeAt(box, [0, 0, -10], 0.25), { normal: [0, 0, -10], offset: -450 });
  assert.equal(planeAt(box, [0, 1, 0], 0).offset, 0, 'nothing is cut');
  assert.equal(planeAt(box, [0, 1, 0], 1).offset, 20, 'everything is cut');
  for (const depth of [0, 0.3, 1]) {
    const plane = planeAt(box, [1, -2, 0.5], depth);
    compare(Math.abs(depthOf(box, plane) - depth), '<', 1e-12);
    const doubled = { normal: scale(plane.normal, 2), offset: plane.offset * 2 };
    compare(Math.abs(depthOf(box, doubled) - depth), '<', 1e-12);
  }
  assert.equal(depthOf(box, { normal: [0, 0, 1], offset: -1e308 }), 0);
  assert.equal(depthOf(box, { normal: [0, 0, 1], offset: 1e308 }), 1);
  assert.equal(depthOf(box, { normal: [0, 0, 0], offset: 0 }), 0);
});

test('a plane towards the viewer cuts the nearest part; more depth cuts farther', () => {
  const camera = { position: [5, 10, 130], target: [5, 10, 30] };
  const normal = sight(camera);
  assert.deepEqual(normal.map((x) => x + 0), [0, 0, -1]);
  const box = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0.5, 0.5, 1] });
  const { offset } = planeAt(box, normal, 0.25);
  compare(dot(normal, [5, 10, 59]), '<', offset, 'the side of the viewer is cut');
  compare(dot(normal, [5, 10, 1]), '>', offset, 'the far side is not cut');
  assert.throws(() => sight({ position: [1, 1, 1], target: [1, 1, 1] }), RangeError);
});

const BOX = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0.5, 0.5, 1] }); // from the origin to [10, 20, 60]

test('a dragged face stops at the opposite one and at the end of the volume', () => {
  const box = [[0.2, 0, 0], [0.6, 1, 1]];
  assert.deepEqual(dragFace(box, 0, 0, 0.9), [[0.6, 0, 0], [0.6, 1, 1]]);
  assert.deepEqual(dragFace(box, 1, 0, 0.1), [[0.2, 0, 0], [0.2, 1, 1]]);
  assert.deepEqual(dragFace(box, 1, 0, 7), [[0.2, 0, 0], [1, 1, 1]]);
  assert.deepEqual(faceMiddle(BOX, box, 1, 0), [6, 10, 30]);
});

test('a box moves as a whole, as far as the volume reaches, also in a sheared volume', () => {
  const sheared = { center: [5, 6, 7], half: [[10, 0, 0], [5, 20, 0], [0, 3, 4]] };
  const box = [[0.25, 0.25, 0.25], [0.5, 0.75, 0.75]];
  close(boxMiddle(sheared, box), [5 - 2.5, 6, 7]);
  const way = [3, -4, 1];
  const moved = moveBox(sheared, box, way);
  close(subtract(boxMiddle(sheared, moved), boxMiddle(sheared, box)), way);
  close(subtract(moved[1], moved[0]), subtract(box[1], box[0]));
  close(moveBox(sheared, box, [1000, 0, 0]).flat(), [0.75, 0.25, 0.25, 1, 0.75, 0.75], 1e-9, 'it stops at the end');
});

test('the box has 12 edges; those beside two faces that are turned away are hidden', () => {
  const edges = boxEdges(BOX, WHOLE, { position: [100, 200, 300], back: [0, 0, 1], isFlat: false });
  assert.equal(edges.length, 12);
  assert.equal(edges.filter(({ isHidden }) => isHidden).length, 3);
  for (const { from, to } of edges.filter(({ isHidden }) => isHidden)) {
    const isAtOrigin = [from, to].some((p) => length(p) < 1e-9); // the corner farthest from the eye
    assert.ok(isAtOrigin, `${from} ${to}`);
  }
  const straight = boxEdges(BOX, WHOLE, { position: [5, 10, 300], back: [0, 0, 1], isFlat: true });
  assert.equal(straight.filter(({ isHidden }) => isHidden).length, 8, 'a flat picture from the front shows one face');
  const total = edges.reduce((sum, { from, to }) => sum + length(subtract(to, from)), 0);
  compare(Math.abs(total - 4 * 90), '<', 1e-9);
});

test('a plane cuts the volume in a polygon in order', () => {
  const square = section(BOX, { normal: [0, 0, 2], offset: 40 });
  assert.equal(square.length, 4);
  const around = square.reduce((sum, p, i) => sum + length(subtract(p, square[(i + 1) % 4])), 0);
  compare(Math.abs(around - 60), '<', 1e-9, 'the sides of the polygon are those of the box');
  assert.equal(section(BOX, { normal: [6, 3, 1], offset: 90 }).length, 6, 'a hexagon through the centre');
  assert.deepEqual(section(BOX, { normal: [0, 0, 1], offset: 99 }), []);
});

test('every plane is held at a point of its own on it', () => {
  const planes = [0, 1, 2].map((axis) => axisPlane(BOX, axis));
  const anchors = planes.map((plane, i) => anchorOf(BOX, plane, i));
  planes.forEach((plane, i) => compare(Math.abs(dot(plane.normal, anchors[i]) - plane.offset), '<', 1e-9));
  for (const [i, j] of [[0, 1], [0, 2], [1, 2]]) compare(length(subtract(anchors[i], anchors[j])), '>', 3);
  close(anchorOf(BOX, { normal: [0, 0, 2], offset: 400 }, 0), [6.8, 13.6, 200], 1e-9);
});

test('a drag along an axis follows the pointer, also in perspective', () => {
  const eye = [50, -80, 40];
  const axis = [0, 0, 3];
  const rayTo = (p) => ({ origin: eye, direction: subtract(p, eye) });
  const moved = dragAlong([5, 10, 10], axis, rayTo([5, 10, 10]), rayTo([5, 10, 31]), 0, 1);
  compare(Math.abs(moved - 7), '<', 1e-9);
  assert.equal(alongAxis([0, 0, 0], axis, { origin: [0, 0, 100], direction: [0, 0.01, -1] }), null, 'straight at the viewer');
  const ray = { origin: [0, 0, 100], direction: [0, 0, -1] };
  compare(Math.abs(dragAlong([0, 0, 0], axis, ray, ray, 12, 0.5) + 2), '<', 1e-9, 'upwards is away from the viewer');
});

test('a plane is shifted in world units, turned about its anchor, and flipped', () => {
  const plane = { normal: [0, 0, 2], offset: 40 };
  assert.equal(positionOf(plane), 20);
  assert.equal(positionOf(shiftPlane(plane, 5)), 25);
  const anchor = [5, 10, 20];
  const tilted = tiltPlane(plane, anchor, IDENTITY, [90, 0]);
  compare(Math.abs(dot(tilted.normal, anchor) - tilted.offset), '<', 1e-9);
  close([length(tilted.normal)], [2]);
  // The camera looks along -z with x to the right: the side that faces it goes with the pointer to the right.
  close(tilted.normal, [2 * Math.SQRT1_2, 0, 2 * Math.SQRT1_2], 1e-9);
  close(tiltPlane(plane, anchor, IDENTITY, [0, 90]).normal, [0, -2 * Math.SQRT1_2, 2 * Math.SQRT1_2], 1e-9);
  assert.equal(tiltPlane(plane, anchor, IDENTITY, [0, 0]), plane);
  assert.deepEqual(flipPlane(plane), { normal: [0, 0, -2], offset: -40 });
  assert.deepEqual(planeFrom([0, 3, 4], 7), { normal: [0, 0.6000000000000001, 0.8], offset: 7 });
  assert.equal(planeFrom([0, 0, 0], 7), null);
  assert.equal(planeFrom([0, 0, 1], NaN), null);
});

test('the list of planes keeps those that are off when the view changes', () => {
  const [a, b, c, d] = [0, 1, 2, 3].map((offset) => ({ normal: [0, 0, 1], offset }));
  const entries = [{ plane: a, isOn: true }, { plane: b, isOn: false }, { plane: c, isOn: true }];
  assert.deepEqual(planesOn(entries), [a, c]);
  assert.deepEqual(reconcile(entries, [a, c]), entries);
  assert.deepEqual(reconcile(entries, [d]), [{ plane: d, isOn: true }, { plane: b, isOn: false }]);
  assert.deepEqual(reconcile(entries, [a, c, d]).at(-1), { plane: d, isOn: true });
  assert.equal(reconcile(entries, Array(8).fill(d)).length, 8);
});

test('faces have coordinates of the world where the volume follows its axes', () => {
  const flipped = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [100, 0.5, 1], direction: [[-1, 0, 0], [0, 1, 0], [0, 0, 1]] });
  assert.deepEqual(axisOf(flipped, 0), { world: 0, sign: -1, isExact: true });
  close([faceCoordinate(flipped, 0, 0), faceCoordinate(flipped, 0, 1), fractionAt(flipped, 0, 98)], [100.5, 90.5, 0.25], 1e-9);
  close([faceCoordinate(BOX, 2, 0.5), fractionAt(BOX, 2, 90)], [30, 1]);
  const c = Math.SQRT1_2;
  const oblique = volumeBox({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [7, 8, 9], direction: [[c, -c, 0], [c, c, 0], [0, 0, 1]] });
  assert.equal(axisOf(oblique, 0).isExact, false);
  close([faceCoordinate(oblique, 0, 0), faceCoordinate(oblique, 0, 1)], [0, 10], 1e-9);
  assert.deepEqual(axisPlane(BOX, 1), { normal: [0, 1, 0], offset: 10 });
});
