// SPDX-License-Identifier: Apache-2.0
// The comparison of two views: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/compare.js';
import { install as compare } from '../compare/compare.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
export const features = [compare];
export const build = 'BUILD_OF_THE_PAGE';
