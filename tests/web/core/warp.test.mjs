// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { cameraFromRig, orbit, pan, pointOnPlane, rigFromCamera, zoom } from '../../../clients/web/core/camera.js';
import { project } from '../../../clients/web/core/project.js';
import { cameraOf, cssTransform, fadesOf, homography, isFurther } from '../../../clients/web/core/warp.js';

const VIEWPORT = { width: 800, height: 500 };
const POINTS = [[0, 0], [800, 0], [0, 500], [800, 500], [400, 250], [123, 321]];
const CAMERAS = [
  { projection: 'perspective', position: [3, 4, 10], target: [1, 0, 2], up: [0, 1, 0], fov_y: 40 },
  { projection: 'orthographic', position: [3, 4, 10], target: [1, 0, 2], up: [0, 1, 0], height: 7 },
];
const MOVES = {
  none: (rig) => rig,
  orbit: (rig) => orbit(rig, 0.2, -0.1, 0.3),
  pan: (rig) => pan(rig, [60, -20], VIEWPORT),
  zoom: (rig) => zoom(rig, 0.8, [200, 300], VIEWPORT, { nearest: 0.1, farthest: 100 }),
  all: (rig) => orbit(pan(zoom(rig, 1.2, [500, 100], VIEWPORT, { nearest: 0.1, farthest: 100 }), [-30, 10], VIEWPORT), -0.3, 0.2, 0),
};

const apply = (map, [x, y]) => {
  const [u, v, w] = map.map(([a, b, c]) => a * x + b * y + c);
  return [u / w, v / w];
};

for (const camera of CAMERAS)
  for (const [name, move] of Object.entries(MOVES))
    test(`${camera.projection}, ${name}: points of the target's plane appear where the new camera sees them`, () => {
      const from = rigFromCamera(camera);
      const to = move(from);
      const map = homography(from, to, VIEWPORT);
      for (const point of POINTS) {
        const { x, y } = project(to, pointOnPlane(from, point, VIEWPORT), VIEWPORT);
        const wanted = [x, y];
        const got = apply(map, point);
        for (const i of [0, 1]) assert.ok(Math.abs(got[i] - wanted[i]) < 1e-6, `${point}: ${got} instead of ${wanted}`);
      }
    });

test('a camera that sees the plane edge-on or from behind gives no warp', () => {
  for (const camera of CAMERAS) {
    const from = rigFromCamera(camera);
    for (const angle of [1.4, Math.PI]) assert.equal(homography(from, orbit(from, angle, 0, 0), VIEWPORT), null);
    assert.ok(homography(from, orbit(from, 0.5, 0, 0), VIEWPORT));
  }
  assert.equal(homography(rigFromCamera(CAMERAS[0]), rigFromCamera(CAMERAS[1]), VIEWPORT), null, 'another projection');
});

test('the picture fades at the sides beyond which the background shows, and not where its border is outside', () => {
  const { width, height } = VIEWPORT;
  const fades = (map) => fadesOf(map, VIEWPORT);
  const shift = (x, y) => [[1, 0, x], [0, 1, y], [0, 0, 1]];
  assert.deepEqual(fades(shift(0, 0)), { left: 0, right: 0, top: 0, bottom: 0 });
  assert.deepEqual(fades(shift(20, -5)), { left: 40, right: 0, top: 0, bottom: 10 });
  assert.deepEqual(fades(shift(-300, 300)), { left: 0, right: 75, top: 75, bottom: 0 }, 'at the most 15 % of the shorter side');
  const half = [[0.5, 0, width / 4], [0, 0.5, height / 4], [0, 0, 1]];
  assert.deepEqual(fades(half), { left: 75, right: 75, top: 75, bottom: 75 });
  assert.deepEqual(fades([[2, 0, -width / 2], [0, 2, -height / 2], [0, 0, 1]]), { left: 0, right: 0, top: 0, bottom: 0 });
});

test('the CSS transform has the columns of the matrix', () => {
  assert.equal(cssTransform([[2, 4, 6], [8, 10, 12], [14, 16, 2]]), 'matrix3d(1, 4, 0, 7, 2, 5, 0, 8, 0, 0, 1, 0, 3, 6, 0, 1)');
});

test('the camera of a frame is that of its update, or another one that the daemon expected', () => {
  for (const plain of CAMERAS) {
    const sight = plain.target.map((x, i) => x - plain.position[i]);
    const camera = { ...plain, up: plain.up.map((x, i) => x + 0.05 * sight[i]) }; // as in default views: up is not orthogonal to the sight
    const rig = rigFromCamera(camera);
    const frame = (change = {}, more = {}) => ({ depth: { camera: { ...camera, ...change } }, isFinal: false, ...more });
    assert.deepEqual(cameraOf(frame(), rig), { rig, isAhead: false });
    const later = orbit(rig, 0.1, 0, 0);
    const ahead = cameraOf(frame(cameraFromRig(later)), rig);
    assert.equal(ahead.isAhead, true);
    for (const i of [0, 1, 2]) assert.ok(Math.abs(cameraFromRig(ahead.rig).position[i] - cameraFromRig(later).position[i]) < 1e-6);
    if (camera.projection === 'orthographic') assert.equal(cameraOf(frame({ height: 2 * camera.height }), rig).isAhead, true);
    assert.deepEqual(cameraOf(frame(cameraFromRig(later)), null), { rig: null, isAhead: false }, 'an update of another client');
    assert.deepEqual(cameraOf({ depth: null, isFinal: false }, rig), { rig, isAhead: false }, 'no camera');
    assert.deepEqual(cameraOf(frame(cameraFromRig(later), { isFinal: true }), rig), { rig, isAhead: false }, 'final frames are never ahead');
  }
});

test('the way between cameras is longer for larger movements', () => {
  for (const camera of CAMERAS) {
    const rig = rigFromCamera(camera);
    assert.equal(isFurther(orbit(rig, 0.2, 0, 0), orbit(rig, -0.1, 0, 0), rig), true);
    if (camera.projection === 'perspective') assert.equal(isFurther({ ...rig, height: 1000 }, orbit(rig, 0.1, 0, 0), rig), false, 'it has no height');
    assert.equal(isFurther(orbit(rig, 0.1, 0, 0), pan(rig, [200, 0], VIEWPORT), rig), false);
    assert.equal(isFurther(rig, zoom(rig, 0.9, [400, 250], VIEWPORT, { nearest: 0.1, farthest: 100 }), rig), false);
  }
});
