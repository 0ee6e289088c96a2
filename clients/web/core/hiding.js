// SPDX-License-Identifier: Apache-2.0
// Whether streaks can be seen inside of the samples that they lie in.
import { extent } from './camera.js';
import { opacityAt } from './transfer.js';

const HIDDEN = 3; // optical depth in front of the middle: 5 % of the light passes

/** Estimates the optical depth from the border of the visible matter to its middle. Uses the histogram, as if all visible samples formed one body. */
function depthOf({ points, reference_length: unit }, { range: [low, high], counts }, volume) {
  const total = counts.reduce((sum, count) => sum + count, 0);
  let seen = 0;
  let extinction = 0;
  counts.forEach((count, bin) => {
    const opacity = opacityAt(points, low + ((high - low) * (bin + 0.5)) / counts.length);
    if (opacity > 0) seen += count;
    extinction -= count * Math.log1p(-opacity);
  });
  const thinnest = Math.min(...[0, 1, 2].map((axis) => extent(volume, axis)).map(([first, last]) => last - first));
  return seen > 0 ? ((extinction / seen) * Math.cbrt(seen / total) * thinnest) / 2 / unit : 0;
}

/** True if a view shows streaks among samples that hide nearly all of them. histogram, volume: of the view, or null. */
export function hidesStreaks({ layers = [], transfer_function: transfer }, histogram, volume) {
  const shows = (wanted, own = true) => layers.some(({ type, visible = true, id = '' }) => type === wanted && visible && !(own && id));
  if (!histogram || !volume?.dims || !transfer?.points?.length || !shows('vectors')) return false;
  return (shows('volume') || shows('points')) && depthOf(transfer, histogram, volume) > HIDDEN;
}
