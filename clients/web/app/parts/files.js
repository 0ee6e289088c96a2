// SPDX-License-Identifier: Apache-2.0
// The dialog "Open", uploads, and files of transfer functions: a part that loads on demand, see ../shell/announcer.js.
import english from '../../text/en/files.js';
import { install as open } from '../volumes/open.js';
import { install as uploads } from '../volumes/uploads.js';
import { install as transferFiles } from '../transfer/transfer_files.js';
import '../main.js'; // runs already: this import makes the build put all that both need into one chunk

export const texts = english;
/** In the order of installation. */
export const features = [transferFiles, open, uploads];
export const build = 'BUILD_OF_THE_PAGE';
