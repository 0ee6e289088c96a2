// SPDX-License-Identifier: Apache-2.0
// Orbit by dragging: Shoemake's arcball (Graphics Interface 1992) on Bell's surface, a sphere that goes over
// into a hyperbola, so that nothing jumps at the ball's edge.
//
// A drag is always computed from where it began: the turn depends on the two end points alone. Therefore a
// closed path ends where it started, small steps cannot accumulate an error, and there is no pole to flip at.
import { conjugate, cross, dot, multiply, normalize, normalizeQuaternion } from './vector.js';

/** Radius of the ball as a part of the viewport's shorter side: dragging across it turns by about half a turn. */
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

/** Rotation in camera space that dragging from one screen point to another asks of what is seen. */
export function turn(from, to, viewport) {
  const a = pointOnBall(from, viewport);
  const b = pointOnBall(to, viewport);
  return normalizeQuaternion([...cross(a, b), dot(a, b)]);
}

/** Orientation of the camera after a drag that began with orientation `start` (see camera.js). */
export function drag(start, from, to, viewport) {
  return normalizeQuaternion(multiply(start, conjugate(turn(from, to, viewport))));
}
