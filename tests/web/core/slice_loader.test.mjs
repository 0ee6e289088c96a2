// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { SliceCache, SliceLoader, askUntil } from '../../../clients/web/core/slice_loader.js';

const slice = (bytes) => ({ values: new Uint8Array(bytes) });
const want = (key) => ({ key, query: { key } });
const settle = () => new Promise((resolve) => { setImmediate(resolve); });

/** A loader whose requests the test answers. */
function rig() {
  const requests = [];
  const shown = [];
  const errors = [];
  const cache = new SliceCache(100);
  const loader = new SliceLoader({
    cache, show: (_, key) => shown.push(key), fail: (error) => errors.push(error.message),
    load: (query, signal) => new Promise((resolve, reject) => {
      requests.push({ key: query.key, signal, resolve: () => resolve(slice(10)), reject: () => reject(new Error(query.key)) });
      signal.addEventListener('abort', () => reject(new Error('aborted')));
    }),
  });
  return { requests, shown, errors, cache, loader };
}

test('one request is under way, and the newest one comes next', async () => {
  const { requests, shown, loader } = rig();
  for (const key of ['a', 'b', 'c', 'd']) loader.want(want(key));
  assert.deepEqual(requests.map(({ key }) => key), ['a']);
  requests[0].resolve();
  await settle();
  assert.deepEqual(shown, ['a'], 'a slice on the way is shown');
  assert.deepEqual(requests.map(({ key }) => key), ['a', 'd']);
  requests[1].resolve();
  await settle();
  assert.deepEqual(shown, ['a', 'd']);
  loader.want(want('a'));
  assert.deepEqual(shown, ['a', 'd', 'a'], 'from the cache, at once');
  assert.equal(loader.isBusy, false);
});

test('neighbours are loaded ahead, and give way to what is wanted', async () => {
  const { requests, shown, errors, loader } = rig();
  loader.want(want('a'), [want('b'), want('c')]);
  requests[0].resolve();
  await settle();
  assert.deepEqual(requests.map(({ key }) => key), ['a', 'b']);
  requests[1].resolve();
  await settle();
  assert.equal(requests[2].key, 'c');
  loader.want(want('x'));
  assert.equal(requests[2].signal.aborted, true);
  await settle();
  assert.equal(requests[3].key, 'x');
  requests[3].resolve();
  await settle();
  assert.deepEqual(shown, ['a', 'x'], 'what was loaded ahead is not shown');
  assert.deepEqual(errors, []);
});

test('a failure is told once, and does not stop the next request', async () => {
  const { requests, shown, errors, loader } = rig();
  loader.want(want('a'), [want('b')]);
  requests[0].reject();
  await settle();
  assert.deepEqual(errors, ['a']);
  requests[1].reject();
  await settle();
  assert.deepEqual(errors, ['a'], 'the failure of a neighbour is not told');
  assert.equal(requests.length, 2, 'it is not tried again');
  loader.want(want('c'));
  requests[2].resolve();
  await settle();
  assert.deepEqual(shown, ['c']);
});

test('an answer that arrives after an abort is ignored: it may be of another volume', async () => {
  const cache = new SliceCache(100);
  const shown = [];
  let answer;
  const loader = new SliceLoader({ cache, show: (_, key) => shown.push(key), fail: assert.fail, load: () => new Promise((resolve) => { answer = resolve; }) });
  loader.want(want('a'));
  loader.stop();
  loader.want(want('a'));
  answer(slice(10));
  await settle();
  assert.deepEqual([shown, cache.get('a')], [[], null]);
  answer(slice(10));
  await settle();
  assert.deepEqual(shown, ['a'], 'it was asked for again');
});

test('a slice of another volume is asked for again, like one that the daemon still loads', async () => {
  const busy = Object.assign(new Error('loading'), { status: 409, retryAfter: 1 });
  const answers = [{ meta: { volume: 'old' } }, busy, { meta: { volume: 'new' } }];
  const ask = async () => {
    const next = answers.shift();
    if (next instanceof Error) throw next;
    return next;
  };
  const { signal } = new AbortController();
  let pauses = 0;
  const pause = async () => { pauses += 1; };
  assert.equal((await askUntil('new', ask, signal, pause)).meta.volume, 'new');
  assert.equal(pauses, 2);
  answers.push(new Error('no such slice'));
  await assert.rejects(askUntil('new', ask, signal, pause), /no such slice/);
  answers.push({ meta: { volume: 'old' } });
  await assert.rejects(askUntil('new', ask, AbortSignal.abort(), pause), { name: 'AbortError' });
});

test('what is wanted again while its request is being stopped is loaded', async () => {
  const { requests, shown, errors, loader } = rig();
  loader.want(want('a'));
  loader.stop();
  loader.want(want('a'));
  await settle();
  assert.deepEqual(requests.map(({ key }) => key), ['a', 'a']);
  requests[1].resolve();
  await settle();
  assert.deepEqual(shown, ['a']);
  loader.want(want('a'), [want('b')]);
  loader.want(want('x'));
  loader.want(want('b'), [want('c')]);
  await settle();
  assert.deepEqual(requests.map(({ key }) => key), ['a', 'a', 'b', 'b']);
  requests[3].resolve();
  await settle();
  assert.deepEqual(shown, ['a', 'a', 'b']);
  assert.equal(requests[4].key, 'c', 'neighbours of the new one are loaded ahead');
  assert.deepEqual(errors, []);
});

test('the failure of a neighbour that became wanted is told', async () => {
  const { requests, errors, loader } = rig();
  loader.want(want('a'), [want('b')]);
  requests[0].resolve();
  await settle();
  loader.want(want('b'));
  requests[1].reject();
  await settle();
  assert.deepEqual(errors, ['b']);
  assert.equal(loader.isBusy, false);
});

test('the cache drops what was not used for longest', () => {
  const cache = new SliceCache(25);
  cache.put('a', slice(10));
  cache.put('b', slice(10));
  cache.get('a');
  cache.put('c', slice(10));
  assert.equal(cache.get('b'), null);
  assert.ok(cache.get('a') && cache.get('c'));
  assert.equal(cache.bytes, 20);
  cache.put('huge', slice(100));
  assert.ok(cache.get('huge'), 'the newest stays, whatever its size');
  assert.equal(cache.bytes, 100);
  cache.clear();
  assert.equal(cache.bytes, 0);
});
