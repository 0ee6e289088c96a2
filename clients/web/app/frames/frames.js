// SPDX-License-Identifier: Apache-2.0
// Frames: from the stream through decoder and order to the canvas. app.frames tells what was drawn last.
import { Emitter } from '../../core/emitter.js';
import { FrameOrder } from '../../core/order.js';
import { t } from '../../core/text.js';
import { VideoStream } from '../../core/video.js';
import { cameraOf } from '../../core/warp.js';
import { nextFrame } from './animation.js';
import { decodeImage, prepareDecoder } from './decoder.js';

/** Events: drawn {frame (its header), rig (its camera, or null), isAhead (the daemon expected this camera), latency (ms, or null), decodeMs (from its arrival to its drawing)}; video-failed Error. */
class Frames extends Emitter {
  /** Of the last drawn frame; count, videos: since the page opened. */
  drawn = { frame: 0, seq: 0, count: 0, videos: 0, width: 0, height: 0, isFinal: false, isLossless: false, isVideo: false, renderMs: 0 };

  get hasPicture() { return this.drawn.count > 0; }
}

export function install(app) {
  const { connection, viewer, screen, report } = app;
  prepareDecoder();
  const frames = new Frames();
  const { drawn } = frames;
  const video = new VideoStream({
    env: { VideoDecoder: window.VideoDecoder, EncodedVideoChunk: window.EncodedVideoChunk },
    toImage: (image, { width, height }) => createImageBitmap(image, 0, 0, width, height),
    askKey: () => connection.notify('stream.key', {}),
    giveUp: (error) => frames.emit('video-failed', error),
  });
  let view = null; // of the last drawn frame
  /** True if a frame shows the same view as the last one, and sharper. */
  const isSharper = ({ seq, width, isFinal }) => seq === drawn.seq && viewer.view === view && !drawn.isFinal && (isFinal || width > drawn.width);
  const order = new FrameOrder({
    decode: async (frame) => {
      frame.map = app.warp?.depth?.decode(frame); // before the image: its decoder takes the bytes of the message
      const image = await (frame.isVideo ? video.decode(frame) : decodeImage(frame));
      frame.map = await frame.map;
      return image;
    },
    schedule: nextFrame,
    draw: (image, frame) => {
      const camera = cameraOf(frame, viewer.rigOf(frame.seq));
      const isNewest = frame.seq === viewer.updates.sent && !viewer.updates.isWaiting;
      if (app.warp?.overshoots(camera, viewer.rig, isNewest)) return;
      app.warp?.arrive(frames.hasPicture && isSharper(frame), isNewest && !camera.isAhead, frame.isFinal ? Infinity : frame.width / drawn.width);
      view = viewer.view;
      screen.draw(image, { isMoving: !frame.isFinal });
      app.warp?.depth?.take(image, frame);
      const { frame: number, seq, width, height, isFinal, isLossless, isVideo, renderUs, encodeUs } = frame;
      Object.assign(drawn, {
        frame: number, seq, width, height, isFinal, isLossless, isVideo, count: drawn.count + 1, videos: drawn.videos + Number(isVideo),
        renderMs: (renderUs + encodeUs) / 1000,
      });
      frames.emit('drawn', { frame, ...camera, latency: viewer.updates.show(seq), decodeMs: performance.now() - frame.arrived });
    },
    ack: ({ frame }) => connection.notify('stream.ack', { frame }),
    fail: (error, { frame }) => report(new Error(t('frames.undecodable', { frame, reason: error.message }))),
  });
  connection.on('frame', (frame) => order.put({ ...frame, arrived: performance.now() }));
  connection.on('state', ({ state }) => {
    if (state !== 'live') return;
    order.reset();
    app.warp?.depth?.reset();
    video.reset();
  });
  app.frames = frames;
}
