// SPDX-License-Identifier: Apache-2.0
// What this window asks of the stream: size, rate, formats and name. The size follows the 3-D pane, at most every RESIZE_MS; the last
// size is always sent.
import { t } from '../../core/text.js';
import { refreshRate } from '../frames/animation.js';
import { depthSettings } from '../frames/warp.js';

const RESIZE_MS = 120;

export function install(app) {
  const { connection, screen, storage, report } = app;
  let configured = '';
  let maxFps = 60;
  let timer = null;

  async function send() {
    const { size } = screen;
    if (!connection.isLive || String(size) === configured) return;
    configured = String(size);
    const format = await app.formats.wanted();
    const name = storage.recall('name') ?? app.guestName?.();
    try {
      const { formats } = await connection.call('stream.configure', { size, max_fps: maxFps, ...depthSettings(Boolean(app.wantsDepth?.())), ...(name ? { name } : {}), ...format });
      if (formats) app.formats.keepGranted(formats);
    } catch (error) {
      if (connection.isLive) report(new Error(t('stream.size.refused', { reason: error.message })));
    }
    if (String(screen.size) !== configured) plan();
  }

  function plan() {
    if (timer || !connection.isLive) return;
    timer = setTimeout(() => {
      timer = null;
      send();
    }, RESIZE_MS);
  }

  screen.onResize(plan);
  connection.on('state', ({ state }) => {
    if (state !== 'live') return;
    configured = '';
    send();
  });
  /** Changes parameters of the stream. Resolves to the daemon's answer, or to null without a stream or after an error. */
  app.configure = async (params) => {
    if (!connection.isLive) return null;
    try {
      return await connection.call('stream.configure', params);
    } catch (error) {
      if (connection.isLive) report(error);
      return null;
    }
  };
  refreshRate().then((hertz) => {
    if (hertz === maxFps) return;
    maxFps = hertz;
    app.configure({ max_fps: maxFps });
  });
}
