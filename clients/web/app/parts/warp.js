// SPDX-License-Identifier: Apache-2.0
// Modules that the page and <splat-view> load after the first image (../frames/warp.js). They warp frames by depth, and fade in sharper frames.
export { DepthWarp } from '../frames/depth_warp.js';
export { Fade } from '../frames/fade.js';
