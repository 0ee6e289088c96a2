// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { FrameOrder } from '../../../clients/web/core/order.js';

/** Sets up a FrameOrder whose decoding the test finishes by hand. */
function setUp() {
  const it = { drawn: [], acked: [], failed: [], closed: 0, decoding: new Map() };
  it.order = new FrameOrder({
    decode: (frame) => new Promise((resolve, reject) => it.decoding.set(frame.frame, { resolve, reject })),
    draw: (image, frame) => it.drawn.push(frame.frame),
    ack: (frame) => it.acked.push(frame.frame),
    fail: (error, frame) => it.failed.push([frame.frame, error.message]),
  });
  it.finish = (frame) => it.decoding.get(frame).resolve({ close: () => { it.closed += 1; } });
  return it;
}

test('frames that decode in order are all drawn and acknowledged', async () => {
  const it = setUp();
  const done = [1, 2, 3].map((frame) => it.order.put({ frame }));
  [1, 2, 3].forEach(it.finish);
  assert.deepEqual(await Promise.all(done), [true, true, true]);
  assert.deepEqual(it.drawn, [1, 2, 3]);
  assert.deepEqual(it.acked, [1, 2, 3]);
  assert.equal(it.closed, 3);
});

test('an overtaken frame is not drawn, but acknowledged and released', async () => {
  const it = setUp();
  const done = [1, 2, 3].map((frame) => it.order.put({ frame }));
  it.finish(3);
  await done[2];
  it.finish(1);
  it.finish(2);
  assert.deepEqual(await Promise.all(done), [false, false, true]);
  assert.deepEqual(it.drawn, [3]);
  assert.deepEqual(it.acked.sort(), [1, 2, 3]);
  assert.equal(it.closed, 3);
});

test('a frame that cannot be decoded is reported and acknowledged, and the stream continues', async () => {
  const it = setUp();
  const done = [1, 2].map((frame) => it.order.put({ frame }));
  it.decoding.get(1).reject(new Error('not a JPEG'));
  it.finish(2);
  assert.deepEqual(await Promise.all(done), [false, true]);
  assert.deepEqual(it.failed, [[1, 'not a JPEG']]);
  assert.deepEqual(it.acked, [1, 2]);
});

test('a frame of an old stream that is still decoding is neither drawn nor acknowledged on the new stream', async () => {
  const it = setUp();
  const old = it.order.put({ frame: 9 });
  const first = it.decoding.get(9);
  it.order.reset();
  const fresh = it.order.put({ frame: 1 });
  it.finish(1);
  await fresh;
  first.resolve({ close: () => { it.closed += 1; } });
  assert.equal(await old, false);
  assert.deepEqual(it.drawn, [1]);
  assert.deepEqual(it.acked, [1]);
  assert.equal(it.closed, 2);
});
