// SPDX-License-Identifier: Apache-2.0
// Starts the page: its language, the shared parts (shell/app.js), and the features that the first image needs; later.js has the others. To add a
// feature, write a module with install(app) and add it to one of the lists.
import { chooseLanguage, translate, useTexts } from '../core/text.js';
import page from '../text/en/page.js';
import panel from '../text/en/panel.js';
import * as announce from './announce.js';
import { createApp } from './shell/app.js';
import * as camera from './camera/camera.js';
import * as channels from './channels/channels.js';
import * as clip from './clip/clip.js';
import * as colorBar from './annotations/color_bar.js';
import * as connectionBanner from './session/connection_banner.js';
import { showTexts } from './controls/dom.js';
import * as formats from './frames/formats.js';
import * as frames from './frames/frames.js';
import * as gradient from './transfer/gradient.js';
import * as input from './camera/input.js';
import * as inspect from './shell/inspect.js';
import * as kinds from './shell/kinds.js';
import * as layers from './layers/layers.js';
import * as orientation from './camera/orientation.js';
import * as people from './session/people.js';
import * as pick from './rendering/pick.js';
import * as picture from './rendering/picture.js';
import * as plates from './shell/plates.js';
import * as presets from './views/presets.js';
import * as scaleBar from './annotations/scale_bar.js';
import * as session from './session/session.js';
import * as sheet from './shell/sheet.js';
import * as status from './status/status.js';
import * as slices from './slices/slices.js';
import * as statusPanel from './status/status_panel.js';
import * as stream from './session/stream.js';
import * as theme from './shell/theme.js';
import * as time from './time/time.js';
import * as transfer from './transfer/transfer.js';
import * as transferKinds from './transfer/transfer_kinds.js';
import * as transferMaps from './transfer/transfer_maps.js';
import * as views from './camera/views.js';
import * as volumes from './volumes/volumes.js';
import * as walk from './camera/walk.js';
import * as warp from './frames/warp.js';
import * as windowLevel from './transfer/window_level.js';
import * as zoomBox from './camera/zoom_box.js';

/** In the order of installation; listeners of the same event run in this order. */
const FEATURES = [
  theme, kinds, frames, warp, status, stream, formats, connectionBanner, session, input, plates, sheet, pick,
  orientation, scaleBar, views, zoomBox, walk, camera, clip,
  picture, time, transfer, transferKinds, transferMaps, gradient, windowLevel, slices, layers, channels, announce,
  volumes, presets, people, statusPanel, colorBar, inspect,
];

async function start() {
  const asked = new URLSearchParams(location.search).get('lang');
  const language = chooseLanguage(asked ? [asked] : navigator.languages);
  useTexts(page);
  useTexts(panel);
  if (language !== 'en') translate((await import(`../text/${language}/index.js`)).default);
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
