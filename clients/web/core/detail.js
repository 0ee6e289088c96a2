// SPDX-License-Identifier: Apache-2.0
// The detail of a frame in percent of the full resolution along a side: half the size, or 2×2×2 voxels drawn as one, is 50.
// frame: {width, height, isFinal, isIncomplete}; wanted: the requested [width, height]; coarse and bricks: from stream.stats, which may be slightly
// older than the frame; pixels: of the screen, which may have more than the page requests.

export function detailPercent(frame, wanted, coarse = 0, pixels = wanted, bricks = null) {
  const [width, height] = frame.isFinal ? wanted : [frame.width, frame.height];
  const side = Math.min(1, width / pixels[0], height / pixels[1]);
  const level = frame.isIncomplete && bricks ? Math.max(0, bricks.level - bricks.asked) : 0;
  return Math.max(1, Math.round(100 * side / 2 ** ((frame.isFinal ? 0 : coarse) + level)));
}

/**
 * Why a frame of a volume that is larger than memory shows less than its pixels ask for: 'holes' (bricks cannot be read), 'memory'
 * (finer samples do not fit), 'reading' (they are being read); null = it shows all of it.
 */
export function shortageOf(frame, bricks) {
  if (!frame?.isIncomplete || !bricks) return null;
  if (bricks.lost > 0) return 'holes';
  return frame.isFinal && bricks.level > bricks.asked ? 'memory' : 'reading';
}
