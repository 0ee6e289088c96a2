// SPDX-License-Identifier: Apache-2.0
// A daemon whose GPU fails while it streams (played_gpu.c): frames go on, and it says who draws them and why.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Daemon, turned } from './harness.mjs';

const size = [48, 48];

/** A daemon, and a stream that has had its first picture from the GPU. */
async function start(t) {
  const daemon = await Daemon.start(['--volume', 'demo:phantom?size=16'], { backend: 'auto', program: 'splatd-played-gpu' });
  t.after(() => daemon.kill('SIGKILL')); // an open stream would keep a test that fails waiting
  await daemon.loaded('phantom');
  assert.equal((await ready(daemon)).backend, 'played');
  const stream = await daemon.stream({ session: await daemon.session({ volume: 'phantom', size }) });
  await stream.update(turned(stream.session.view, 1), 1);
  await stream.final(1);
  return { daemon, stream };
}

const ready = async (daemon) => (await daemon.json('/readyz', { token: null })).json;

async function still(daemon) {
  const answer = await daemon.fetch('/api/v1/render', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'phantom', size }),
  });
  assert.equal(answer.status, 200);
  await answer.arrayBuffer();
  return answer.headers.get('X-Backend').split(' ')[0];
}

test('the processor takes over from a GPU that fails three times', async (t) => {
  const { daemon, stream } = await start(t);
  assert.equal(await still(daemon), 'played');
  daemon.kill('SIGUSR1');
  await daemon.untilLogged('the GPU hangs\n');
  for (let seq = 2; seq <= 4; seq++) await stream.update(turned(stream.session.view, seq), seq);
  assert.deepEqual((({ width, height }) => [width, height])(await stream.final(4)), size);
  await stream.until(() => stream.notes.some(({ method, params }) => method === 'stream.stats' && params.backend === 'cpu'), 'stream.stats');
  await daemon.untilLogged('backend played failed 3 times in a row: the GPU hangs; backend cpu has taken over');
  const { backend, refused } = await ready(daemon);
  assert.equal(backend, 'cpu');
  assert.deepEqual(refused, ['backend played failed 3 times in a row: the GPU hangs']);
  assert.equal(await still(daemon), 'cpu'); // its lane has a GPU of its own to give up
  assert.equal((await ready(daemon)).refused.length, 2);
  await stream.end();
  assert.equal(await daemon.stop(), 0);
});

test('the processor draws what the GPU has no memory for', async (t) => {
  const { daemon, stream } = await start(t);
  assert.equal(await still(daemon), 'played');
  daemon.kill('SIGUSR2');
  await daemon.untilLogged('the GPU is full\n');
  for (let seq = 2; seq <= 4; seq++) await stream.update(turned(stream.session.view, seq), seq);
  await stream.final(4);
  assert.equal(await still(daemon), 'cpu');
  const { backend, refused } = await ready(daemon);
  assert.equal(backend, 'played'); // it is not given up
  const why = 'backend played cannot draw some views, which cpu draws: it takes 7 bytes and 3 are allowed';
  assert.deepEqual(refused, [why, why]); // of either lane
  await stream.end();
  assert.equal(await daemon.stop(), 0);
  assert.equal(daemon.log.split(why).length, 3); // once a lane; the log is whole when the daemon has ended
});
