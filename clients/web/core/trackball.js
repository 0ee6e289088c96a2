// SPDX-License-Identifier: Apache-2.0
// Orbit by dragging: Shoemake's arcball (Graphics Interface 1992) on Bell's surface. The sphere continues as a hyperbola, so
// that the rotation does not jump at the edge of the ball.
//
// A drag is always computed from its start: the rotation depends on the two end points only. Therefore a closed path ends
// where it started, small steps accumulate no error, and there is no pole at which the view flips.
import { conjugate, cross, dot, multiply, normalize, normalizeQuaternion } from './vector.js';

/** Radius of the ball as a fraction of the viewport's shorter side. A drag across it is about half a turn. */
export const BALL_RADIUS = 0.75;

/** Unit vector (camera space: x right, y up, z towards the viewer) of the ball under a screen point. */
export function pointOnBall([x, y], { width, height }) {
  const radius = BALL_RADIUS * Math.min(width, height);
  const px = (x - width / 2) / radius;
  const py = (height / 2 - y) / radius;
  const square = px * px + py * py;
  const z = square <= 0.5 ? Math.sqrt(1 - square) : 0.5 / Math.sqrt(square);
  return normalize([px, py, z]);
}

/** The rotation of the scene in camera space for a drag from one screen point to another. */
export function turn(from, to, viewport) {
  const a = pointOnBall(from, viewport);
  const b = pointOnBall(to, viewport);
  return normalizeQuaternion([...cross(a, b), dot(a, b)]);
}

/** The orientation of the camera after a drag that started with orientation `start` (see camera.js). */
export function drag(start, from, to, viewport) {
  return normalizeQuaternion(multiply(start, conjugate(turn(from, to, viewport))));
}
