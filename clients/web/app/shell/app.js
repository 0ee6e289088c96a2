// SPDX-License-Identifier: Apache-2.0
// The object `app` that every feature gets: the parts of the page that all share.
import { Connection } from '../../core/connection.js';
import { Participants } from '../../core/participants.js';
import { readAddress } from './address.js';
import { Banner, Notice } from './banner.js';
import { byId } from '../controls/dom.js';
import { Layout } from './layout.js';
import { marginsOf } from './margins.js';
import { Modes } from './modes.js';
import { Overlay } from './overlay.js';
import { Panel } from './panel.js';
import { Prompts } from './prompts.js';
import { Screen } from '../frames/screen.js';
import { Shortcuts } from './shortcuts.js';
import { createStorage } from './storage.js';
import { Toolbar } from './toolbar.js';
import { Viewer } from '../camera/viewer.js';
import { Warp } from '../frames/warp.js';

const ERRORS_MAX = 20;

function createConnection(base, address, { view, size }) {
  return new Connection({
    base, ...address, lastView: view, size,
    env: {
      fetch: (address, options) => window.fetch(address, options), WebSocket: window.WebSocket,
      setTimeout: (act, ms) => window.setTimeout(act, ms), clearTimeout: (id) => window.clearTimeout(id),
      now: () => performance.now(),
    },
  });
}

/**
 * Creates the parts: base (address of the page's folder), storage {recall, remember}, address, connection, api, participants, viewer, screen,
 * warp, overlay, layout, modes, shortcuts, toolbar, panel, prompts, banner, notice, errors (texts), report(error). Features add frames, formats,
 * configure(), transfer, status and showParticipants().
 */
export function createApp(base) {
  const storage = createStorage(base);
  const address = readAddress(storage);
  const notice = new Notice(byId('notice'));
  const errors = [];
  const report = (error) => {
    errors.push(String(error?.message ?? error));
    if (errors.length > ERRORS_MAX) errors.shift();
    notice.show(errors.at(-1), 'error');
  };
  const layout = new Layout(document.querySelector('main'));
  const screen = new Screen(byId('screen'));
  const connection = createConnection(base, address, { view: () => viewer.lastView, size: () => screen.size });
  const viewer = new Viewer({ connection, viewport: () => screen.viewport, margins: () => marginsOf(screen.element) });
  const warp = new Warp(byId('warp'), screen);
  const modes = new Modes(byId('screen'));
  const shortcuts = new Shortcuts(byId('shortcuts'), (event) => modes.key(event));
  const banner = new Banner(byId('banner'), {
    retry: () => connection.retryNow(),
    useToken: (token) => {
      storage.remember('token', token);
      connection.useToken(token);
    },
  });
  return {
    base, storage, address, connection, viewer, screen, warp, layout, modes, shortcuts, banner, notice, errors, report,
    get api() { return connection.api; },
    /** True if this client may load volumes. */
    get mayOpen() { return Boolean(connection.api.may.open) && !connection.session?.isJoined; },
    participants: new Participants(),
    overlay: new Overlay(byId('overlay'), { viewer, screen, warp }),
    toolbar: new Toolbar(byId('toolbar'), shortcuts),
    panel: new Panel(storage),
    prompts: new Prompts(byId('messages')),
  };
}
