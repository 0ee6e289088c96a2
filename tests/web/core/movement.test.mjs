// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { cameraFromRig, pointOnPlane, worldPerPixel } from '../../../clients/web/core/camera.js';
import { project as placeOf } from '../../../clients/web/core/project.js';
import { between, eyeOf, look, walk, withFieldOfView, withProjection, zoomTo } from '../../../clients/web/core/movement.js';
import { frameOf, orientationOf } from '../../../clients/web/core/orientation.js';
import { length, subtract } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close } from '../support/numbers.mjs';

const project = (...args) => {
  const { x, y } = placeOf(...args);
  return [x, y];
};

const VIEWPORT = { width: 800, height: 600 };
const frame = frameOf(null);
const rigAt = (azimuth, elevation, more = {}) => ({
  projection: 'perspective', target: [1, 2, 3], distance: 100, orientation: orientationOf(frame, { azimuth, elevation }), fovY: 30,
  height: 50, ...more,
});

test('the way between two rigs starts at one, ends exactly at the other, and turns by the shorter arc', () => {
  const [a, b] = [rigAt(0, 0), rigAt(90, 0, { distance: 400, target: [5, 2, 3] })];
  assert.equal(between(a, b, 1), b);
  close(between(a, b, 0).target, a.target);
  const middle = between(a, b, 0.5);
  close([middle.distance], [200], 1e-9);
  close(eyeOf({ ...middle, target: [0, 0, 0] }), [200 * Math.SQRT1_2, -200 * Math.SQRT1_2, 0], 1e-9);
  const opposite = { ...b, orientation: b.orientation.map((x) => -x) };
  close(eyeOf(between(a, opposite, 0.5)), eyeOf(middle), 1e-9);
});

test('another projection or field of view keeps the size of what lies at the target', () => {
  const sphere = { center: [0, 0, 0], radius: 60 };
  const rig = rigAt(30, 20);
  const flat = withProjection(rig, 'orthographic', sphere);
  close([worldPerPixel(flat, VIEWPORT)], [worldPerPixel(rig, VIEWPORT)], 1e-12);
  const back = withProjection(flat, 'perspective', sphere);
  close([back.distance], [rig.distance], 1e-9);
  assert.equal(withProjection(rig, 'perspective', sphere), rig);
  const wide = withFieldOfView(rig, 60);
  close([worldPerPixel(wide, VIEWPORT)], [worldPerPixel(rig, VIEWPORT)], 1e-12);
  assert.equal(wide.fovY, 60);
  // An eye inside the volume moves out, because nothing behind it is drawn.
  const inside = withProjection(rigAt(0, 0, { distance: 2 }), 'orthographic', sphere);
  compare(length(subtract(cameraFromRig(inside).position, sphere.center)), '>', 60);
});

test('looking around keeps the eye and the horizon; walking moves the eye', () => {
  const rig = rigAt(0, 0);
  const turned = look(rig, frame, Math.PI / 2, 0);
  close(eyeOf(turned), eyeOf(rig), 1e-9);
  close(cameraFromRig(turned).up, [0, 0, 1], 1e-9);
  // The camera looked along +y; after a quarter turn to the left it looks along -x.
  close(subtract(turned.target, eyeOf(turned)), [-100, 0, 0], 1e-9);
  close(subtract(look(rig, frame, 0, 0.5).target, eyeOf(rig)), [0, 100 * Math.cos(0.5), 100 * Math.sin(0.5)], 1e-9);
  close(subtract(eyeOf(walk(rig, frame, [0, 0, 7])), eyeOf(rig)), [0, 7, 0], 1e-9);
  close(subtract(eyeOf(walk(rig, frame, [7, 0, 0])), eyeOf(rig)), [7, 0, 0], 1e-9);
  close(subtract(eyeOf(walk(rigAt(0, 40), frame, [0, 7, 0])), eyeOf(rigAt(0, 40))), [0, 0, 7], 1e-9);
});

test('zooming to a rectangle centres it and shows it as large as it fits', () => {
  for (const projection of ['perspective', 'orthographic']) {
    const rig = rigAt(20, 30, { projection });
    const [a, b] = [[100, 100], [300, 200]].map((at) => pointOnPlane(rig, at, VIEWPORT));
    const close_ = zoomTo(rig, [300, 200], [100, 100], VIEWPORT, { nearest: 1e-3, farthest: 1e6 });
    close(project(close_, a, VIEWPORT), [0, 100], 1e-6);
    close(project(close_, b, VIEWPORT), [800, 500], 1e-6);
  }
});
