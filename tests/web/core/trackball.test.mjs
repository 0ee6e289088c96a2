// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { cameraFromRig, orbit, rigFromCamera } from '../../../clients/web/core/camera.js';
import { project } from '../../../clients/web/core/project.js';
import { BALL_RADIUS, drag, pointOnBall, turn } from '../../../clients/web/core/trackball.js';
import { add, dot, length, multiply, rotate, subtract } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

const VIEWPORT = { width: 800, height: 600 };
const MIDDLE = [400, 300];
const sameTurn = (a, b, tolerance) => compare(1 - Math.abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]), '<', tolerance, `${a} is not ${b}`);

test('the centre of the ball faces the viewer, y points up, and its edge is continuous', () => {
  close(pointOnBall(MIDDLE, VIEWPORT), [0, 0, 1]);
  compare(pointOnBall([400, 200], VIEWPORT)[1], '>', 0);
  compare(pointOnBall([500, 300], VIEWPORT)[0], '>', 0);
  const edge = 400 + BALL_RADIUS * 600 / Math.SQRT2;
  close(pointOnBall([edge - 1e-6, 300], VIEWPORT), pointOnBall([edge + 1e-6, 300], VIEWPORT), 1e-8);
  close([length(pointOnBall([1e6, -1e6], VIEWPORT))], [1]);
});

test('the front follows the pointer: dragging right turns it to the right', () => {
  const front = rotate(turn(MIDDLE, [500, 300], VIEWPORT), [0, 0, 1]);
  compare(front[0], '>', 0.1);
  compare(Math.abs(front[1]), '<', 1e-12);
  const up = rotate(turn(MIDDLE, [400, 200], VIEWPORT), [0, 0, 1]);
  compare(up[1], '>', 0.1);
  compare(Math.abs(up[0]), '<', 1e-12);
});

test('rotations compose: a drag in two parts equals the same drag in one', () => {
  const next = random(3);
  for (let i = 0; i < 200; i += 1) {
    const [a, b, c] = [0, 1, 2].map(() => [400 + 400 * next(), 300 + 300 * next()]);
    sameTurn(multiply(turn(b, c, VIEWPORT), turn(a, b, VIEWPORT)), turn(a, c, VIEWPORT), 1e-12);
  }
});

test('a closed pointer path returns to its start, in one drag and in parts', () => {
  const start = unitQuaternion(random(4));
  const circle = (i) => [400 + 250 * Math.cos(i / 50 * Math.PI), 300 + 250 * Math.sin(i / 50 * Math.PI)];
  sameTurn(drag(start, circle(0), circle(100), VIEWPORT), start, 1e-14);
  let q = start;
  for (let i = 0; i < 100; i += 1) q = drag(q, circle(i), circle(i + 1), VIEWPORT);
  sameTurn(q, start, 1e-12);
});

test('after 10,000 steps the camera is still orthonormal and at its distance', () => {
  const next = random(5);
  let rig = rigFromCamera({ position: [3, 4, 500], target: [1, 2, 3], up: [0.1, 1, 0], fov_y: 30 });
  const distance = rig.distance;
  let at = MIDDLE;
  for (let i = 0; i < 10000; i += 1) {
    const to = [400 + 400 * next(), 300 + 300 * next()];
    rig = { ...rig, orientation: drag(rig.orientation, at, to, VIEWPORT) };
    if (i % 7 === 0) rig = orbit(rig, next() * 0.1, next() * 0.1, next() * 0.1);
    at = to;
  }
  const camera = cameraFromRig(rig);
  const sight = subtract(camera.target, camera.position);
  close([length(sight), length(camera.up), dot(sight, camera.up)], [distance, 1, 0], 1e-9 * distance);
  close(camera.target, [1, 2, 3]);
});

test('there is no pole: rotation by keys over the top is uniform', () => {
  let rig = rigFromCamera({ position: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0] });
  let before = cameraFromRig(rig).position;
  for (let i = 0; i < 90; i += 1) {
    rig = orbit(rig, 0, 4 * Math.PI / 180);
    const { position } = cameraFromRig(rig);
    close([length(subtract(position, before))], [2 * 10 * Math.sin(2 * Math.PI / 180)], 1e-9);
    before = position;
  }
  close(before, [0, 0, 10], 1e-9);
});

test('on the screen, the point that faces the viewer moves with the pointer', () => {
  const next = random(6);
  for (let i = 0; i < 50; i += 1) {
    const rig = {
      projection: 'perspective', target: [1, 2, 3], distance: 100, orientation: unitQuaternion(next), fovY: 30, height: 1,
    };
    const front = add(rig.target, rotate(rig.orientation, [0, 0, 5]));
    const by = [60 * next(), 60 * next()];
    const turned = { ...rig, orientation: drag(rig.orientation, MIDDLE, [400 + by[0], 300 + by[1]], VIEWPORT) };
    const { x, y } = project(turned, front, VIEWPORT);
    assert.equal(Math.sign(x - 400), Math.sign(by[0]));
    assert.equal(Math.sign(y - 300), Math.sign(by[1]));
  }
});
