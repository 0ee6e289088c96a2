// SPDX-License-Identifier: Apache-2.0
// Saved pictures and saved views: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/capture.js';
import { install as capture } from '../capture/capture.js';
import { install as savedViews } from '../views/saved_views.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
/** In the order of installation. */
export const features = [capture, savedViews];
export const build = 'BUILD_OF_THE_PAGE';
