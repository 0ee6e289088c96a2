// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { SliceCache, SliceLoader } from '../../../clients/web/core/slice_loader.js';

const slice = (bytes) => ({ values: new Uint8Array(bytes) });
const wish = (key) => ({ key, query: { key } });
const settle = () => new Promise((resolve) => { setImmediate(resolve); });

/** A loader whose requests the test answers. */
function rig() {
  const flights = [];
  const shown = [];
  const errors = [];
  const cache = new SliceCache(100);
  const loader = new SliceLoader({
    cache, show: (_, key) => shown.push(key), fail: (error) => errors.push(error.message),
    load: (query, signal) => new Promise((resolve, reject) => {
      flights.push({ key: query.key, signal, resolve: () => resolve(slice(10)), reject: () => reject(new Error(query.key)) });
      signal.addEventListener('abort', () => reject(new Error('aborted')));
    }),
  });
  return { flights, shown, errors, cache, loader };
}

test('one request is in flight, and the newest wish comes next', async () => {
  const { flights, shown, loader } = rig();
  for (const key of ['a', 'b', 'c', 'd']) loader.want(wish(key));
  assert.deepEqual(flights.map(({ key }) => key), ['a']);
  flights[0].resolve();
  await settle();
  assert.deepEqual(shown, ['a'], 'a slice on the way is shown');
  assert.deepEqual(flights.map(({ key }) => key), ['a', 'd']);
  flights[1].resolve();
  await settle();
  assert.deepEqual(shown, ['a', 'd']);
  loader.want(wish('a'));
  assert.deepEqual(shown, ['a', 'd', 'a'], 'from the cache, at once');
  assert.equal(loader.isBusy, false);
});

test('neighbours are loaded ahead, and give way to a wish', async () => {
  const { flights, shown, errors, loader } = rig();
  loader.want(wish('a'), [wish('b'), wish('c')]);
  flights[0].resolve();
  await settle();
  assert.deepEqual(flights.map(({ key }) => key), ['a', 'b']);
  flights[1].resolve();
  await settle();
  assert.equal(flights[2].key, 'c');
  loader.want(wish('x'));
  assert.equal(flights[2].signal.aborted, true);
  await settle();
  assert.equal(flights[3].key, 'x');
  flights[3].resolve();
  await settle();
  assert.deepEqual(shown, ['a', 'x'], 'what was loaded ahead is not shown');
  assert.deepEqual(errors, []);
});

test('a failure is told once, and does not stop the next wish', async () => {
  const { flights, shown, errors, loader } = rig();
  loader.want(wish('a'), [wish('b')]);
  flights[0].reject();
  await settle();
  assert.deepEqual(errors, ['a']);
  flights[1].reject();
  await settle();
  assert.deepEqual(errors, ['a'], 'of a neighbour nobody hears');
  assert.equal(flights.length, 2, 'it is not tried again');
  loader.want(wish('c'));
  flights[2].resolve();
  await settle();
  assert.deepEqual(shown, ['c']);
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
