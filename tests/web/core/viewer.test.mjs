// SPDX-License-Identifier: Apache-2.0
// The view of the page against a daemon that answers when the test says so.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Emitter } from '../../../clients/web/core/emitter.js';
import { Viewer } from '../../../clients/web/app/camera/viewer.js';

globalThis.requestAnimationFrame = setImmediate;

const viewOf = (volume, distance) => ({
  volume, size: [100, 100], slices: { position: [0, 0, 0] },
  camera: { position: [0, 0, distance], target: [0, 0, 0], up: [0, 1, 0], fov_y: 30, projection: 'perspective' },
});

/** A viewer that shows the volume `a`. calls: [{method, params, answer}], in the order in which the page sent them. */
function setUp() {
  const calls = [];
  const connection = Object.assign(new Emitter(), {
    volumes: [], isLive: true, waiting: null,
    call: (method, params) => new Promise((answer) => {
      calls.push({ method, params, answer });
      connection.waiting?.();
    }),
  });
  const viewer = new Viewer({ connection, viewport: () => ({ width: 100, height: 100 }) });
  viewer.adopt({ view: viewOf('a', 5), isNew: true });
  viewer.resume();
  /** Resolves when the page has sent `count` calls. */
  const sent = async (count) => {
    while (calls.length < count) await new Promise((resolve) => { connection.waiting = resolve; });
    return calls[count - 1];
  };
  return { viewer, calls, sent };
}

test('a change while the view of a new volume is on its way: the view is asked for again', async () => {
  const { viewer, sent } = setUp();
  viewer.selectVolume('b');
  (await sent(1)).answer({});
  const asked = await sent(2);
  assert.equal(asked.method, 'view.get');
  viewer.change({ slices: { position: [1, 1, 1] } });
  const update = await sent(3);
  asked.answer({ view: viewOf('b', 50) });
  await new Promise(setImmediate);
  assert.equal(viewer.camera.position[2], 5, 'the change is on its way, so the view would lose it');
  update.answer({});
  const again = await sent(4);
  assert.equal(again.method, 'view.get');
  again.answer({ view: { ...viewOf('b', 50), slices: { position: [1, 1, 1] } } });
  await new Promise(setImmediate);
  assert.deepEqual([viewer.view.volume, viewer.camera.position[2], viewer.isCurrent], ['b', 50, true]);
});
