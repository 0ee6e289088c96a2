// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { applyPatch, joinPatches } from '../../../clients/web/core/merge.js';
import { UpdateQueue } from '../../../clients/web/core/update_queue.js';

/** An update queue with a hand-driven clock, animation frame and server. */
function setUp({ limit = 3 } = {}) {
  const it = { sent: [], answers: [], frames: [], failed: [], done: [], now: 0 };
  it.updates = new UpdateQueue({
    send: (params) => {
      it.sent.push(params);
      return new Promise((resolve, reject) => it.answers.push({ resolve, reject }));
    },
    schedule: (then) => it.frames.push(then),
    now: () => it.now,
    done: (patch) => it.done.push(patch),
    fail: (error, patch) => it.failed.push([error, patch]),
    limit,
  });
  it.frame = () => it.frames.splice(0).forEach((then) => then());
  it.settle = () => new Promise((resolve) => { setImmediate(resolve); });
  it.updates.open();
  return it;
}

test('many moves between two animation frames become one update with the newest view', () => {
  const it = setUp();
  for (let i = 0; i < 50; i += 1) it.updates.put({ camera: { position: [i, 0, 0] } });
  it.updates.put({ background: [1, 1, 1, 1] });
  assert.equal(it.frames.length, 1);
  it.frame();
  assert.deepEqual(it.sent, [{ seq: 1, patch: { camera: { position: [49, 0, 0] }, background: [1, 1, 1, 1] } }]);
});

test('unanswered updates are limited; the last update is sent as soon as an answer arrives', async () => {
  const it = setUp({ limit: 3 });
  for (let i = 1; i <= 10; i += 1) {
    it.updates.put({ n: i });
    it.frame();
  }
  assert.deepEqual(it.sent.map((s) => s.patch.n), [1, 2, 3]);
  assert.equal(it.updates.unanswered, 3);
  it.answers[0].resolve({ seq: 1 });
  await it.settle();
  it.frame();
  assert.deepEqual(it.sent.map((s) => s.patch.n), [1, 2, 3, 10]);
  assert.deepEqual(it.sent.map((s) => s.seq), [1, 2, 3, 4]);
  assert.deepEqual(it.done, [{ n: 1 }]);
  it.answers.forEach((answer) => answer.resolve({}));
  await it.settle();
  assert.ok(it.updates.isIdle);
  it.frame();
  assert.equal(it.sent.length, 4);
});

test('a refused update is reported and does not delay the next', async () => {
  const it = setUp({ limit: 1 });
  it.updates.put({ n: 1 });
  it.frame();
  it.updates.put({ n: 2 });
  it.frame();
  it.answers[0].reject(new Error('no'));
  await it.settle();
  it.frame();
  assert.deepEqual(it.failed.map(([error, patch]) => [error.message, patch]), [['no', { n: 1 }]]);
  assert.equal(it.sent.length, 2);
});

test('no frame is expected for a refused update', async () => {
  const it = setUp();
  for (const n of [1, 2, 3]) {
    it.updates.put({ n });
    it.frame();
  }
  assert.equal(it.updates.sent, 3);
  it.answers[1].resolve({ seq: 2 });
  it.answers[2].reject(new Error('no'));
  await it.settle();
  assert.equal(it.updates.sent, 2);
  it.answers[0].resolve({ seq: 1 });
  await it.settle();
  assert.equal(it.updates.sent, 2);
  it.updates.put({ n: 4 });
  it.frame();
  assert.deepEqual([it.sent.at(-1).seq, it.updates.sent], [4, 4], 'no seq is reused');
});

test('unanswered updates of a lost stream are merged and sent on the next stream, where seq starts again', async () => {
  const it = setUp();
  it.updates.put({ a: 1, camera: { position: [1] } });
  it.frame();
  it.updates.put({ camera: { position: [2] } });
  it.frame();
  it.updates.put({ b: 3 });
  it.updates.close();
  it.answers.forEach((answer) => answer.reject(new Error('the connection was lost')));
  await it.settle();
  it.frame();
  assert.equal(it.sent.length, 2, 'nothing is sent without a stream');
  assert.deepEqual(it.failed, []);
  it.updates.open();
  it.frame();
  assert.deepEqual(it.sent[2], { seq: 1, patch: { a: 1, camera: { position: [2] }, b: 3 } });
});

test('drop discards the waiting update; alone replaces it', () => {
  const it = setUp();
  it.updates.put({ camera: { position: [1] } });
  it.updates.put({ volume: 'head' }, { alone: true });
  it.frame();
  assert.deepEqual(it.sent[0].patch, { volume: 'head' });
  it.updates.put({ n: 1 });
  it.updates.drop();
  it.frame();
  assert.equal(it.sent.length, 1);
});

test('latency is measured from the first action of an update to the frame that shows it', () => {
  const it = setUp();
  it.now = 100;
  it.updates.put({ n: 1 }, { time: 90 });
  it.updates.put({ n: 2 }, { time: 99 });
  it.now = 104;
  it.frame();
  it.now = 140;
  assert.equal(it.updates.show(0), null, 'a frame from before the update');
  assert.equal(it.updates.show(1), 50);
  assert.equal(it.updates.waited, 14, 'the update waited from the action to the animation frame that sent it');
  assert.equal(it.updates.show(1), null, 'the refined frame does not count again');
  assert.equal(it.updates.show(7), null, 'a seq that was never sent');
  assert.equal(it.updates.drawn, 1);
});

test('a frame that shows a newer update also answers the older updates', () => {
  const it = setUp();
  for (const n of [1, 2, 3]) {
    it.now = n * 10;
    it.updates.put({ n });
    it.frame();
  }
  it.now = 60;
  assert.equal(it.updates.show(3), 30);
  assert.equal(it.updates.show(2), null);
});

test('merge patches (RFC 7396): null removes a member from a value and stays in a patch', () => {
  assert.deepEqual(applyPatch({ a: { b: 1, c: [1, 2] }, d: 4 }, { a: { b: null, c: [3] }, e: 5 }), { a: { c: [3] }, d: 4, e: 5 });
  assert.deepEqual(applyPatch({ a: 1 }, { a: { b: 2 } }), { a: { b: 2 } });
  assert.deepEqual(joinPatches({ a: { b: 1 }, d: 1 }, { a: { b: null, c: 2 } }), { a: { b: null, c: 2 }, d: 1 });
  const view = { camera: { position: [1, 2, 3], up: [0, 1, 0] }, background: [0, 0, 0, 1] };
  const [first, second] = [{ camera: { position: [4, 5, 6] } }, { camera: { up: [1, 0, 0] }, background: null }];
  assert.deepEqual(applyPatch(view, joinPatches(first, second)), applyPatch(applyPatch(view, first), second));
});

test('an update that gives the same picture counts as drawn once all before it are', async () => {
  const it = setUp();
  for (const n of [1, 2, 3]) {
    it.updates.put({ n });
    it.frame();
  }
  it.answers[1].resolve({ seq: 2, same_image: true });
  await it.settle();
  assert.equal(it.updates.drawn, 0, 'the first one may need a frame');
  it.answers[0].resolve({ seq: 1 });
  it.answers[2].resolve({ seq: 3, same_image: true });
  await it.settle();
  assert.deepEqual([it.updates.sent, it.updates.drawn], [3, 0]);
  it.updates.show(1);
  assert.equal(it.updates.drawn, 3);
  it.updates.put({ n: 4 });
  it.frame();
  it.answers[3].resolve({ seq: 4, same_image: true });
  await it.settle();
  assert.equal(it.updates.drawn, 4);
});

test('arrived() waits for the updates that were put before it, and not for later ones', async () => {
  const it = setUp();
  const order = [];
  it.updates.arrived().then(() => order.push('idle'));
  await it.settle();
  assert.deepEqual(order, ['idle']);
  it.updates.put({ quality: 1 });
  it.updates.arrived().then(() => order.push('answered'));
  it.frame();
  it.updates.put({ quality: 2 });
  it.frame();
  await it.settle();
  assert.deepEqual(order, ['idle']);
  it.answers[0].resolve({});
  await it.settle();
  assert.deepEqual(order, ['idle', 'answered'], 'the second update is still unanswered');
  it.updates.put({ quality: 3 });
  it.updates.arrived().then(() => order.push('lost'));
  it.updates.close();
  await it.settle();
  assert.deepEqual(order, ['idle', 'answered', 'lost']);
});
