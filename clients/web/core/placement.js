// SPDX-License-Identifier: Apache-2.0
// Where a layer of elements lies: its matrix as a move, turns and a scale. A placement is {move, turn, scale}: turn are degrees about
// the world's x, then y, then z. Turns and scale keep the `center` of the elements, so that what lies far from the origin stays in sight.
import { add, dot, subtract } from './vector.js';

const DEGREE = Math.PI / 180;
const EXACT = 1e-4; // of rotations that count as such

export const IDENTITY = Object.freeze([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
export const UNMOVED = Object.freeze({ move: [0, 0, 0], turn: [0, 0, 0], scale: 1 });

const times = (rows, v) => rows.map((row) => dot(row, v));
const rowsOf = (matrix) => [0, 4, 8].map((at) => matrix.slice(at, at + 3));
const round = (value) => Number(value.toPrecision(9)) + 0;

function rotation([x, y, z]) {
  const [[cx, sx], [cy, sy], [cz, sz]] = [x, y, z].map((angle) => [Math.cos(angle * DEGREE), Math.sin(angle * DEGREE)]);
  return [
    [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
    [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
    [-sy, cy * sx, cy * cx],
  ].map((row) => row.map((part) => (Math.abs(part) < 1e-15 ? 0 : part)));
}

/** The matrix of a placement, row by row. */
export function matrixOf({ move, turn, scale }, center = [0, 0, 0]) {
  const rows = rotation(turn).map((row) => row.map((part) => part * scale));
  const shift = add(move, subtract(center, times(rows, center)));
  return [...rows.flatMap((row, i) => [...row, shift[i]]), 0, 0, 0, 1];
}

/** The placement of a matrix; null if it mirrors, shears or scales unevenly. */
export function placementOf(matrix, center = [0, 0, 0]) {
  const rows = rowsOf(matrix);
  const [a, b, c] = rows;
  const det = a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
  const scale = Math.cbrt(det);
  if (!(scale > 0)) return null;
  const unit = rows.map((row) => row.map((part) => part / scale));
  const isTurn = unit.every((row, i) => unit.every((other, j) => Math.abs(dot(row, other) - Number(i === j)) < EXACT));
  if (!isTurn) return null;
  const y = Math.asin(Math.min(1, Math.max(-1, -unit[2][0])));
  const isUpright = Math.cos(y) > 1e-6; // else x and z turn about one axis
  const x = isUpright ? Math.atan2(unit[2][1], unit[2][2]) : 0;
  const z = isUpright ? Math.atan2(unit[1][0], unit[0][0]) : Math.atan2(-unit[0][1], unit[1][1]);
  const move = subtract(add([3, 7, 11].map((at) => matrix[at]), times(rows, center)), center);
  return { move: move.map(round), turn: [x, y, z].map((angle) => round(angle / DEGREE)), scale: round(scale) };
}

/** True if two matrices are the same but for rounding; `size` is the extent of the elements. */
export const isSameMatrix = (a, b, size = 1) => a.every((part, i) => Math.abs(part - b[i]) <= 1e-6 * (i % 4 === 3 ? Math.max(size, Math.abs(part)) : Math.max(1, Math.abs(part))));

/** The placement that puts what lies in a sphere {center, radius} into another one, without turning it. */
export function fitPlacement(from, into) {
  const scale = from.radius > 0 && into.radius > 0 ? Number((into.radius / from.radius).toPrecision(3)) : 1;
  return { ...UNMOVED, move: subtract(into.center, from.center).map(round), scale };
}
