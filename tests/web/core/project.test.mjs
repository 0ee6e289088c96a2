// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { rigFromCamera } from '../../../clients/web/core/camera.js';
import { meetPlane, pointAtDepth, project, projector, ray } from '../../../clients/web/core/project.js';
import { add, scale } from '../../../clients/web/core/vector.js';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

const VIEWPORT = { width: 800, height: 400 };
const PERSPECTIVE = { projection: 'perspective', position: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0], fov_y: 90 };
const ORTHOGRAPHIC = { ...PERSPECTIVE, projection: 'orthographic', height: 8 };

function* rigs() {
  const next = random(11);
  for (let i = 0; i < 40; i += 1) {
    yield {
      projection: i % 2 ? 'orthographic' : 'perspective', target: [20 * next(), 20 * next(), 20 * next()],
      distance: 50 + 20 * next(), orientation: unitQuaternion(next), fovY: 40 + 30 * next(), height: 20 + 10 * next(),
    };
  }
}

test('a perspective camera: half of a field of view of 90 degrees is as high as the point is far', () => {
  const at = projector(rigFromCamera(PERSPECTIVE), VIEWPORT);
  assert.deepEqual(at([0, 0, 0]), { x: 400, y: 200, depth: 10, isVisible: true });
  const { x, y, depth } = at([5, 10, 0]); // 10 units deep, so 10 units up are half of the height
  close([x, y, depth], [500, 0, 10], 1e-9);
  close([at([5, 5, 5]).x, at([5, 5, 5]).y], [600, 0], 1e-9);
});

test('an orthographic camera: the height of the picture is the height of the camera', () => {
  const at = projector(rigFromCamera(ORTHOGRAPHIC), VIEWPORT);
  for (const z of [0, 5, -30]) {
    const { x, y } = at([8, -4, z]);
    close([x, y], [800, 400], 1e-9);
  }
  assert.equal(at([1, 1, 3]).depth, 7);
});

test('what lies behind the camera or beside the picture is not visible', () => {
  const at = projector(rigFromCamera(PERSPECTIVE), VIEWPORT);
  assert.equal(at([0, 0, 11]).isVisible, false);
  assert.ok(Number.isNaN(at([0, 0, 11]).x));
  assert.equal(at([0, 11, 0]).isVisible, false);
  assert.equal(at([19, 0, 0]).isVisible, true);
  assert.equal(at([21, 0, 0]).isVisible, false);
  assert.equal(projector(rigFromCamera(ORTHOGRAPHIC), VIEWPORT)([0, 0, 11]).isVisible, false);
});

test('all points of a ray have the place that the ray was made for', () => {
  for (const rig of rigs()) {
    const { origin, direction } = ray(rig, [123, 321], VIEWPORT);
    close([Math.hypot(...direction)], [1], 1e-12);
    for (const far of [1, 40, 500]) {
      const { x, y } = project(rig, add(origin, scale(direction, far)), VIEWPORT);
      close([x, y], [123, 321], 1e-6);
    }
  }
});

test('a point dragged in the picture follows the cursor at its own depth', () => {
  for (const rig of rigs()) {
    const point = add(rig.target, [1, 2, 3]);
    const moved = pointAtDepth(rig, [250, 99], VIEWPORT, point);
    const { x, y, depth } = project(rig, moved, VIEWPORT);
    close([x, y, depth], [250, 99, project(rig, point, VIEWPORT).depth], 1e-7);
  }
});

test('a plane is met in front of the origin only', () => {
  const down = { origin: [0, 0, 5], direction: [0, 0, -1] };
  close(meetPlane(down, [7, 7, 2], [0, 0, 1]), [0, 0, 2]);
  assert.equal(meetPlane(down, [0, 0, 6], [0, 0, 1]), null);
  assert.equal(meetPlane(down, [0, 0, 0], [1, 0, 0]), null);
});
