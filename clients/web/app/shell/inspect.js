// SPDX-License-Identifier: Apache-2.0
// window.splatd for tests and the console: read-only and not an interface. frame, seq: of the last drawn frame; count: frames drawn since
// the page opened; videos: how many of them were video; warps: pictures drawn from frames by their depth; hasDepth: the newest frame has depth;
// sent: seq of the newest update; compared: the second picture of a comparison; isDrawn: nothing (labels, scale bar, controls) waits for the next
// animation frame, and no frame fades out; isComplete: all parts that load on demand are there.
import { plannedFrames } from '../frames/animation.js';

export function install(app) {
  const { connection, frames, screen, viewer, warp, participants, status, errors, modes, layout, statusPanel } = app;
  const { drawn } = frames;
  Object.defineProperty(window, 'splatd', {
    value: Object.freeze({
      get state() { return connection.state; },
      get frame() { return drawn.frame; },
      get seq() { return Math.max(drawn.seq, viewer.updates.drawn); },
      get count() { return drawn.count; },
      get videos() { return drawn.videos; },
      get isVideo() { return drawn.isVideo; },
      get size() { return [drawn.width, drawn.height]; },
      get wanted() { return screen.size; },
      get isFinal() { return drawn.isFinal; },
      get renderMs() { return drawn.renderMs; },
      get isLossless() { return drawn.isLossless; },
      get sent() { return viewer.updates.sent; },
      get isIdle() { return viewer.updates.isIdle; },
      get isDrawn() { return plannedFrames() === 0 && !warp.fade?.isOn; },
      get isComplete() { return app.later.isComplete; },
      get isWarped() { return warp.isVisible; },
      get hasDepth() { return Boolean(warp.depth?.isReady); },
      get warps() { return warp.depth?.count ?? 0; },
      get camera() { return structuredClone(viewer.camera); },
      get view() { return structuredClone(viewer.view); },
      get canControl() { return viewer.canControl; },
      get people() { return participants.people; },
      get volume() { return viewer.view?.volume ?? null; },
      get background() { return structuredClone(viewer.view?.background ?? null); },
      get transfer() { return structuredClone(viewer.view?.transfer_function ?? null); },
      get compositing() { return structuredClone(viewer.view?.compositing ?? null); },
      get session() { return connection.session?.id ?? null; },
      get latencyMs() { return status.latencyMs; },
      get latency() { return statusPanel.latency; },
      get compared() {
        const other = app.compare?.companion;
        return other && { id: other.id, isAtRest: other.isAtRest, warps: other.warps, view: structuredClone(other.view) };
      },
      get stats() { return structuredClone(status.stats); },
      get mode() { return modes.current; },
      get layout() { return layout.current; },
      get measures() { return structuredClone(app.measures?.items ?? []); },
      get errors() { return [...errors]; },
    }),
  });
}
