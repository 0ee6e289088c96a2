// SPDX-License-Identifier: Apache-2.0
// The slices: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/slices.js';
import { install as slices } from '../slices/slices.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
export const features = [slices];
export const build = 'BUILD_OF_THE_PAGE';
