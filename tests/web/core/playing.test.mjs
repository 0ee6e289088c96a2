// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Playing, speedScale } from '../../../clients/web/core/playing.js';

/** A daemon that answers when it is told to. */
function setUp() {
  const it = { asked: [], answers: [], stops: 0, failures: [] };
  it.playing = new Playing({
    call: (method, { rate = 0 }) => {
      it.asked.push([method, rate]);
      return new Promise((resolve, reject) => { it.answers.push({ resolve, reject }); });
    },
    stopped: () => { it.stops += 1; },
    failed: (error) => { it.failures.push(error.message); },
  });
  it.answer = async (how = 'resolve', what = undefined) => {
    it.answers.shift()[how](what);
    await new Promise(setImmediate);
  };
  return it;
}

test('while the daemon has not answered, only the newest rate waits', async () => {
  const { playing, asked, answer } = setUp();
  playing.play();
  playing.take(0.5);
  for (const speed of [1, 2, -1]) playing.speed = speed;
  assert.deepEqual(asked, [['time.play', 0.5]]);
  await answer();
  assert.deepEqual(asked.slice(1), [['time.play', -1]]);
  playing.stop();
  await answer();
  assert.deepEqual(asked.slice(2), [['time.stop', 0]]);
});

test('the daemon says whether the streaks move, also for other participants', async () => {
  const it = setUp();
  const { playing } = it;
  let changes = 0;
  playing.on('change', () => { changes += 1; });
  playing.take(2);
  assert.deepEqual([playing.rate, playing.speed, it.stops], [2, 2, 0]);
  playing.take(0);
  assert.deepEqual([playing.rate, playing.speed, it.stops], [0, 2, 1], 'the speed is that of the next time');
  playing.take(0);
  assert.equal(it.stops, 1);
  playing.speed = -0.5;
  assert.deepEqual(it.asked, [], 'the speed alone moves nothing');
  playing.play();
  await it.answer('reject', new Error('no'));
  assert.deepEqual([it.asked, it.failures], [[['time.play', -0.5]], ['no']]);
  playing.take(1);
  playing.reset();
  assert.deepEqual([playing.rate, it.stops, changes], [0, 1, 6]);
});

test('the slider of the speed has both directions, finer steps near 0, and no 0', () => {
  assert.deepEqual([-1, -0.5, -0.001, 0, 0.5, 1].map(speedScale.at), [-4, -1, -0.02, 0.02, 1, 4]);
  assert.deepEqual([-10, -4, 1, 4].map(speedScale.of), [-1, -1, 0.5, 1]);
});
