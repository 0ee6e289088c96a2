// SPDX-License-Identifier: Apache-2.0
// A daemon whose GPU fails while it streams (fake_gpu.c): frames continue, and the daemon reports the backend and the reason.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Daemon, turned } from './harness.mjs';

const size = [48, 48];

/** Starts a daemon and a stream whose first frame came from the GPU. */
async function start(t) {
  const daemon = await Daemon.start(['--volume', 'demo:phantom?size=16'], { backend: 'auto', program: 'splatd-fake-gpu' });
  t.after(() => daemon.kill('SIGKILL')); // an open stream would keep a failed test waiting
  await daemon.loaded('phantom');
  assert.equal((await ready(daemon)).backend, 'fake');
  const stream = await daemon.stream({ session: await daemon.session({ volume: 'phantom', size }) });
  await stream.update(turned(stream.session.view, 1), 1);
  await stream.final(1);
  return { daemon, stream };
}

const ready = async (daemon) => (await daemon.json('/readyz', { token: null })).json;

async function snapshot(daemon) {
  const answer = await daemon.fetch('/api/v1/render', {
    method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ volume: 'phantom', size }),
  });
  assert.equal(answer.status, 200);
  await answer.arrayBuffer();
  return answer.headers.get('X-Backend').split(' ')[0];
}

test('the CPU takes over from a GPU that fails three times', async (t) => {
  const { daemon, stream } = await start(t);
  assert.equal(await snapshot(daemon), 'fake');
  daemon.kill('SIGUSR1');
  await daemon.untilLogged('the GPU hangs\n');
  for (let seq = 2; seq <= 4; seq++) await stream.update(turned(stream.session.view, seq), seq);
  assert.deepEqual((({ width, height }) => [width, height])(await stream.final(4)), size);
  await stream.until(() => stream.notes.some(({ method, params }) => method === 'stream.stats' && params.backend === 'cpu'), 'stream.stats');
  await daemon.untilLogged('backend fake failed 3 times in a row: the GPU hangs; backend cpu has taken over');
  const { backend, refused } = await ready(daemon);
  assert.equal(backend, 'cpu');
  assert.deepEqual(refused, ['backend fake failed 3 times in a row: the GPU hangs']);
  assert.equal(await snapshot(daemon), 'cpu'); // the snapshot worker has its own GPU renderer to replace
  assert.equal((await ready(daemon)).refused.length, 2);
  await stream.end();
  assert.equal(await daemon.stop(), 0);
});

test('the CPU renders frames for which the GPU has no memory', async (t) => {
  const { daemon, stream } = await start(t);
  assert.equal(await snapshot(daemon), 'fake');
  daemon.kill('SIGUSR2');
  await daemon.untilLogged('the GPU is full\n');
  for (let seq = 2; seq <= 4; seq++) await stream.update(turned(stream.session.view, seq), seq);
  await stream.final(4);
  assert.equal(await snapshot(daemon), 'cpu');
  const { backend, refused } = await ready(daemon);
  assert.equal(backend, 'fake'); // the GPU stays in use
  const why = 'backend fake cannot draw some views, which cpu draws: it takes 7 bytes and 3 are allowed';
  assert.deepEqual(refused, [why, why]); // one line from each worker
  await stream.end();
  assert.equal(await daemon.stop(), 0);
  assert.equal(daemon.log.split(why).length, 3); // once per worker; the log is complete when the daemon has exited
});
