// SPDX-License-Identifier: Apache-2.0
// Clipping and edits of the volume: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/clip.js';
import { install as clip } from '../clip/clip.js';
import { install as edits } from '../edits/edits.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
/** In the order of installation. */
export const features = [clip, edits];
export const build = 'BUILD_OF_THE_PAGE';
