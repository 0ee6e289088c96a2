// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import { MAP_NAMES, tableOf } from '../../../clients/web/core/color_maps.js';
import { anatomyOf, frameOf } from '../../../clients/web/core/orientation.js';
import { GREYS, lookOf, paintChannels, paintSlice, readSlice, shadesOf, valueAt } from '../../../clients/web/core/slice_image.js';
import {
  Grid, cutLine, directionName, finestGrid, fitPane, imageTransform, moveAlong, obliquePlane, orthogonalPlanes, paneOf, pixelAt, reachAlong, sliceQuery, turnNormal,
} from '../../../clients/web/core/slices.js';
import { add, cross, dot, length, scale, subtract } from '../../../clients/web/core/vector.js';
import { compare } from '../../support/compare.mjs';
import { close as near } from '../support/numbers.mjs';

const plain = (more = {}) => ({ dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0, 0, 0], direction: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], ...more });
/** Slices from the left to the right, rows from the front to the back, columns from the head down: an MR scan of a head. */
const sagittalScan = plain({
  direction: [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], origin: [-30, -10, 50], spacing: [1, 1, 1.5], anatomy: ['L', 'P', 'S'],
});
const close = (a, b) => near([a], [b]);

test('a grid converts between the world, distances and samples', () => {
  const grid = new Grid(sagittalScan);
  near(grid.distances([-30, -10, 50]), [0, 0, 0]);
  near(grid.distances([-27, -8, 49]), [1, 2, 3]);
  assert.equal(grid.index(2, [-27, -8, 49]), 2);
  near(grid.moveTo(0, [-27, -8, 49], 4), [-27, -8, 46]);
  near(grid.moveTo(0, [-27, -8, 49], 400), [-27, -8, 41]);
  assert.deepEqual(grid.extent(2), [-0.75, 29 * 1.5 + 0.75]);
  near(grid.clamp([-300, 0, 49]), [-30.75, 0, 49]);
  near(grid.nearest([-27.3, -8.4, 48.6]), [-27, -8, 49]);
  near(grid.nearest([-300, 0, 49]), [-30, 0, 49]);
  assert.deepEqual([-27.345, 10038.26].map((place) => grid.round(place)), [-27.3, 10038.3], 'a tenth of the smallest spacing, wherever the volume lies');
  assert.equal(new Grid(plain({ spacing: [0.02, 0.02, 5] })).round(0.12345), 0.123);
});

test('rectilinear axes go by their coordinates', () => {
  const grid = new Grid(plain({ dims: [4, 2, 2], spacing: [3, 1, 1], coordinates: [[0, 1, 3, 9], [], []] }));
  assert.deepEqual([-1, 0.4, 0.6, 2.2, 5.9, 6.1, 70].map((x) => grid.index(0, [x, 0, 0])), [0, 0, 1, 2, 2, 3, 3]);
  near(grid.moveTo(0, [0, 5, 6], 2), [3, 5, 6]);
  assert.deepEqual(grid.extent(0), [-0.5, 12]);
});

test('the slices of a head look as radiologists want them, however the file stores it', () => {
  const anatomy = anatomyOf(sagittalScan);
  const planes = orthogonalPlanes(new Grid(sagittalScan), frameOf(anatomy), [0, 0, 0]);
  assert.deepEqual(planes.map(({ kind, axis }) => [kind, axis]), [['axial', 0], ['coronal', 1], ['sagittal', 2]]);
  assert.deepEqual(planes.map(({ right, down }) => directionName(anatomy, right) + directionName(anatomy, down)), ['LP', 'LI', 'PI']);
  for (const { right, down, normal } of planes) near(cross(right, down), scale(normal, -1));
});

test('a direction has the letters of all axes that it is close to, the nearest first', () => {
  const anatomy = anatomyOf(sagittalScan);
  const turned = (degrees) => [Math.cos(degrees * Math.PI / 180), Math.sin(degrees * Math.PI / 180), 0];
  assert.deepEqual([0, 15, 25, 45, 65, 75, 90, 180, 225].map((degrees) => directionName(anatomy, turned(degrees))), ['L', 'L', 'LP', 'LP', 'PL', 'P', 'P', 'R', 'RA']);
  assert.deepEqual([[1, -1, 1], [-1, 2, 3], [0, 0, -7]].map((v) => directionName(anatomy, v)), ['LAS', 'SP', 'I']);
});

test('without anatomy the vertical slices show z upwards', () => {
  const planes = orthogonalPlanes(new Grid(plain()), frameOf(null), [0, 0, 0]);
  assert.deepEqual(planes.map(({ axis }) => axis), [2, 1, 0]);
  near(planes.flatMap(({ right, down }) => [...right, ...down]), [1, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, -1]);
});

test('an oblique plane moves along its normal through the whole volume, and its point stays inside', () => {
  const grid = new Grid(sagittalScan);
  const start = [-10, 0, 45];
  near(moveAlong(grid, start, [0, 3, 4], dot(start, [0, 0.6, 0.8]) + 2), [-10, 1.2, 46.6]);
  for (const normal of [[1, 2, -3], [-0.2, 1, 0.1], [0, 0, 1]]) {
    const { low, high } = reachAlong(grid, normal);
    for (const part of [0, 0.01, 0.3, 0.7, 0.99, 1]) {
      const wanted = low + part * (high - low);
      const point = moveAlong(grid, start, normal, wanted);
      close(dot(point, normal) / length(normal), wanted);
      near(grid.clamp(point), point);
    }
    close(dot(moveAlong(grid, start, normal, high + 50), normal) / length(normal), high);
    close(dot(moveAlong(grid, start, normal, low - 50), normal) / length(normal), low);
  }
  near(moveAlong(grid, [-10, 0, 900], [1, 0, 0], -12), [-12, 0, 50.5]);
});

test('a pane maps world points to pixels and back, with square world units', () => {
  const grid = new Grid(sagittalScan);
  for (const plane of [...orthogonalPlanes(grid, frameOf(null), [1, 2, 3]), obliquePlane([1, 2, 3], [1, 2, -3])]) {
    const fit = fitPane(grid, plane, [300, 200]);
    const pane = paneOf(plane, { ...fit, size: [300, 200] });
    const world = pane.toWorld(40, 150);
    close(dot(subtract(world, plane.origin), plane.normal), 0);
    near([pane.toPane(world).x, pane.toPane(world).y, pane.toPane(world).depth - pane.toPane(plane.origin).depth], [40, 150, 0]);
    close(length(subtract(pane.toWorld(50, 150), world)), length(subtract(pane.toWorld(40, 160), world)));
    for (const corner of grid.corners()) {
      const { x, y } = pane.toPane(corner);
      compare(Math.min(x, y, 300 - x, 200 - y), '>', 5, 'every corner is inside');
    }
  }
});

test('a pixel of the image lies where the header says, also where axes are flipped and swapped', () => {
  const grid = new Grid(sagittalScan);
  const [axial] = orthogonalPlanes(grid, frameOf(['L', 'P', 'S']), [-10, -3, 46]);
  const meta = { shape: [20, 30], origin: [-30, -10, 46], step_x: [0, 1, 0], step_y: [1.5, 0, 0] };
  const view = { center: [-10, -3, 46], zoom: 4, size: [100, 80] };
  const pane = paneOf(axial, view);
  const [a, b, c, d, e, f] = imageTransform(meta, axial, pane, 4);
  const inPane = (column, row) => [a * (column + 0.5) + c * (row + 0.5) + e, b * (column + 0.5) + d * (row + 0.5) + f];
  for (const [column, row] of [[0, 0], [5, 7], [19, 29]]) {
    const world = add(meta.origin, add(scale(meta.step_x, column), scale(meta.step_y, row)));
    const { x, y } = pane.toPane(world);
    near(inPane(column, row), [x, y]);
    assert.deepEqual(pixelAt(meta, add(world, [0.3, -0.3, 0])), { column, row });
  }
  assert.equal(pixelAt(meta, [-31, -10, 46]), null);
});

test('a plane cuts the picture of another one in a line on both', () => {
  const grid = new Grid(plain());
  const [axial, coronal] = orthogonalPlanes(grid, frameOf(null), [3, 4, 5]);
  const oblique = obliquePlane([2, 9, 9], [1, 1, 0.5]);
  for (const [plane, other] of [[axial, coronal], [axial, oblique], [coronal, oblique], [oblique, axial]]) {
    for (const point of cutLine(plane, other, 100)) {
      close(dot(subtract(point, plane.origin), plane.normal), 0);
      close(dot(subtract(point, other.origin), other.normal), 0);
    }
  }
  assert.equal(cutLine(axial, axial, 1), null);
});

test('turning a normal by a quarter in a pane follows the picture clockwise', () => {
  const [axial] = orthogonalPlanes(new Grid(plain()), frameOf(null), [0, 0, 0]);
  near(turnNormal(axial.right, axial, Math.PI / 2), axial.down);
});

test('the query asks for the sample under the plane, or for as many pixels as help', () => {
  const grid = new Grid(plain());
  const [axial] = orthogonalPlanes(grid, frameOf(null), [3, 4, 21.4]);
  assert.deepEqual(sliceQuery(grid, axial, { center: [0, 0, 0], zoom: 1, size: [9, 9] }), { axis: 2, index: 11 });
  const oblique = obliquePlane([3, 4, 5], [0, 0, 2], [0, 0, 1], [0, 1, 0]);
  assert.deepEqual(sliceQuery(grid, oblique, { center: [1, 1, 0], zoom: 1, size: [40, 20] }),
    { origin: '1,1,5', normal: '0,0,1', up: '0,1,0', size: '40,20', spacing: 1 });
  assert.equal(sliceQuery(grid, oblique, { center: [1, 1, 5], zoom: 100, size: [400, 200] }).size, '8,4');
  assert.equal(sliceQuery(grid, oblique, { center: [1, 1, 5], zoom: 1, size: [4000, 2000] }).size, '1024,512');
});

test('slices of a volume that is larger than memory follow its finest samples, and have the pixels that help', () => {
  const grid = finestGrid(plain({ dims: [5, 10, 15], spacing: [2, 2, 4], origin: [0.5, 0.5, 1],
    whole: { dims: [10, 20, 30], spacing: [1, 1, 2], origin: [0, 0, 0] } }));
  assert.deepEqual([0, 1, 2].map((axis) => grid.count(axis)), [10, 20, 30]);
  assert.equal(grid.index(2, [3, 4, 21.4]), 11);
  const [axial] = orthogonalPlanes(grid, frameOf(null), [3, 4, 22]);
  assert.deepEqual(sliceQuery(grid, axial, { center: [4, 9, 22], zoom: 0.5, size: [10, 20] }),
    { origin: '4,9,22', normal: '0,0,-1', up: '0,-1,0', size: '10,20', spacing: 2 });
  assert.deepEqual(finestGrid(plain()).volume.dims, [10, 20, 30]);
});

test('values become grey in a window, and what is not a number stays transparent', () => {
  const bytes = new Float32Array([-5, 0, 49.9, 50, 100, NaN]).buffer;
  const slice = readSlice(JSON.stringify({ shape: [3, 2], type: 'float32', endianness: 'little' }), bytes);
  close(valueAt(slice, { column: 0, row: 1 }), 50);
  const pixels = new Uint32Array(6);
  paintSlice(slice.values, { center: 50, width: 100 }, pixels);
  assert.deepEqual([...pixels].map((px) => [px & 255, px >>> 24]), [[0, 255], [0, 255], [127, 255], [128, 255], [255, 255], [0, 0]]);
  paintSlice(slice.values, { center: 50, width: 100 }, pixels, shadesOf((at) => [1, at, 0]));
  assert.deepEqual([...pixels].map((px) => [px & 255, px >>> 8 & 255, px >>> 16 & 255]), [[255, 0, 0], [255, 0, 0], [255, 127, 0], [255, 128, 0], [255, 255, 0], [0, 0, 0]]);
  for (const header of [null, '{}', '{"shape":[3,2],"type":"float64","endianness":"little"}', '{"shape":[3,2],"type":"float32","endianness":"big"}']) {
    assert.throws(() => readSlice(header, bytes), /not a slice/);
  }
});

test('slices show values in grey or a map over the window, or as the transfer function whatever the window', () => {
  const window = { center: 50, width: 100 };
  const points = [{ value: 0, color: [1, 0, 0], opacity: 0 }, { value: 1000, color: [0, 0, 1], opacity: 0.1 }];
  const paint = (colors, values, some = points) => {
    const pixels = new Uint32Array(values.length);
    const look = lookOf(colors, window, some);
    paintSlice(new Float32Array(values), look.window, pixels, look.shades);
    return [...pixels].map((pixel) => (pixel >>> 0).toString(16));
  };
  assert.equal(lookOf('grey', window, points).shades, GREYS);
  assert.deepEqual(paint('viridis', [-9, 0, 100, 900, NaN]), ['ff540144', 'ff540144', 'ff25e7fd', 'ff25e7fd', '0']);
  assert.deepEqual(paint('transfer_function', [-9, 0, 1000, 2000]), ['ff0000ff', 'ff0000ff', 'ffff0000', 'ffff0000']);
  assert.deepEqual(paint('transfer_function', [-9, 5], points.slice(0, 1)), ['ff0000ff', 'ff0000ff']);
});

test('the daemon draws slices in the picture with the same maps', () => {
  const source = readFileSync(new URL('../../../renderer/data/volume/slice_colors.c', import.meta.url), 'utf8');
  for (const name of MAP_NAMES.filter((one) => one !== 'grey')) {
    const found = new RegExp(`SP_SLICE_${name.toUpperCase().replace('-', '_')}\\] = \\{([^}]*)\\}`).exec(source)[1];
    const colors = found.match(/[0-9a-f]{6}/g).map((text) => [0, 2, 4].map((at) => parseInt(text.slice(at, at + 2), 16) / 255));
    assert.deepEqual(colors, tableOf(name).map(([, color]) => color), name);
  }
});

test('the light of channels adds up: red and green give yellow', () => {
  const pixels = new Uint32Array(3);
  const window = { center: 50, width: 100 };
  paintChannels([
    { values: new Float32Array([0, 100, 100]), window, shades: shadesOf((at) => [at, 0, 0]) },
    { values: new Float32Array([100, 100, NaN]), window, shades: shadesOf((at) => [0, Math.max(at, 0.5), 0]) },
  ], pixels);
  assert.deepEqual([...pixels].map((px) => [px & 255, px >>> 8 & 255, px >>> 16 & 255, px >>> 24]), [[0, 255, 0, 255], [255, 255, 0, 255], [255, 0, 0, 255]]);
});
