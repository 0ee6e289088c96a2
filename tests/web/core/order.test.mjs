// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { FrameOrder } from '../../../clients/web/core/order.js';

/** Sets up a FrameOrder whose decoding the test finishes by hand. */
function setUp() {
  const it = { drawn: [], acked: [], failed: [], closed: 0, decoding: new Map(), next: [] };
  it.order = new FrameOrder({
    decode: (frame) => new Promise((resolve, reject) => it.decoding.set(frame.frame, { resolve, reject })),
    schedule: (then) => it.next.push(then),
    draw: (image, frame) => it.drawn.push(frame.frame),
    ack: (frame) => it.acked.push(frame.frame),
    fail: (error, frame) => it.failed.push([frame.frame, error.message]),
  });
  it.finish = (frame) => it.decoding.get(frame).resolve({ close: () => { it.closed += 1; } });
  /** Lets decoded frames arrive, then shows an animation frame. */
  it.animate = async () => {
    await new Promise(setImmediate);
    it.next.splice(0).forEach((then) => then());
  };
  return it;
}

test('each frame that is decoded by an animation frame is drawn', async () => {
  const it = setUp();
  for (const frame of [1, 2, 3]) {
    const done = it.order.put({ frame });
    it.finish(frame);
    await it.animate();
    assert.equal(await done, true);
  }
  assert.deepEqual(it.drawn, [1, 2, 3]);
  assert.equal(it.closed, 3);
});

test('at an animation frame only the newest frame is drawn', async () => {
  const it = setUp();
  const done = [1, 2, 3].map((frame) => it.order.put({ frame }));
  [1, 2, 3].forEach(it.finish);
  await it.animate();
  assert.deepEqual(await Promise.all(done), [false, false, true]);
  assert.deepEqual(it.drawn, [3]);
  assert.equal(it.closed, 3);
});

test('an overtaken frame is not drawn, but released', async () => {
  const it = setUp();
  const done = [1, 2, 3].map((frame) => it.order.put({ frame }));
  it.finish(3);
  await it.animate();
  it.finish(1);
  it.finish(2);
  await it.animate();
  assert.deepEqual(await Promise.all(done), [false, false, true]);
  assert.deepEqual(it.drawn, [3]);
  assert.equal(it.closed, 3);
});

test('a frame is acknowledged when it arrives, unless the decoder is behind', async () => {
  const it = setUp();
  for (let frame = 1; frame <= 6; frame++) it.order.put({ frame });
  assert.deepEqual(it.acked, [1, 2, 3]);
  [1, 2].forEach(it.finish);
  await it.animate();
  assert.deepEqual(it.acked, [1, 2, 3]);
  it.finish(3);
  await it.animate();
  assert.deepEqual(it.acked, [1, 2, 3, 6], 'one acknowledgement covers the frames before it');
});

test('a frame that cannot be decoded is reported, and the stream continues', async () => {
  const it = setUp();
  const done = [1, 2].map((frame) => it.order.put({ frame }));
  it.decoding.get(1).reject(new Error('not a JPEG'));
  it.finish(2);
  await it.animate();
  assert.deepEqual(await Promise.all(done), [false, true]);
  assert.deepEqual(it.failed, [[1, 'not a JPEG']]);
  assert.deepEqual(it.acked, [1, 2]);
});

test('frames of an old stream are neither drawn nor acknowledged on the new stream', async () => {
  const it = setUp();
  const old = [6, 7, 8, 9].map((frame) => it.order.put({ frame }));
  it.finish(6);
  await new Promise(setImmediate); // it waits for the animation frame
  const before = it.acked.length;
  it.order.reset();
  [7, 8, 9].forEach(it.finish);
  const fresh = it.order.put({ frame: 1 });
  it.finish(1);
  await it.animate();
  assert.equal(await fresh, true);
  assert.deepEqual(await Promise.all(old), [false, false, false, false]);
  assert.deepEqual(it.drawn, [1]);
  assert.deepEqual(it.acked.slice(before), [1]);
  assert.equal(it.closed, 5);
});
