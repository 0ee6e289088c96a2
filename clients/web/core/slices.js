// SPDX-License-Identifier: Apache-2.0
// Where the slices of a volume lie. A plane is {origin, right, down, normal}: a world point on it and orthonormal world vectors;
// the normal points to the viewer. Distances along the axes of the grid are in world units, from sample 0.
import { roundCoordinate } from './lengths.js';
import { letterOf } from './orientation.js';
import { add, cross, dot, length, normalize, rotate, axisAngle, scale, subtract } from './vector.js';

/** World units along each axis of the grid, at sample i. */
function distanceAt(volume, axis, i) {
  const places = volume.coordinates?.[axis];
  return places?.length ? places[i] : volume.spacing[axis] * i;
}

/**
 * The grid of all samples of a volume. `isPartial`: it is larger than memory, and slices are of the level that their pixels ask for,
 * between the samples of which the plane may lie.
 */
export function finestGrid(volume) {
  const { whole } = volume;
  return whole ? new Grid({ ...volume, dims: whole.dims, spacing: whole.spacing, origin: whole.origin, isPartial: true }) : new Grid(volume);
}

/** The grid of a volume: its axes as world vectors, and the conversions. */
export class Grid {
  #inverse;
  constructor(volume) {
    this.volume = volume;
    this.origin = volume.origin ?? [0, 0, 0];
    const rows = volume.direction ?? [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    this.axes = [0, 1, 2].map((a) => rows.map((row) => row[a]));
    const [x, y, z] = this.axes;
    const determinant = dot(x, cross(y, z));
    this.#inverse = [cross(y, z), cross(z, x), cross(x, y)].map((row) => scale(row, 1 / determinant));
  }

  /** Distances along the axes of a world point. */
  distances(world) {
    const from = subtract(world, this.origin);
    return this.#inverse.map((row) => dot(row, from));
  }

  count(axis) {
    return this.volume.dims[axis];
  }

  /** Half a gap before the first sample, and half a gap after the last. */
  extent(axis) {
    const n = this.count(axis);
    const at = (i) => distanceAt(this.volume, axis, i);
    const gap = (a, b) => (n > 1 ? at(b) - at(a) : this.volume.spacing[axis]) / 2;
    return [-gap(0, 1), at(n - 1) + gap(n - 2, n - 1)];
  }

  /** The sample nearest to a world point along an axis. */
  index(axis, world) {
    const distance = this.distances(world)[axis];
    let low = 0;
    let high = this.count(axis) - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (distanceAt(this.volume, axis, middle) <= distance) low = middle;
      else high = middle;
    }
    const at = (i) => Math.abs(distanceAt(this.volume, axis, i) - distance);
    return at(high) < at(low) ? high : low;
  }

  /** The point moved along an axis to sample `index`, or to the nearest one there is. */
  moveTo(axis, world, index) {
    const i = Math.min(Math.max(Math.round(index), 0), this.count(axis) - 1);
    return add(world, scale(this.axes[axis], distanceAt(this.volume, axis, i) - this.distances(world)[axis]));
  }

  /** The position of the sample that is nearest to a world point. */
  nearest(world) {
    return [0, 1, 2].reduce((point, axis) => this.moveTo(axis, point, this.index(axis, world)), world);
  }

  /** The point moved into the volume. */
  clamp(world) {
    const distances = this.distances(world);
    return this.axes.reduce((point, axis, a) => {
      const [low, high] = this.extent(a);
      const inside = Math.min(Math.max(distances[a], low), high);
      return add(point, scale(axis, inside - distances[a]));
    }, world);
  }

  /** The corners of the volume, in the world. */
  corners() {
    const ends = [0, 1, 2].map((a) => this.extent(a));
    return Array.from({ length: 8 }, (_, corner) => this.axes.reduce(
      (point, axis, a) => add(point, scale(axis, ends[a][corner >> a & 1])), this.origin));
  }

  /** True if the point lies in the volume. */
  has(world) {
    return this.distances(world).every((distance, a) => {
      const [low, high] = this.extent(a);
      return distance >= low && distance <= high;
    });
  }

  get smallest() {
    return Math.min(...this.volume.spacing);
  }

  /** An extent whose thousandth is about a tenth of the smallest gap between samples. */
  get precision() { return 100 * this.smallest; }

  /** A coordinate, rounded to about a tenth of the smallest gap between samples. */
  round(coordinate) {
    return roundCoordinate(coordinate, this.precision);
  }
}

const KINDS = ['axial', 'coronal', 'sagittal'];
const ORDERS = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];

/** The axis of the grid across each kind of slice: [axial, coronal, sagittal]. */
function assign(grid, frame) {
  const across = [frame.up, frame.front, frame.side];
  const fit = (order) => order.reduce((sum, axis, kind) => sum + Math.abs(dot(grid.axes[axis], across[kind])), 0);
  return ORDERS.reduce((best, order) => (fit(order) > fit(best) + 1e-9 ? order : best));
}

const along = (v, towards) => (dot(v, towards) < 0 ? scale(v, -1) : v);

/**
 * The three orthogonal planes through a point: [{kind, axis, origin, right, down, normal}], axial, coronal, sagittal. `frame`
 * is of orientation.js. As radiologists see them: the axial slice from the feet, the front of the sagittal one to the left.
 */
export function orthogonalPlanes(grid, frame, position) {
  const order = assign(grid, frame);
  const back = scale(frame.front, -1);
  const below = scale(frame.up, -1);
  const screens = [[frame.side, back], [frame.side, below], [back, below]];
  return KINDS.map((kind, k) => {
    const axis = order[k];
    const others = [0, 1, 2].filter((a) => a !== axis).map((a) => grid.axes[a]);
    const [toRight, toDown] = screens[k];
    if (Math.abs(dot(others[0], toRight)) + Math.abs(dot(others[1], toDown))
      < Math.abs(dot(others[1], toRight)) + Math.abs(dot(others[0], toDown))) others.reverse();
    const right = normalize(along(others[0], toRight));
    const down = along(others[1], toDown);
    const level = normalize(subtract(down, scale(right, dot(down, right))));
    return { kind, axis, origin: position, right, down: level, normal: cross(level, right) };
  });
}

/** The oblique plane across `normal`; the first of `ups` that is not too close to the normal points up in it as far as it can. */
export function obliquePlane(position, normal, ...ups) {
  const n = normalize(normal);
  const up = [...ups, [0, 0, 1], [0, 1, 0]].find((v) => length(cross(v, n)) > 0.3 * length(v));
  const right = normalize(cross(up, n));
  return { kind: 'oblique', axis: null, origin: position, right, down: cross(right, n), normal: n };
}

/** The planes across `normal` that cut the volume: {low, high}, world units from the origin along it. */
export function reachAlong(grid, normal) {
  const n = normalize(normal);
  const places = grid.corners().map((corner) => dot(corner, n));
  return { low: Math.min(...places), high: Math.max(...places) };
}

/**
 * The point moved to the plane {x: x·normal = offset}, or to the nearest one that cuts the volume. It moves along the normal, and where it
 * would leave the volume, towards the corner that lies farthest in that direction: the volume is convex, so it stays inside.
 */
export function moveAlong(grid, position, normal, offset) {
  const n = normalize(normal);
  const from = grid.clamp(position);
  const { low, high } = reachAlong(grid, n);
  const place = Math.min(Math.max(offset, low), high);
  const way = scale(n, place - dot(from, n));
  const [start, end] = [grid.distances(from), grid.distances(add(from, way))];
  const inside = Math.max(0, Math.min(1, ...start.map((distance, a) => {
    const [first, last] = grid.extent(a);
    const part = end[a] - distance;
    return part === 0 ? 1 : ((part > 0 ? last : first) - distance) / part;
  })));
  const edge = add(from, scale(way, inside));
  if (inside === 1) return edge;
  const sign = dot(way, n) < 0 ? -1 : 1;
  const corner = grid.corners().reduce((best, other) => (sign * dot(subtract(other, best), n) > 0 ? other : best));
  const rest = dot(subtract(corner, edge), n);
  return rest === 0 ? corner : add(edge, scale(subtract(corner, edge), (place - dot(edge, n)) / rest));
}

/** A plane's picture: `center` is the world point in the middle of a pane of `size` px; `zoom` is px per world unit. */
export function paneOf(plane, { center, zoom, size }) {
  const half = size.map((side) => side / 2);
  return {
    toPane: (world) => {
      const from = subtract(world, center);
      return { x: half[0] + zoom * dot(from, plane.right), y: half[1] + zoom * dot(from, plane.down), depth: dot(from, plane.normal) };
    },
    /** The point of the plane under (x, y). */
    toWorld: (x, y) => {
      const point = add(add(center, scale(plane.right, (x - half[0]) / zoom)), scale(plane.down, (y - half[1]) / zoom));
      return add(point, scale(plane.normal, dot(subtract(plane.origin, point), plane.normal)));
    },
  };
}

/** Centre and zoom at which the volume fits a pane, with a margin. */
export function fitPane(grid, plane, size, margin = 0.06) {
  const corners = grid.corners();
  const reach = (v) => {
    const places = corners.map((corner) => dot(corner, v));
    return [Math.min(...places), Math.max(...places)];
  };
  const [x, y] = [reach(plane.right), reach(plane.down)];
  const middle = add(add(scale(plane.right, (x[0] + x[1]) / 2), scale(plane.down, (y[0] + y[1]) / 2)),
    scale(plane.normal, dot(plane.origin, plane.normal)));
  const zoom = Math.min(size[0] / (x[1] - x[0]), size[1] / (y[1] - y[0])) * (1 - 2 * margin);
  return { center: middle, zoom: zoom > 0 && Number.isFinite(zoom) ? zoom : 1 };
}

/** The picture's pixels in a pane as a canvas transform [a, b, c, d, e, f], for an image that begins at a corner of its first pixel. */
export function imageTransform(meta, plane, pane, zoom) {
  const { origin, step_x: stepX, step_y: stepY } = meta;
  const first = pane.toPane(origin);
  const [a, b] = [zoom * dot(stepX, plane.right), zoom * dot(stepX, plane.down)];
  const [c, d] = [zoom * dot(stepY, plane.right), zoom * dot(stepY, plane.down)];
  return [a, b, c, d, first.x - (a + c) / 2, first.y - (b + d) / 2];
}

/** The pixel {column, row} of a slice at a world point, or null outside of it. */
export function pixelAt(meta, world) {
  const from = subtract(world, meta.origin);
  const { step_x: x, step_y: y } = meta;
  const [xx, xy, yy] = [dot(x, x), dot(x, y), dot(y, y)];
  const determinant = xx * yy - xy * xy;
  const [fx, fy] = [dot(from, x), dot(from, y)];
  const column = Math.round((fx * yy - fy * xy) / determinant) + 0; // no -0
  const row = Math.round((fy * xx - fx * xy) / determinant) + 0;
  return column >= 0 && row >= 0 && column < meta.shape[0] && row < meta.shape[1] ? { column, row } : null;
}

/** The world axis with the largest part of a direction. */
export const mainAxis = (v) => v.reduce((best, part, i) => (Math.abs(part) > Math.abs(v[best]) + 1e-9 ? i : best), 0);

const NEAR_AXIS = Math.cos(70 * Math.PI / 180);

/** The anatomical letters of a direction, such as "RA": the letters of the axes within 70° of it, the nearest first. */
export function directionName(anatomy, v) {
  const size = length(v);
  const parts = v.map((part) => Number((part / size).toFixed(6))); // equal parts keep the order of the axes
  return [0, 1, 2].filter((axis) => Math.abs(parts[axis]) >= NEAR_AXIS).sort((a, b) => Math.abs(parts[b]) - Math.abs(parts[a]))
    .map((axis) => letterOf(anatomy, axis, Math.sign(parts[axis]))).join('');
}

/** The line in which a plane cuts another one's picture, as two points far outside of the pane; null if they are parallel. */
export function cutLine(plane, other, reach) {
  const towards = cross(plane.normal, other.normal);
  if (length(towards) < 1e-6) return null;
  const t = normalize(towards);
  // From the point of `plane` nearest to the other's origin, along `plane`, to the other plane.
  const from = subtract(other.origin, scale(plane.normal, dot(subtract(other.origin, plane.origin), plane.normal)));
  const toOther = cross(t, plane.normal);
  const s = dot(subtract(other.origin, from), other.normal) / dot(toOther, other.normal);
  const middle = add(from, scale(toOther, s));
  return [add(middle, scale(t, -reach)), add(middle, scale(t, reach))];
}

/** The normal turned about the axis of a pane's view by an angle [rad], clockwise in that pane. */
export function turnNormal(normal, pane, angle) {
  return rotate(axisAngle(pane.normal, -angle), normalize(normal));
}

/** The query of a plane's slice: through its sample if it is orthogonal and all samples are there, else around `center` with px per world unit. */
export function sliceQuery(grid, plane, { center, zoom, size, limit = 1024 }) {
  if (plane.axis !== null && !grid.volume.isPartial) return { axis: plane.axis, index: grid.index(plane.axis, plane.origin) };
  const onPlane = add(center, scale(plane.normal, dot(subtract(plane.origin, center), plane.normal)));
  const finest = grid.smallest / 2; // more pixels show nothing new
  const spacing = Math.max(1 / zoom, finest, Math.max(...size) / zoom / limit);
  const px = size.map((side) => Math.max(1, Math.min(limit, Math.ceil(side / zoom / spacing))));
  const numbers = (v) => v.map((part) => Number(part.toPrecision(9)) + 0).join(',');
  return {
    origin: numbers(onPlane), normal: numbers(plane.normal), up: numbers(scale(plane.down, -1)), size: px.join(','),
    spacing: Number(spacing.toPrecision(6)),
  };
}
