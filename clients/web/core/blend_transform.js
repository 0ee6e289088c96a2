// SPDX-License-Identifier: Apache-2.0
// The way of a layer from one transform to another, as the daemon computes it (server/paths/blend_transform.h): if both turn and scale
// evenly, a screw at constant speed, which keeps what the turn keeps; else linear.
import { add, cross, dot, length, scale, subtract } from './vector.js';

const NEAR = 1e-6;

const rowsOf = (m) => [m.slice(0, 3), m.slice(4, 7), m.slice(8, 11)];
const detOf = ([a, b, c]) => dot(a, cross(b, c));

/** {turn, size, shift}; null if the matrix mirrors, shears or scales unevenly. */
function similarityOf(m) {
  const size = Math.cbrt(detOf(rowsOf(m)));
  if (!(size > 0)) return null;
  const turn = rowsOf(m).map((row) => scale(row, 1 / size));
  const isTurn = turn.every((row, i) => turn.every((other, k) => Math.abs(dot(row, other) - Number(i === k)) < NEAR));
  return isTurn ? { turn, size, shift: [m[3], m[7], m[11]] } : null;
}

/** The unit axis and the angle in [0, π] of a turn. */
function axisOf(m) {
  const trace = m[0][0] + m[1][1] + m[2][2];
  const sines = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
  let axis = sines;
  if (trace < 0) { // the sine alone would be lost to cancellation
    const i = [0, 1, 2].reduce((most, k) => (m[k][k] > m[most][most] ? k : most));
    axis = [0, 1, 2].map((k) => m[i][k] + m[k][i] + (k === i ? 1 - trace : 0));
    if (dot(axis, sines) < 0) axis = scale(axis, -1);
  }
  const size = length(axis);
  return { axis: size > 0 ? scale(axis, 1 / size) : [1, 0, 0], angle: Math.atan2(length(sines), trace - 1) };
}

const rotate = (axis, angle, v) => add(add(scale(v, Math.cos(angle)), scale(cross(axis, v), Math.sin(angle))), scale(axis, dot(axis, v) * (1 - Math.cos(angle))));

/** (e^(uz) − 1) / (e^z − 1) for z = x + iy, as [real, imaginary]. */
function weights(x, y, u) {
  if (Math.hypot(x, y) < 1e-8) return [u, 0];
  const less = (s) => [Math.exp(s * x) * Math.cos(s * y) - 1, Math.exp(s * x) * Math.sin(s * y)];
  const [[a, b], [c, d]] = [less(u), less(1)];
  const square = c * c + d * d;
  return [(a * c + b * d) / square, (b * c - a * d) / square];
}

function blendScrew(a, b, u) {
  const grow = Math.log(b.size / a.size);
  const turn = b.turn.map((row) => a.turn.map((other) => dot(row, other)));
  const shift = b.shift.map((part, r) => part - b.size / a.size * dot(turn[r], a.shift));
  const { axis, angle } = axisOf(turn);
  const along = scale(axis, dot(axis, shift));
  const [straight] = weights(grow, 0, u);
  const [real, imaginary] = weights(grow, angle, u);
  const move = (v) => scale(rotate(axis, u * angle, v), Math.exp(u * grow));
  const columns = [0, 1, 2].map((c) => move(a.turn.map((row) => row[c] * a.size)));
  const moved = [move(a.shift), scale(along, straight), scale(subtract(shift, along), real), scale(cross(axis, shift), imaginary)].reduce(add);
  return [0, 1, 2].flatMap((r) => [...columns.map((column) => column[r]), moved[r]]).concat(0, 0, 0, 1);
}

/** The transform at u in (0, 1). */
export function blendTransform(a, b, u) {
  if (a.every((part, i) => part === b[i])) return a;
  const [from, to] = [similarityOf(a), similarityOf(b)];
  if (from && to) return blendScrew(from, to, u);
  const isUnmirrored = (m) => detOf(rowsOf(m)) > 0;
  return isUnmirrored(a) === isUnmirrored(b) ? a.map((part, i) => (i < 12 ? part * (1 - u) + b[i] * u : part)) : a;
}
