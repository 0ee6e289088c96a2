// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  cameraFromRig, fit, orbit, pan, pointOnPlane, rigFromCamera, sphereAround, volumeBox, widen, zoom, zoomLimits,
} from '../../../clients/web/core/camera.js';
import { project as place } from '../../../clients/web/core/project.js';
import { add, length, rotate, scale, subtract } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close, random, unitQuaternion } from '../support/numbers.mjs';

const VIEWPORT = { width: 900, height: 500 };
const project = (rig, point, viewport) => {
  const { x, y } = place(rig, point, viewport);
  return [x, y];
};
const LIMITS = { nearest: 1e-3, farthest: 1e6 };

function* rigs() {
  const next = random(7);
  for (let i = 0; i < 60; i += 1) {
    yield {
      projection: i % 2 ? 'orthographic' : 'perspective', target: [50 * next(), 50 * next(), 50 * next()],
      distance: 300 + 200 * next(), orientation: unitQuaternion(next), fovY: 40 + 30 * next(), height: 200 + 100 * next(),
    };
  }
}

test('a camera survives the conversion to a rig and back, and its up vector becomes perpendicular', () => {
  const camera = { projection: 'perspective', position: [10, 20, 400], target: [1, 2, 3], up: [0.2, 1, 0.1], fov_y: 30 };
  const back = cameraFromRig(rigFromCamera(camera));
  close(back.position, camera.position, 1e-9);
  close(back.target, camera.target);
  const again = cameraFromRig(rigFromCamera({ ...camera, ...back }));
  close(again.up, back.up, 1e-12);
  assert.ok(!('height' in back));
});

test('only an orthographic camera has a height', () => {
  const rig = rigFromCamera({ projection: 'orthographic', position: [0, 0, 5], target: [0, 0, 0], up: [0, 1, 0], height: 7 });
  assert.equal(cameraFromRig(rig).height, 7);
});

test('a degenerate camera is refused', () => {
  assert.throws(() => rigFromCamera({ position: [1, 1, 1], target: [1, 1, 1], up: [0, 1, 0] }), RangeError);
  assert.throws(() => rigFromCamera({ position: [0, 5, 0], target: [0, 0, 0], up: [0, 1, 0] }), RangeError);
});

test('right and up have the documented directions', () => {
  const rig = rigFromCamera({ position: [0, 0, 10], target: [0, 0, 0], up: [0, 1, 0], fov_y: 30 });
  const [x, y] = project(rig, [1, 1, 0], VIEWPORT);
  compare(x, '>', 450);
  compare(y, '<', 250);
  assert.equal(place(rig, [0, 0, 11], VIEWPORT).isVisible, false);
});

test('pointOnPlane inverts project', () => {
  for (const rig of rigs()) close(project(rig, pointOnPlane(rig, [123, 45], VIEWPORT), VIEWPORT), [123, 45], 1e-8);
});

test('panning moves the point under the cursor with the cursor', () => {
  for (const rig of rigs()) {
    const point = pointOnPlane(rig, [300, 200], VIEWPORT);
    const moved = pan(rig, [37, -81], VIEWPORT);
    close(project(moved, point, VIEWPORT), [337, 119], 1e-8);
    assert.equal(moved.distance, rig.distance);
  }
});

test('zooming keeps the point under the cursor and enlarges the image by the factor', () => {
  for (const rig of rigs()) {
    const at = [700, 90];
    const point = pointOnPlane(rig, at, VIEWPORT);
    const near = zoom(rig, 0.5, at, VIEWPORT, LIMITS);
    close(project(near, point, VIEWPORT), at, 1e-8);
    const key = rig.projection === 'orthographic' ? 'height' : 'distance';
    close([near[key]], [rig[key] / 2]);
    const back = zoom(near, 2, at, VIEWPORT, LIMITS);
    close([...back.target, back[key]], [...rig.target, rig[key]], 1e-9);
  }
});

test('zooming stops at its limits, where the camera does not move', () => {
  for (const rig of rigs()) {
    const key = rig.projection === 'orthographic' ? 'height' : 'distance';
    const limits = { nearest: rig[key], farthest: rig[key] };
    const same = zoom(rig, 0.01, [3, 4], VIEWPORT, limits);
    close([...same.target, same[key]], [...rig.target, rig[key]], 1e-9);
  }
});

test('pinching zooms and pans, so that two fingers stay on the points that they touched', () => {
  for (const rig of rigs()) {
    const [a, b] = [[300, 200], [500, 260]];
    const [p, q] = [a, b].map((at) => pointOnPlane(rig, at, VIEWPORT));
    const [c, d] = [[200, 250], [600, 370]]; // twice the distance, moved, not rotated
    const middle = (u, v) => [(u[0] + v[0]) / 2, (u[1] + v[1]) / 2];
    let moved = zoom(rig, 0.5, middle(a, b), VIEWPORT, LIMITS);
    moved = pan(moved, subtract([...middle(c, d), 0], [...middle(a, b), 0]).slice(0, 2), VIEWPORT);
    close(project(moved, p, VIEWPORT), c, 1e-7);
    close(project(moved, q, VIEWPORT), d, 1e-7);
  }
});

test('orbiting keeps the target in the centre', () => {
  for (const rig of rigs()) close(project(orbit(rig, 1, 0.5, 0.2), rig.target, VIEWPORT), [450, 250], 1e-8);
});

test('the bounding sphere of a volume depends on spacing, origin and direction', () => {
  const plain = sphereAround(volumeBox({ dims: [11, 21, 31], spacing: [1, 1, 2], origin: [5, 0, 0] }));
  close(plain.center, [10, 10, 30]);
  close([plain.radius], [Math.hypot(11, 21, 62) / 2]);
  const turned = sphereAround(volumeBox({ dims: [11, 21, 31], spacing: [1, 1, 2], origin: [0, 0, 0], direction: [[0, -1, 0], [1, 0, 0], [0, 0, 1]] }));
  close(turned.center, [-10, 5, 30]);
  close([turned.radius], [plain.radius]);
});

test('widen keeps the horizontal extent of a square in a narrow window, and does not change a wide window', () => {
  for (const projection of ['perspective', 'orthographic']) {
    const rig = rigFromCamera({
      projection, position: [3, -40, 5], target: [1, 2, 3], up: [0, 0, 1], fov_y: 30, height: 20,
    });
    assert.equal(widen(rig, { width: 900, height: 600 }), rig);
    const wide = widen(rig, { width: 300, height: 600 });
    assert.deepEqual(wide.target, rig.target);
    assert.deepEqual(wide.orientation, rig.orientation);
    // Half the width in pixels, twice the distance and height: the same fraction of the width.
    const side = add(rig.target, rotate(rig.orientation, [2, 0, 0]));
    const share = (r, width, height) => (project(r, side, { width, height })[0] - width / 2) / width;
    close([share(wide, 300, 600)], [share(rig, 600, 600)], 1e-9);
  }
});

test('widen keeps the volume clear of what covers the edges, in the centre, but not below two thirds of its size', () => {
  const rig = rigFromCamera({ position: [3, -40, 5], target: [1, 2, 3], up: [0, 0, 1], fov_y: 30 });
  const viewport = { width: 1440, height: 900 };
  const factor = (margins) => widen(rig, viewport, { left: 0, right: 0, top: 0, bottom: 0, ...margins }).distance / rig.distance;
  assert.equal(widen(rig, viewport, { left: 312, right: 0, top: 40, bottom: 44 }), rig, 'nothing is covered');
  close([factor({ left: 420 })], [900 / (600 / 0.9)], 1e-9);
  close([factor({ bottom: 45 })], [1], 1e-9);
  close([factor({ bottom: 120 })], [900 / (660 / 0.9)], 1e-9);
  close([factor({ left: 700 })], [1.5], 1e-9);
  assert.deepEqual(widen(rig, viewport, { left: 420, right: 0, top: 0, bottom: 0 }).target, rig.target);
});

test('fit brings a box close, whatever the direction, and keeps it clear of the margins', () => {
  const part = { center: [10, -20, 30], half: [[4, 0, 0], [0, 0, 9], [0, 2, 0]], radius: Math.hypot(4, 9, 2) };
  const margins = { left: 300, right: 0, top: 40, bottom: 20 };
  const viewport = { width: 1440, height: 900 };
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((bits) => part.half.reduce((at, edge, i) => add(at, scale(edge, bits >> i & 1 ? -1 : 1)), part.center));
  for (const rig of rigs()) {
    const fitted = fit(rig, part, viewport, margins);
    assert.deepEqual(fitted.target, part.center);
    assert.deepEqual(fitted.orientation, rig.orientation);
    const used = Math.max(...corners.map((corner) => {
      const [x, y] = project(fitted, corner, viewport);
      return Math.max(Math.abs(x - 720) / (720 - 300), Math.abs(y - 450) / (450 - 40));
    }));
    compare(used, '<', 0.95 + 1e-9);
    const ball = fit(rig, { ...part, radius: 2 }, viewport, margins); // a part that leaves the corners empty
    compare(ball[rig.projection === 'perspective' ? 'distance' : 'height'], '<', fitted[rig.projection === 'perspective' ? 'distance' : 'height'] / 2);
    const alone = fit(rig, { ...part, radius: 1e9 }, viewport, margins); // the box decides
    close([Math.max(...corners.map((corner) => {
      const [x, y] = project(alone, corner, viewport);
      return Math.max(Math.abs(x - 720) / (720 - 300), Math.abs(y - 450) / (450 - 40));
    }))], [0.95], 1e-6);
  }
});

test('fit shows the whole sphere, which nearly touches the shorter side, in any window and projection', () => {
  const sphere = { center: [10, -20, 30], radius: 77 };
  for (const viewport of [VIEWPORT, { width: 400, height: 900 }]) {
    for (const rig of rigs()) {
      const fitted = fit(rig, sphere, viewport);
      assert.deepEqual(fitted.orientation, rig.orientation);
      close(project(fitted, sphere.center, viewport), [viewport.width / 2, viewport.height / 2], 1e-8);
      // The silhouette of a sphere under perspective: the tangent cone, sin(angle) = radius / distance.
      const side = 0.95 * Math.min(viewport.width, viewport.height) / 2;
      if (rig.projection === 'perspective') {
        const tangent = Math.tan(Math.asin(77 / fitted.distance));
        close([tangent * fitted.distance / (2 * fitted.distance * Math.tan(rig.fovY * Math.PI / 360) / viewport.height)], [side], 1e-6);
      } else {
        const edge = add(sphere.center, rotate(rig.orientation, [77, 0, 0]));
        close([project(fitted, edge, viewport)[0] - viewport.width / 2], [side], 1e-8);
      }
    }
  }
  const limits = zoomLimits(sphere);
  compare(limits.nearest, '<', sphere.radius);
  compare(limits.farthest, '>', 10 * sphere.radius);
  compare(length(sphere.center), '>', 0);
});
