// SPDX-License-Identifier: Apache-2.0
// How much of the full detail a picture has, in percent of what can be told apart along a side: half the size, or
// 2×2×2 voxels drawn as one, is 50. frame: {width, height, isFinal}; wanted: [width, height] that was asked for;
// coarse: of stream.stats, a little older than the picture.

export function detailPercent(frame, wanted, coarse = 0) {
  if (frame.isFinal) return 100;
  const side = Math.min(1, frame.width / wanted[0], frame.height / wanted[1]);
  return Math.max(1, Math.round(100 * side / 2 ** coarse));
}
