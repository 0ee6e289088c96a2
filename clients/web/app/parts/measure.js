// SPDX-License-Identifier: Apache-2.0
// Measurements: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/measure.js';
import { install as measures } from '../measure/measures.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
export const features = [measures];
export const build = 'BUILD_OF_THE_PAGE';
