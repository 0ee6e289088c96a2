// SPDX-License-Identifier: Apache-2.0
// From world to screen and back, exactly as the daemon renders: fov_y is the vertical angle, `height` the vertical extent of an
// orthographic picture, both centred on the line of sight. camera.js describes rigs and viewports.
import { cameraFromRig } from './camera.js';
import { add, dot, rotate, scale, subtract } from './vector.js';

const DEGREE = Math.PI / 180;

/**
 * A function world point → {x, y, depth, isVisible}. x, y: px from the upper left corner, y down. depth: distance from the camera along
 * the line of sight in world units. isVisible: in front of the camera and inside the viewport. A point that a perspective camera
 * cannot see because it lies beside or behind it has no place: x and y are NaN.
 */
export function projector(rig, { width, height }) {
  const { position } = cameraFromRig(rig);
  const [right, up, back] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => rotate(rig.orientation, axis));
  const isOrthographic = rig.projection === 'orthographic';
  const pixels = height / (isOrthographic ? rig.height : 2 * Math.tan(rig.fovY * DEGREE / 2));
  return (world) => {
    const from = subtract(world, position);
    const depth = -dot(from, back);
    if (!isOrthographic && !(depth > 0)) return { x: NaN, y: NaN, depth, isVisible: false };
    const scaled = isOrthographic ? pixels : pixels / depth;
    const x = width / 2 + dot(from, right) * scaled;
    const y = height / 2 - dot(from, up) * scaled;
    return { x, y, depth, isVisible: depth > 0 && x >= 0 && x <= width && y >= 0 && y <= height };
  };
}

/** Projects one world point; see projector(). */
export const project = (rig, world, viewport) => projector(rig, viewport)(world);

/** The ray {origin, direction (unit)} through a screen point; for an orthographic camera it starts in the camera's plane. */
export function ray(rig, [x, y], { width, height }) {
  const { position } = cameraFromRig(rig);
  const isOrthographic = rig.projection === 'orthographic';
  const unit = (isOrthographic ? rig.height : 2 * Math.tan(rig.fovY * DEGREE / 2)) / height;
  const offset = [(x - width / 2) * unit, (height / 2 - y) * unit, 0];
  if (isOrthographic) {
    return { origin: add(position, rotate(rig.orientation, offset)), direction: rotate(rig.orientation, [0, 0, -1]) };
  }
  const along = rotate(rig.orientation, [offset[0], offset[1], -1]);
  return { origin: position, direction: scale(along, 1 / Math.hypot(...along)) };
}

/** The point at which a ray meets the plane through `point` with this normal, or null if it is parallel or behind the origin. */
export function meetPlane({ origin, direction }, point, normal) {
  const slope = dot(direction, normal);
  if (Math.abs(slope) < 1e-12) return null;
  const way = dot(subtract(point, origin), normal) / slope;
  return way < 0 ? null : add(origin, scale(direction, way));
}

/** The point of the plane that is parallel to the picture and contains `point`, below a screen point: for dragging things. */
export function pointAtDepth(rig, at, viewport, point) {
  return meetPlane(ray(rig, at, viewport), point, rotate(rig.orientation, [0, 0, 1]));
}
