// SPDX-License-Identifier: Apache-2.0
// Starts the page: its language, the shared parts (app.js), and the features. To add a feature, write a module with install(app) and add
// it to the list.
import { chooseLanguage, useTexts } from '../core/text.js';
import english from '../text/en.js';
import { createApp } from './app.js';
import * as camera from './camera.js';
import * as capture from './capture.js';
import * as channels from './channels.js';
import * as clip from './clip.js';
import * as colorBar from './color_bar.js';
import * as compare from './compare.js';
import * as connectionBanner from './connection_banner.js';
import { showTexts } from './dom.js';
import * as edits from './edits.js';
import * as formats from './formats.js';
import * as frames from './frames.js';
import * as gradient from './gradient.js';
import * as input from './input.js';
import * as inspect from './inspect.js';
import * as savedViews from './saved_views.js';
import * as kinds from './kinds.js';
import * as keyframes from './keyframes.js';
import * as layers from './layers.js';
import * as measures from './measures.js';
import * as open from './open.js';
import * as orientation from './orientation.js';
import * as paths from './paths.js';
import * as people from './people.js';
import * as pick from './pick.js';
import * as picture from './picture.js';
import * as plates from './plates.js';
import * as presets from './presets.js';
import * as scaleBar from './scale_bar.js';
import * as session from './session.js';
import * as sheet from './sheet.js';
import * as status from './status.js';
import * as slices from './slices.js';
import * as statusPanel from './status_panel.js';
import * as stream from './stream.js';
import * as theme from './theme.js';
import * as time from './time.js';
import * as transfer from './transfer.js';
import * as transferFiles from './transfer_files.js';
import * as transferKinds from './transfer_kinds.js';
import * as transferMaps from './transfer_maps.js';
import * as uploads from './uploads.js';
import * as views from './views.js';
import * as volumes from './volumes.js';
import * as walk from './walk.js';
import * as warp from './warp.js';
import * as windowLevel from './window_level.js';
import * as zoomBox from './zoom_box.js';

/** In the order of installation; listeners of the same event run in this order. */
const FEATURES = [
  theme, kinds, frames, warp, status, stream, formats, connectionBanner, session, input, plates, sheet, pick,
  orientation, scaleBar, views, zoomBox, walk, camera, clip,
  picture, time, transfer, transferKinds, transferMaps, gradient, transferFiles, windowLevel, slices, layers, channels, measures, edits,
  open, uploads, volumes, presets, paths, keyframes, people, statusPanel, capture, compare, colorBar, savedViews, inspect,
];

async function start() {
  const asked = new URLSearchParams(location.search).get('lang');
  const language = chooseLanguage(asked ? [asked] : navigator.languages);
  useTexts(english);
  if (language !== 'en') useTexts((await import(`../text/${language}.js`)).default);
  document.documentElement.lang = language;
  showTexts(document);

  const app = createApp(new URL('.', location.href).href);
  app.connection.prepare();
  window.addEventListener('error', ({ error, message }) => app.report(error ?? message));
  window.addEventListener('unhandledrejection', ({ reason }) => app.report(reason));
  for (const { install } of FEATURES) install(app);
  app.connection.start();
}

start();
