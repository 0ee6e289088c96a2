// SPDX-License-Identifier: Apache-2.0
// The binary frame of the stream: a little-endian header of 36 bytes, then the encoded image; between them the camera and the depth of the
// frame, if the client asked for them (protocol/stream.md).

const HEADER_BYTES = 36;
const DEPTH_BYTES = 100; // how much longer the header is with depth
const DEPTH_CELL = 4; // px of the image per cell of the depth
const FLAG_KEY = 1;
const FLAG_FINAL = 2;
const FLAG_LOSSLESS = 4;
const FLAG_INCOMPLETE = 8;
const FLAG_DEPTH = 16;

/** MIME types. A browser decodes images directly and video with a stateful decoder (video.js). */
const CODECS = new Map([[1, 'image/jpeg'], [2, 'image/png'], [3, 'image/webp'],
  [4, 'video/h264'], [5, 'video/vp9'], [7, 'video/vp8']]);
const SIDE_MAX = 8192;

export class FrameError extends Error {
  name = 'FrameError';
}

/** The camera and the depth that follow the header: {camera, cells: [columns, rows], near, far, payload}; payload is null if the frame has no depth,
 * or if its depth does not fit its image. */
function decodeDepth(view, headerBytes, [frameWidth, frameHeight]) {
  const bytes = view.getUint32(HEADER_BYTES, true);
  const cells = [40, 42].map((at) => view.getUint16(at, true));
  const [near, far] = [44, 48].map((at) => view.getFloat32(at, true));
  const isFlat = view.getUint32(52, true) === 1;
  const vector = (at) => [0, 8, 16].map((more) => view.getFloat64(at + more, true));
  const isFitting = [frameWidth, frameHeight].every((side, i) => cells[i] === Math.ceil(side / DEPTH_CELL)) && far >= near && (isFlat || near > 0);
  return {
    camera: {
      projection: isFlat ? 'orthographic' : 'perspective', position: vector(56), target: vector(80), up: vector(104),
      [isFlat ? 'height' : 'fov_y']: view.getFloat64(128, true),
    },
    cells, near, far,
    payload: bytes > 0 && isFitting ? new Uint8Array(view.buffer, headerBytes, bytes) : null,
  };
}

/**
 * Decodes one binary message (ArrayBuffer). Returns {codec, type, isVideo, flags, isKey, isFinal, isLossless, isIncomplete, frame, seq,
 * width, height, bytes, renderUs, encodeUs, queueUs, payload, depth}; `payload` is a view into the message; `depth` is null unless the client
 * asked for it. Throws FrameError.
 */
export function decodeFrame(buffer) {
  if (buffer.byteLength < HEADER_BYTES) {
    throw new FrameError(`a frame of ${buffer.byteLength} bytes, shorter than its header of ${HEADER_BYTES}`);
  }
  const view = new DataView(buffer);
  if (view.getUint32(0, false) !== 0x53504631) throw new FrameError('byte 0: not "SPF1"');
  const codec = view.getUint8(4);
  const type = CODECS.get(codec);
  if (!type) throw new FrameError(`byte 4: codec ${codec} is not a picture that this client decodes`);
  const flags = view.getUint8(5);
  const headerBytes = view.getUint16(6, true);
  const hasDepth = (flags & FLAG_DEPTH) !== 0;
  if (headerBytes < HEADER_BYTES + (hasDepth ? DEPTH_BYTES : 0) || headerBytes > buffer.byteLength) {
    throw new FrameError(`byte 6: a header of ${headerBytes} bytes in a message of ${buffer.byteLength}`);
  }
  const width = view.getUint16(16, true);
  const height = view.getUint16(18, true);
  if (width < 1 || width > SIDE_MAX || height < 1 || height > SIDE_MAX) {
    throw new FrameError(`byte 16: a picture of ${width} × ${height} px`);
  }
  const payloadBytes = view.getUint32(28, true);
  const imageAt = headerBytes + (hasDepth ? view.getUint32(HEADER_BYTES, true) : 0);
  if (payloadBytes < 1 || payloadBytes !== buffer.byteLength - imageAt) {
    throw new FrameError(`byte 28: ${payloadBytes} bytes announced, ${buffer.byteLength - imageAt} sent`);
  }
  return {
    codec, type, flags,
    isVideo: type.startsWith('video/'),
    isKey: (flags & FLAG_KEY) !== 0,
    isFinal: (flags & FLAG_FINAL) !== 0,
    isLossless: (flags & FLAG_LOSSLESS) !== 0,
    isIncomplete: (flags & FLAG_INCOMPLETE) !== 0,
    frame: view.getUint32(8, true),
    seq: view.getUint32(12, true),
    width, height,
    bytes: payloadBytes, // also after `payload` was given away
    renderUs: view.getUint32(20, true),
    encodeUs: view.getUint32(24, true),
    queueUs: view.getUint32(32, true),
    payload: new Uint8Array(buffer, imageAt, payloadBytes),
    depth: hasDepth ? decodeDepth(view, headerBytes, [width, height]) : null,
  };
}
