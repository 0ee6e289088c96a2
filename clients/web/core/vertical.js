// SPDX-License-Identifier: Apache-2.0
// Coordinates as a file gives them. Where the daemon scaled axis z, because its unit, such as hPa, has no length in the unit of x, `vertical` of the
// volume tells the numbers of the file: world z = per_unit · number.
import { numberText, roundCoordinate, unitName } from './lengths.js';

const scaleOf = (volume, axis) => (axis === 2 && volume?.vertical?.per_unit ? volume.vertical.per_unit : 1);

/** The number of the file at a coordinate of a world axis (0 to 2; others have no numbers of their own), and the reverse. */
export const ownFrom = (volume, axis, world) => world / scaleOf(volume, axis);
export const worldFrom = (volume, axis, own) => own * scaleOf(volume, axis);

/** The unit of the numbers along a world axis; '' = unknown. */
export const unitAlong = (volume, axis) => unitName(axis === 2 && volume?.vertical ? volume.vertical.unit : volume?.unit);

/** The number of the file at a coordinate, rounded to a thousandth of `extent` [world unit]. */
export const roundedAlong = (volume, axis, world, extent) => roundCoordinate(ownFrom(volume, axis, world), Math.abs(ownFrom(volume, axis, extent)));

/** Three numbers with one unit, or with the unit of x and y and then the unit of z: {numbers: '1 × 2', unit: 'mm'}, {numbers: '1 × 2 degrees × 3', unit: 'hPa'}. */
function join(volume, [x, y, z], separator) {
  const [flat, unit] = [0, 2].map((axis) => unitAlong(volume, axis));
  const xy = `${x}${separator}${y}`;
  return { numbers: `${volume?.vertical ? `${xy} ${flat}`.trim() : xy}${separator}${z}`, unit };
}

/** A position as {place, unit} for a text "{place} {unit}". */
export function placeOf(volume, position, extent) {
  const { numbers, unit } = join(volume, position.map((part, axis) => numberText(roundedAlong(volume, axis, part, extent))), ', ');
  return { place: numbers, unit };
}

/** Lengths along the axes as {numbers, unit}. toText: of a number. */
export const sizesOf = (volume, sizes, toText) => join(volume, sizes.map((size, axis) => toText(Math.abs(ownFrom(volume, axis, size)))), ' × ');
