// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { turnBetween } from '../../../clients/web/core/orientation.js';
import { isInSight, isSamePlace, linkedCamera, settingsOf } from '../../../clients/web/core/compare.js';

const camera = { position: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0], projection: 'perspective', fov_y: 30, near: 1 };

test('the camera is the same in world units', () => {
  assert.deepEqual(linkedCamera(camera), camera);
});

test('fitted, the other volume has the same direction and share of the picture', () => {
  const flat = { ...camera, projection: 'orthographic', height: 4 };
  const made = linkedCamera(flat, undefined, { center: [0, 0, 0], radius: 2 }, { center: [100, 0, 0], radius: 6 });
  assert.deepEqual(made.position, [100, 0, 30]);
  assert.deepEqual(made.target, [100, 0, 0]);
  assert.deepEqual([made.height, made.near, made.fov_y], [12, 3, 30]);
  assert.deepEqual(linkedCamera(camera, undefined, { center: [0, 0, 0], radius: 0 }, { center: [1, 1, 1], radius: 1 }), camera);
});

test('in a turned world, the camera sees the same side', () => {
  const turn = turnBetween(['L', 'P', 'S'], ['R', 'S', 'A']);
  const made = linkedCamera({ ...camera, position: [1, 2, 10] }, turn);
  assert.deepEqual([made.position, made.up], [[-1, 10, -2], [0, 0, -1]]);
  const fitted = linkedCamera({ ...camera, position: [6, 0, 10], target: [5, 0, 0] }, turn, { center: [5, 0, 0], radius: 1 }, { center: [0, 7, 0], radius: 2 });
  assert.deepEqual([fitted.position, fitted.target, fitted.up], [[-2, 27, 0], [0, 7, 0], [0, 0, -1]]);
});

test('volumes at different places or of very different sizes are told', () => {
  const at = (x, radius) => ({ center: [x, 0, 0], radius });
  assert.ok(isSamePlace(at(0, 10), at(4, 9)));
  assert.ok(!isSamePlace(at(0, 10), at(6, 10)));
  assert.ok(!isSamePlace(at(0, 10), at(0, 2)));
  assert.ok(isSamePlace(null, at(0, 2)));
  assert.ok(isSamePlace(at(-40, 10), at(40, 10), ([x, y, z]) => [-x, -y, z]), 'in another world');
});

test('a volume beside, behind, or much smaller than the picture is not in sight', () => {
  const viewport = { width: 800, height: 400 };
  const at = (x, y, z, radius = 1) => ({ center: [x, y, z], radius });
  const half = Math.tan(15 * Math.PI / 180); // of the picture, at a depth of 1
  for (const [camera_, edge] of [[camera, 10 * half], [{ ...camera, projection: 'orthographic', height: 20 * half }, 10 * half]]) {
    assert.ok(isInSight(camera_, at(0, 0, 0), viewport));
    assert.ok(isInSight(camera_, at(2 * edge + 0.9, 0, 0), viewport), 'a part of it, at the right');
    assert.ok(!isInSight(camera_, at(2 * edge + 1.3, 0, 0), viewport));
    assert.ok(!isInSight(camera_, at(0, -edge - 1.3, 0), viewport));
    assert.ok(!isInSight(camera_, at(0, 0, 12), viewport), 'behind the camera');
    assert.ok(isInSight(camera_, at(0, 0, 10, 50), viewport), 'the camera is in it');
    assert.ok(isInSight(camera_, at(0, 0, 0, 0.03), viewport), '4.5 px');
    assert.ok(!isInSight(camera_, at(0, 0, 0, 0.02), viewport), '3 px');
  }
});

test('settings are the view without camera and size', () => {
  assert.deepEqual(settingsOf({ volume: 'v', camera, size: [1, 1], background: [0, 0, 0, 1] }), { volume: 'v', background: [0, 0, 0, 1] });
});
