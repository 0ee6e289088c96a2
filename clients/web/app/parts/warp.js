// SPDX-License-Identifier: Apache-2.0
// What the page and <splat-view> load after the first image (../frames/warp.js): frames as the newest camera sees them, by their depth, and frames
// that replace coarser ones gradually.
export { DepthWarp } from '../frames/depth_warp.js';
export { Fade } from '../frames/fade.js';
