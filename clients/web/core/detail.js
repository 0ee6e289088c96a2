// SPDX-License-Identifier: Apache-2.0
// The detail of a frame in percent of the full resolution along a side: half the size, or 2×2×2 voxels drawn as one, is 50.
// frame: {width, height, isFinal}; wanted: the requested [width, height]; coarse: the mip level of stream.stats, which may
// be slightly older than the frame; pixels: those of the screen, which may be more than the page requests.

export function detailPercent(frame, wanted, coarse = 0, pixels = wanted) {
  const [width, height] = frame.isFinal ? wanted : [frame.width, frame.height];
  const side = Math.min(1, width / pixels[0], height / pixels[1]);
  return Math.max(1, Math.round(100 * side / 2 ** (frame.isFinal ? 0 : coarse)));
}
