// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { FrameError, decodeFrame } from '../../../clients/web/core/frame.js';

// Written byte by byte from the table of the protocol, independent of the code of client and server.
const EXAMPLE = [
  0x53, 0x50, 0x46, 0x31, // "SPF1"
  0x01, 0x03, 0x24, 0x00, // JPEG, key frame | final quality, 36 bytes
  0x78, 0x56, 0x34, 0x12, // frame
  0x04, 0x03, 0x02, 0x01, // seq
  0x00, 0x02, 0x80, 0x01, // 512 × 384
  0x10, 0x27, 0x00, 0x00, // 10000 µs
  0xe8, 0x03, 0x00, 0x00, // 1000 µs
  0x03, 0x00, 0x00, 0x00, // 3 bytes
  0xd0, 0x07, 0x00, 0x00, // 2000 µs
  0xff, 0xd8, 0xff,
];
const message = (changes = {}, bytes = EXAMPLE) => {
  const copy = Uint8Array.from(bytes);
  for (const [at, value] of Object.entries(changes)) copy[at] = value;
  return copy.buffer;
};

test('every field of the header is read', () => {
  const { payload, ...frame } = decodeFrame(message());
  assert.deepEqual(frame, {
    codec: 1, type: 'image/jpeg', isVideo: false, flags: 3, isKey: true, isFinal: true, isLossless: false, isIncomplete: false,
    frame: 0x12345678, seq: 0x01020304, width: 512, height: 384, bytes: 3, renderUs: 10000, encodeUs: 1000, queueUs: 2000, depth: null,
  });
  assert.deepEqual([...payload], [0xff, 0xd8, 0xff]);
});

test('numbers are unsigned', () => {
  const frame = decodeFrame(message({ 11: 0xff, 15: 0xff }));
  assert.equal(frame.frame, 0xff345678);
  assert.equal(frame.seq, 0xff020304);
});

test('PNG, WebP and lossless frames are recognised', () => {
  assert.equal(decodeFrame(message({ 4: 2, 5: 7 })).type, 'image/png');
  assert.ok(decodeFrame(message({ 4: 2, 5: 7 })).isLossless);
  assert.ok(decodeFrame(message({ 5: 11 })).isIncomplete);
  assert.equal(decodeFrame(message({ 4: 3 })).type, 'image/webp');
});

test('a longer header of a later version is skipped', () => {
  const bytes = [...EXAMPLE.slice(0, 36), 1, 2, 3, 4, ...EXAMPLE.slice(36)];
  assert.deepEqual([...decodeFrame(message({ 6: 40 }, bytes)).payload], [0xff, 0xd8, 0xff]);
});

// The same with depth, by the table of the protocol: 128 × 96 cells, two bytes of depth.
const f64 = (...numbers) => [...new Uint8Array(Float64Array.from(numbers).buffer)];
const DEEP = [
  ...EXAMPLE.slice(0, 5), 0x13, 0x88, 0x00, ...EXAMPLE.slice(8, 36),
  0x02, 0x00, 0x00, 0x00, // 2 bytes of depth
  0x80, 0x00, 0x60, 0x00, // 128 × 96
  0x00, 0x00, 0x00, 0x40, 0x00, 0x00, 0x80, 0x40, // near 2, far 4
  0x00, 0x00, 0x00, 0x00, // perspective
  ...f64(1, 2, 3, 4, 5, 6, 0, 1, 0, 30), // position, target, up, fov_y
  0xaa, 0xbb, // the depth
  ...EXAMPLE.slice(36),
];

test('the camera and the depth of a frame are read', () => {
  const { payload, depth } = decodeFrame(message({}, DEEP));
  assert.deepEqual([...payload], [0xff, 0xd8, 0xff]);
  assert.deepEqual({ ...depth, payload: [...depth.payload] }, {
    camera: { projection: 'perspective', position: [1, 2, 3], target: [4, 5, 6], up: [0, 1, 0], fov_y: 30 }, cells: [128, 96], near: 2, far: 4, payload: [0xaa, 0xbb],
  });
  assert.equal(decodeFrame(message({ 52: 1 }, DEEP)).depth.camera.height, 30);
  const none = [...DEEP.slice(0, 36), 0, 0, 0, 0, ...Array(12).fill(0), ...DEEP.slice(52, 136), ...DEEP.slice(138)];
  assert.equal(decodeFrame(message({}, none)).depth.payload, null, 'a frame without depth has its camera');
});

test('a depth that does not fit its frame is left out, and the image stays', () => {
  for (const changes of [{ 40: 0x7f }, { 42: 0x61 }, { 51: 0xc0 }, { 46: 0, 47: 0 }]) {
    const { payload, depth } = decodeFrame(message(changes, DEEP));
    assert.deepEqual([[...payload], depth.payload], [[0xff, 0xd8, 0xff], null], JSON.stringify(changes));
  }
});

test('sizes of depth that do not add up are refused', () => {
  assert.throws(() => decodeFrame(message({ 36: 3 }, DEEP)), /byte 28: 3 bytes announced, 2 sent/);
  assert.throws(() => decodeFrame(message({ 39: 0xff }, DEEP)), FrameError);
  assert.throws(() => decodeFrame(message({ 6: 0x87 }, DEEP)), /byte 6: a header of 135/);
});

test('malformed frames are refused with the byte offset', () => {
  const cases = {
    'shorter than its header': message({}, EXAMPLE.slice(0, 35)),
    'of 0 bytes': new ArrayBuffer(0),
    'byte 0': message({ 3: 0x32 }),
    'byte 4: codec 0': message({ 4: 0 }),
    'byte 4: codec 6': message({ 4: 6 }),
    'byte 6: a header of 35': message({ 6: 35 }),
    'byte 6: a header of 65535': message({ 6: 0xff, 7: 0xff }),
    'byte 16': message({ 16: 0, 17: 0 }),
    'byte 16: a picture of 512 × 65': message({ 19: 0xff }),
    'byte 28: 4 bytes announced, 3 sent': message({ 28: 4 }),
    'byte 28: 2 bytes announced, 3 sent': message({ 28: 2 }),
    'byte 28: 0 bytes announced, 0 sent': message({ 28: 0 }, EXAMPLE.slice(0, 36)),
    'byte 28: 4278190083 bytes': message({ 31: 0xff }),
  };
  for (const [text, bytes] of Object.entries(cases)) {
    assert.throws(() => decodeFrame(bytes), (error) => error instanceof FrameError && error.message.includes(text), text);
  }
});

test('every truncation of a valid frame is refused', () => {
  for (let size = 0; size < EXAMPLE.length; size += 1) {
    assert.throws(() => decodeFrame(message({}, EXAMPLE.slice(0, size))), FrameError, `${size} bytes`);
  }
});
