// SPDX-License-Identifier: Apache-2.0
// Frames as the newest camera sees them, by their depth: what the page and <splat-view> load after the first image (../frames/warp.js).
export { DepthWarp } from '../frames/depth_warp.js';
