// SPDX-License-Identifier: Apache-2.0
// A sheet with several heights that a drag changes.

/** A shorter movement in px is no decision: the sheet returns. */
const DECIDED_PX = 24;

/**
 * The height of a released sheet: an index of `heights` in px, rising. It was at heights[from], and was dragged to `px`. A drag goes to the
 * next height at least, so that a short swipe is enough, and otherwise to the nearest in its direction.
 */
export function settle(heights, from, px) {
  const moved = px - heights[from];
  if (Math.abs(moved) < DECIDED_PX) return from;
  const ahead = heights.map((_, i) => i).filter((i) => (moved > 0 ? i > from : i < from));
  return ahead.reduce((best, i) => (Math.abs(heights[i] - px) < Math.abs(heights[best] - px) ? i : best), ahead[0] ?? from);
}
