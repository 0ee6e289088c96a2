// SPDX-License-Identifier: Apache-2.0
// Starts the page: its language, the shared parts (shell/app.js), and the features that the first image needs; parts/ has the others. To add a
// feature, write a module with install(app) and add it to the list here or to a part.
import { chooseLanguage, translate, useTexts } from '../core/text.js';
import page from '../text/en/page.js';
import panel from '../text/en/panel.js';
import { install as announce } from './announce.js';
import { createApp } from './shell/app.js';
import { install as camera } from './camera/camera.js';
import { install as channels } from './channels/channels.js';
import { install as colorBar } from './annotations/color_bar.js';
import { install as connectionBanner } from './session/connection_banner.js';
import { showTexts } from './controls/dom.js';
import { install as formats } from './frames/formats.js';
import { install as frames } from './frames/frames.js';
import { install as gradient } from './transfer/gradient.js';
import { install as input } from './camera/input.js';
import { install as inspect } from './shell/inspect.js';
import { install as kinds } from './shell/kinds.js';
import { install as layers } from './layers/layers.js';
import { install as orientation } from './camera/orientation.js';
import { install as people } from './session/people.js';
import { install as pick } from './rendering/pick.js';
import { install as picture } from './rendering/picture.js';
import { install as plates } from './shell/plates.js';
import { install as predict } from './frames/predict.js';
import { install as presets } from './views/presets.js';
import { install as scaleBar } from './annotations/scale_bar.js';
import { install as session } from './session/session.js';
import { install as sheet } from './shell/sheet.js';
import { install as status } from './status/status.js';
import { install as statusPanel } from './status/status_panel.js';
import { install as stream } from './session/stream.js';
import { install as theme } from './shell/theme.js';
import { install as time } from './time/time.js';
import { install as transfer } from './transfer/transfer.js';
import { install as transferKinds } from './transfer/transfer_kinds.js';
import { install as transferMaps } from './transfer/transfer_maps.js';
import { install as views } from './camera/views.js';
import { install as volumes } from './volumes/volumes.js';
import { install as walk } from './camera/walk.js';
import { install as windowLevel } from './transfer/window_level.js';
import { install as zoomBox } from './camera/zoom_box.js';

/** In the order of installation; listeners of the same event run in this order. */
const FEATURES = [
  theme, kinds, frames, predict, status, stream, formats, connectionBanner, session, input, plates, sheet, pick,
  orientation, scaleBar, views, zoomBox, walk, camera,
  picture, time, transfer, transferKinds, transferMaps, gradient, windowLevel, layers, channels, announce,
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
  for (const install of FEATURES) install(app);
  app.connection.start();
}

start();
