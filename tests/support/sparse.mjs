// SPDX-License-Identifier: Apache-2.0
// Writes large volumes of uint8 that are empty almost everywhere: NRRD files with holes. They take little time and space.
import { closeSync, ftruncateSync, openSync, writeSync } from 'node:fs';

/** Reproducible numbers in [0, 1). */
function numbers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/** A vessel along axis 0: its centre and radius at sample x [voxels]. Its shape does not depend on `side`, only its size does. */
function makeVessel(side, random) {
  const swing = () => {
    const [at, width, periods, phase] = [0.15 + 0.7 * random(), 0.02 + 0.04 * random(), 1 + 1.5 * random(), 2 * Math.PI * random()];
    return (u) => side * (at + width * Math.sin(2 * Math.PI * periods * u + phase));
  };
  const [y, z, radius] = [swing(), swing(), side / 256 * (0.7 + 0.6 * random())];
  return (x) => ({ x, y: y(x / side), z: z(x / side), radius });
}

/** The columns that each slice cuts, so that slices can be drawn one after the other. */
function sortBySlice(side, vessels) {
  const slices = Array.from({ length: side }, () => []);
  for (const vessel of vessels)
    for (let x = 0; x < side; x++) {
      const disc = vessel(x);
      for (let z = Math.max(0, Math.ceil(disc.z - disc.radius)); z <= Math.min(side - 1, disc.z + disc.radius); z++) slices[z].push(disc);
    }
  return slices;
}

/** Draws a column of a disc into the rows of a slice. A texture keeps the samples from being packed too well. */
function drawColumn(rows, side, z, disc) {
  const dz = z - disc.z;
  const half = Math.sqrt(disc.radius ** 2 - dz ** 2);
  for (let y = Math.max(0, Math.ceil(disc.y - half)); y <= Math.min(side - 1, disc.y + half); y++) {
    const depth = 1 - ((y - disc.y) ** 2 + dz ** 2) / disc.radius ** 2;
    const texture = (Math.imul(disc.x * 73856093 ^ y * 19349663 ^ z * 83492791, 0x9e3779b1) >>> 28) - 8;
    if (!rows.has(y)) rows.set(y, Buffer.alloc(side));
    const row = rows.get(y);
    row[disc.x] = Math.max(row[disc.x], Math.min(255, Math.max(1, Math.round(40 + 200 * depth + texture))));
  }
}

/** Writes `count` winding vessels in side³ samples; the rows without matter are holes. Returns the bytes of the rows with matter, and a point on a vessel. */
export function writeVessels(file, side, count) {
  const header = Buffer.from(`NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n`);
  const start = 4096; // samples begin at a block of the file, so that its holes are whole rows
  const fd = openSync(file, 'w');
  let bytes = 0;
  const random = numbers(7);
  const vessels = Array.from({ length: count }, () => makeVessel(side, random));
  const slices = sortBySlice(side, vessels);
  writeSync(fd, Buffer.concat([header, Buffer.from(`# ${' '.repeat(start - header.length - 4)}\n\n`)]), 0, start, 0);
  ftruncateSync(fd, start + side ** 3);
  slices.forEach((discs, z) => {
    const rows = new Map();
    for (const disc of discs) drawColumn(rows, side, z, disc);
    for (const [y, row] of rows) writeSync(fd, row, 0, side, start + (z * side + y) * side);
    bytes += rows.size * side;
  });
  closeSync(fd);
  const { x, y, z } = vessels[0](side / 2);
  return { bytes, point: [x, y, z] };
}
