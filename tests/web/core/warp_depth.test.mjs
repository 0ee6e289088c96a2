// SPDX-License-Identifier: Apache-2.0
// Frames drawn by their depth: the matrix against projected points, and the pixels against a ball that is drawn from the other camera.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { add, cross, dot, normalize, scale, subtract } from '../../../clients/web/core/vector.js';
import { depthMatrix } from '../../../clients/web/core/warp_depth.js';
import { PixelWarp } from '../../../clients/web/core/warp_pixels.js';
import { compare } from '../../support/compare.mjs';

const perspective = (position, more = {}) => ({ projection: 'perspective', position, target: [0, 0, 0], up: [0, 1, 0], fov_y: 40, ...more });
const orthographic = (position, more = {}) => ({ projection: 'orthographic', position, target: [0, 0, 0], up: [0, 1, 0], height: 3, ...more });

/** The place of a point in the image of a camera, [x, y] in [-1, 1], its depth, and the ray of a place. */
function optics(camera, aspect) {
  const forward = normalize(subtract(camera.target, camera.position));
  const right = normalize(cross(forward, camera.up));
  const up = cross(right, forward);
  const isFlat = camera.projection === 'orthographic';
  const half = isFlat ? camera.height / 2 : Math.tan(camera.fov_y * Math.PI / 360);
  return {
    project: (point) => {
      const [x, y, z] = [right, up, forward].map((axis) => dot(axis, subtract(point, camera.position)));
      const unit = half * (isFlat ? 1 : z);
      return { x: x / unit / aspect, y: y / unit, depth: z };
    },
    ray: ([x, y]) => {
      const aside = add(scale(right, x * half * aspect), scale(up, y * half));
      return isFlat ? { from: add(camera.position, aside), along: forward } : { from: camera.position, along: add(forward, aside) };
    },
  };
}

/** v of a depth, as the daemon quantises it, without the rounding. */
const valueOf = (depth, { camera, near, far }) => {
  const of = (z) => (camera.projection === 'orthographic' ? -z : 1 / z);
  return (1 + 254 * (of(depth) - of(far)) / (of(near) - of(far))) / 255;
};

const apply = (m, [x, y, v]) => [0, 1, 2, 3].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * v + m[12 + row]);

for (const [name, from, to] of [
  ['perspective', perspective([0.5, 0.3, 4]), perspective([1.5, 1, 3.5], { fov_y: 55 })],
  ['orthographic', orthographic([0.5, 0.3, 4]), orthographic([1.5, 1, 3.5], { height: 2 })],
  ['from perspective to orthographic', perspective([0.5, 0.3, 4]), orthographic([1, 1, 3])],
  ['far from the origin of the world', perspective([1e5 + 3, 1e5, 2e5 + 4], { target: [1e5, 1e5, 2e5] }), perspective([1e5 + 2, 1e5 + 1, 2e5 + 4], { target: [1e5, 1e5, 2e5] })],
]) {
  test(`points of a frame land where the other camera sees them: ${name}`, () => {
    const frame = { camera: from, near: 2, far: 7, aspect: 1.5 };
    const [source, target] = [optics(from, 1.5), optics(to, 0.8)];
    const matrix = depthMatrix(frame, to, 0.8);
    const places = [[0.2, 0.3, -0.4], [-0.8, 0.5, 0.6], [0.1, -0.9, 0]];
    const depths = places.map((aside) => {
      const point = add(from.target, aside);
      const { x, y, depth } = source.project(point);
      const wanted = target.project(point);
      const [X, Y, Z, W] = apply(matrix, [x, y, valueOf(depth, frame)]);
      compare(Math.hypot(X / W - wanted.x, Y / W - wanted.y), '<', 1e-4);
      compare(Math.abs(Z / W), '<', 1);
      return [Z / W, wanted.depth];
    }).sort((a, b) => a[1] - b[1]);
    for (let i = 1; i < depths.length; i += 1) compare(depths[i][0], '>', depths[i - 1][0], 'farther points lie behind');
  });
}

/** A ball of radius 1 with a pattern, over a black background: its px and its depth in cells; isInner: of px that do not lie near its outline. */
function drawBall(camera, [width, height]) {
  const { ray, project } = optics(camera, width / height);
  const hit = ([x, y]) => {
    const { from, along } = ray([2 * x / width - 1, 1 - 2 * y / height]);
    const [a, b, c] = [dot(along, along), dot(from, along), dot(from, from) - 1];
    const root = b * b - a * c;
    return root < 0 ? null : add(from, scale(along, (-b - Math.sqrt(root)) / a));
  };
  const pixels = new Int32Array(width * height);
  const isInner = new Uint8Array(width * height);
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      const point = hit([x + 0.5, y + 0.5]);
      const [r, g, b] = point ? point.map((t, i) => Math.round(128 + 100 * Math.sin((9 + 2 * i) * t))) : [0, 0, 0];
      const sight = normalize(subtract(camera.position, camera.projection === 'orthographic' ? camera.target : point ?? [0, 0, 0]));
      isInner[y * width + x] = Number(Boolean(point) && dot(point, sight) > 0.6);
      pixels[y * width + x] = r | (g << 8) | (b << 16) | (255 << 24);
    }
  }
  const cells = [width, height].map((side) => Math.ceil(side / 4));
  const depths = Array.from({ length: cells[0] * cells[1] }, (_, i) => {
    const point = hit([4 * (i % cells[0]) + 2, 4 * Math.floor(i / cells[0]) + 2]);
    return point && project(point).depth;
  });
  const known = depths.filter((depth) => depth !== null);
  const [near, far] = [Math.min(...known), Math.max(...known)];
  const values = Uint8Array.from(depths, (depth) => (depth === null ? 0 : Math.round(255 * valueOf(depth, { camera, near, far }))));
  return { pixels, isInner, width, height, values, cells, camera, near, far, aspect: width / height };
}

const BLACK = 255 << 24;

/** dB between two images, over the px of `where`. */
function psnr(a, b, where) {
  let [sum, count] = [0, 0];
  a.forEach((px, i) => {
    if (!where[i]) return;
    for (const shift of [0, 8, 16]) sum += (((px >>> shift) & 255) - ((b[i] >>> shift) & 255)) ** 2;
    count += 3;
  });
  return 10 * Math.log10(255 ** 2 * count / sum);
}

const SIZE = [200, 160];
const INNER = 45; // dB

/** What a PixelWarp makes of a ball for another camera, and the ball as that camera sees it. */
function warpBall(from, to, size = SIZE) {
  const warp = new PixelWarp();
  warp.take(drawBall(from, SIZE));
  const out = new Int32Array(size[0] * size[1]).fill(1);
  assert.ok(warp.draw(to, out, size, BLACK));
  const truth = drawBall(to, size);
  return { out, truth: truth.pixels, inner: truth.isInner, ball: truth.pixels.map((px) => Number(px !== BLACK)) };
}

const turned = (degrees, distance = 4) => [distance * Math.sin(degrees * Math.PI / 180), 0, distance * Math.cos(degrees * Math.PI / 180)];

test('the camera of the frame sees the frame', () => {
  const { out, truth, ball } = warpBall(perspective(turned(0)), perspective(turned(0)));
  compare(psnr(out, truth, ball), '>', 36);
});

for (const [name, from, to, least] of [
  ['a turn of 4 degrees', perspective(turned(0)), perspective(turned(4)), INNER],
  ['a turn of 4 degrees, orthographic', orthographic(turned(0)), orthographic(turned(4)), INNER],
  ['a turn that also rolls', perspective(turned(0)), perspective(turned(4), { up: [0.1, 1, 0] }), INNER],
  ['a step towards the ball', perspective(turned(0)), perspective(turned(0, 3.4)), INNER],
  ['a step back', perspective(turned(0)), perspective(turned(0, 4.6)), INNER],
  ['a pan', perspective(turned(0)), perspective([0.3, 0.1, 4], { target: [0.3, 0.1, 0] }), INNER],
]) {
  test(`the ball after ${name} is near to what that camera sees`, () => {
    const { out, truth, inner, ball } = warpBall(from, to);
    const plain = drawBall(from, SIZE).pixels;
    compare(psnr(out, truth, inner), '>', least, 'px that do not lie near the outline');
    compare(psnr(out, truth, ball), '>', 4 + psnr(plain, truth, ball), 'the whole ball is nearer by far than in the frame as it is');
  });
}

test('an object that fills the frame also fills the picture after a pan: beyond the border of the frame it goes on', () => {
  const { out } = warpBall(perspective([0, 0, 1.35]), perspective([0.06, 0.04, 1.35], { target: [0.06, 0.04, 0] }));
  assert.equal(out.filter((px) => px === BLACK).length, 0);
});

test('a picture may have another size and shape than the frame', () => {
  const { out, truth, inner } = warpBall(perspective(turned(0)), perspective(turned(2)), [331, 217]);
  compare(psnr(out, truth, inner), '>', 40);
});

test('what shows nothing stays background', () => {
  const { out, truth } = warpBall(perspective(turned(0)), perspective(turned(6)));
  const corner = 20;
  for (let y = 0; y < corner; y += 1) for (let x = 0; x < corner; x += 1) assert.equal(out[y * SIZE[0] + x], BLACK);
  let stray = 0;
  out.forEach((px, i) => { stray += Number(px !== BLACK && truth[i] === BLACK); });
  compare(stray, '<', 0.03 * SIZE[0] * SIZE[1], 'only px beside the outline');
});

test('a picture that is drawn over another one is the same as a fresh one, and its box holds all that is not background', () => {
  const frame = drawBall(perspective(turned(0)), SIZE);
  const [over, fresh] = [new PixelWarp(), new PixelWarp()];
  for (const warp of [over, fresh]) warp.take(frame);
  const out = new Int32Array(SIZE[0] * SIZE[1]).fill(1);
  for (const [degrees, ground] of [[5, BLACK], [-5, BLACK], [2, 0x102030 | BLACK]]) {
    const camera = perspective(turned(degrees), { target: [0.5 * Math.sign(degrees), 0, 0] });
    const box = over.draw(camera, out, SIZE, ground);
    const expected = new Int32Array(out.length);
    fresh.draw(camera, expected, SIZE, ground);
    assert.deepEqual(out, expected);
    out.forEach((px, i) => {
      const [x, y] = [i % SIZE[0], Math.floor(i / SIZE[0])];
      if (px !== ground) assert.ok(x >= box.left && x < box.right && y >= box.top && y < box.bottom, `px ${x}, ${y} lies in the box`);
    });
    compare((box.right - box.left) * (box.bottom - box.top), '<', 0.8 * out.length, 'the box is smaller than the picture');
  }
});

test('a frame that shows nothing gives background', () => {
  const frame = { ...drawBall(perspective(turned(0)), SIZE), values: new Uint8Array(50 * 40) };
  const warp = new PixelWarp();
  warp.take(frame);
  const out = new Int32Array(SIZE[0] * SIZE[1]);
  warp.draw(perspective(turned(5)), out, SIZE, BLACK);
  assert.ok(out.every((px) => px === BLACK));
});

test('what was hidden takes what lies behind it, not what hid it', () => {
  // A near red stripe over a far blue wall. From aside, the part of the wall beside the stripe was hidden.
  const [width, height] = [160, 120];
  const cells = [40, 30];
  const camera = perspective([0, 0, 10]);
  const isNear = (x) => x >= 60 && x < 100;
  const pixels = new Int32Array(width * height).map((_, i) => (isNear(i % width) ? 0xff : 0xff0000) | BLACK);
  const values = new Uint8Array(1200).map((_, i) => (isNear(4 * (i % 40)) ? 255 : 1));
  const warp = new PixelWarp();
  warp.take({ pixels, width, height, values, cells, camera, near: 5, far: 10, aspect: width / height });
  const out = new Int32Array(width * height);
  warp.draw(perspective([1, 0, 10], { target: [1, 0, 0] }), out, [width, height], BLACK);
  const row = Array.from(out.subarray(60 * width, 61 * width), (px) => px & 0xffffff);
  const red = row.filter((px) => px === 0xff).length;
  compare(Math.abs(red - 40), '<=', 6, `the stripe keeps its width: ${red} px`);
  const other = row.filter((px) => px !== 0xff && px !== 0xff0000 && px !== 0);
  compare(other.length, '<=', 12, 'and all else is wall, but for the seams');
});
