// SPDX-License-Identifier: Apache-2.0
// The features that the page loads after the first image, see shell/announcer.js. To add one, write a module with install(app), add it to
// the list, and announce its button, its keys and its section in announce.js.
import { useTexts } from '../core/text.js';
import english from '../text/en/later.js';
import { showTexts } from './controls/dom.js';
import * as capture from './capture/capture.js';
import * as compare from './compare/compare.js';
import * as edits from './edits/edits.js';
import * as measures from './measure/measures.js';
import * as keyframes from './paths/keyframes.js';
import * as paths from './paths/paths.js';
import * as transferFiles from './transfer/transfer_files.js';
import * as savedViews from './views/saved_views.js';
import * as open from './volumes/open.js';
import * as uploads from './volumes/uploads.js';
import './main.js'; // runs already: this import makes the build put all that both need into one chunk

/** In the order of installation; listeners of the same event run in this order. */
const FEATURES = [transferFiles, measures, edits, open, uploads, paths, keyframes, capture, compare, savedViews];

export function install(app) {
  useTexts(english);
  showTexts(document, (key) => Object.hasOwn(english, key)); // others have changed since the page began
  for (const feature of FEATURES) feature.install(app);
}
