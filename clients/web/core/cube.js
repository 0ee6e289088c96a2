// SPDX-License-Identifier: Apache-2.0
// The orientation cube. It has 26 parts, named by the direction to them in world axes: [0, 0, 1] is a face, [1, 0, 1] an edge,
// [-1, 1, 1] a corner. An edge consists of two strips and a corner of three squares, one on each face. Coordinates on the
// screen are relative to the centre of the cube, y down; half an edge of the cube is 1.
import { conjugate, cross, rotate } from './vector.js';

/** Half the width of a face's own part. */
export const INNER = 0.58;

const SIGNS = [-1, 0, 1];
export const PARTS = Object.freeze(SIGNS.flatMap((z) => SIGNS.flatMap((y) => SIGNS.map((x) => [x, y, z])))
  .filter((part) => part.some(Boolean)));

const flat = ([x, y]) => [x, -y];
const range = (sign, inner) => (sign === 0 ? [-inner, inner] : sign < 0 ? [-1, -inner] : [inner, 1]);
const sees = (orientation, axis, sign) => rotate(conjugate(orientation), [0, 1, 2].map((i) => (i === axis ? sign : 0)))[2] > 1e-6;

/**
 * The quadrilaterals of a part on the faces that the camera sees, as lists of four points on the screen. inner: half the width of a
 * face's own part; 1 = a cube without edges and corners, whose faces are large enough for a finger.
 */
export function outlines(part, orientation, inner = INNER) {
  if (inner === 1 && part.filter(Boolean).length > 1) return [];
  const inverse = conjugate(orientation);
  return [0, 1, 2].filter((axis) => part[axis] !== 0 && sees(orientation, axis, part[axis])).map((axis) => {
    const [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
    const [[b0, b1], [c0, c1]] = [range(part[b], inner), range(part[c], inner)];
    return [[b0, c0], [b1, c0], [b1, c1], [b0, c1]].map(([u, v]) => {
      const point = [0, 0, 0];
      [point[axis], point[b], point[c]] = [part[axis], u, v];
      return flat(rotate(inverse, point));
    });
  });
}

/** The place of a direction on the screen: of a part's middle or of the end of an axis. */
export const placeOf = (direction, orientation) => flat(rotate(conjugate(orientation), direction));

/**
 * The map [a, b, c, d, e, f] of SVG that lays a text (x right, y down) onto a face so that `up` of the frame is above. Null if the
 * camera does not see the face.
 */
export function faceMatrix(face, orientation, frame) {
  const axis = face.findIndex(Boolean);
  if (!sees(orientation, axis, face[axis])) return null;
  const rise = face[axis] * frame.up[axis];
  const above = rise > 0 ? frame.topUp : rise < 0 ? frame.bottomUp : frame.up;
  const [x, y] = [cross(above, face), above].map((v) => placeOf(v, orientation));
  return [x[0], x[1], -y[0], -y[1], ...placeOf(face, orientation)];
}

/** The visible part that lies next to `part` in a direction of the screen, or `part` itself if there is none. */
export function neighbour(part, [dx, dy], orientation, inner = INNER) {
  const from = placeOf(part, orientation);
  let best = part;
  let least = Infinity;
  for (const other of PARTS) {
    if (outlines(other, orientation, inner).length === 0) continue;
    const to = placeOf(other, orientation);
    const step = [to[0] - from[0], to[1] - from[1]];
    const ahead = step[0] * dx + step[1] * dy;
    const aside = Math.abs(step[0] * dy - step[1] * dx);
    const cost = ahead + 2 * aside;
    if (ahead > 0.05 && ahead > aside * 0.7 && cost < least) [best, least] = [other, cost];
  }
  return best;
}
