// SPDX-License-Identifier: Apache-2.0
// A volume for measurements in pictures: a solid block in air, as an NRRD file with millimetres and anatomical directions.
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';

/** Samples of the volume and of the block in its middle, along x (to the left), y (to the back) and z (to the head). Spacing 1 mm. */
export const DIMS = [100, 60, 40];
export const BLOCK = [80, 40, 20];

/** Writes the file; remove() deletes it. */
export function writeBlock({ isAnatomical = true } = {}) {
  const [nx, ny, nz] = DIMS;
  const samples = Buffer.alloc(nx * ny * nz);
  const isInside = (i, axis) => Math.abs(i - (DIMS[axis] - 1) / 2) < BLOCK[axis] / 2;
  for (let z = 0; z < nz; z += 1) {
    for (let y = 0; y < ny; y += 1) {
      for (let x = 0; x < nx; x += 1) if (isInside(x, 0) && isInside(y, 1) && isInside(z, 2)) samples[(z * ny + y) * nx + x] = 200;
    }
  }
  const space = isAnatomical ? 'space: left-posterior-superior' : 'space dimension: 3';
  const head = ['NRRD0005', 'type: uint8', 'dimension: 3', space, `sizes: ${DIMS.join(' ')}`, 'space directions: (1,0,0) (0,1,0) (0,0,1)',
    'space origin: (0,0,0)', 'space units: "mm" "mm" "mm"', 'encoding: raw', 'endian: little', '', ''].join('\n');
  const folder = mkdtempSync(path.join(tmpdir(), 'splatd-block-'));
  const file = path.join(folder, 'block.nrrd');
  writeFileSync(file, Buffer.concat([Buffer.from(head), samples]));
  return { file, folder, remove: () => rmSync(folder, { recursive: true }) };
}

/** The rectangle {left, top, width, height} in px of what is brighter than the background, and the share of the image that it covers. */
export function lit({ width, height, at }, least = 60) {
  let [left, right, top, bottom, count] = [width, -1, height, -1, 0];
  for (let y = 0; y < height; y += 1) {
    for (let x = 0; x < width; x += 1) {
      if (Math.max(...at(x, y)) < least) continue;
      count += 1;
      left = Math.min(left, x);
      right = Math.max(right, x);
      top = Math.min(top, y);
      bottom = Math.max(bottom, y);
    }
  }
  return { left, top, width: right - left + 1, height: bottom - top + 1, part: count / (width * height) };
}
