// SPDX-License-Identifier: Apache-2.0
// Camera paths: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/paths.js';
import { install as paths } from '../paths/paths.js';
import { install as keyframes } from '../paths/keyframes.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
/** In the order of installation. */
export const features = [paths, keyframes];
export const build = 'BUILD_OF_THE_PAGE';
