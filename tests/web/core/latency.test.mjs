// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { LatencyMeter, PARTS, judged, overloadOf, splitLatency } from '../../../clients/web/core/latency.js';
import { Series, polylines, roundTop } from '../../../clients/web/core/series.js';

const frame = { queueUs: 4000, renderUs: 20000, encodeUs: 3000 };
const sum = (parts) => PARTS.reduce((total, name) => total + parts[name], 0);

test('the parts of the latency sum up to the total, and the rest is the network', () => {
  const parts = splitLatency(50, frame, { waited: 2, decode: 6 });
  assert.deepEqual(parts, { network: 15, queue: 6, render: 20, encode: 3, decode: 6 });
  const cached = splitLatency(11, frame, { waited: 2, decode: 6 });
  assert.equal(cached.network, 0);
  assert.ok(Math.abs(sum(cached) - 11) < 1e-9, 'a picture from the cache states an earlier render time');
});

test('the meter averages the last second', () => {
  const meter = new LatencyMeter();
  assert.equal(meter.mean(), null);
  meter.put(0, 900, splitLatency(900, frame));
  meter.put(5000, 40, splitLatency(40, frame));
  meter.put(5500, 60, splitLatency(60, frame));
  const mean = meter.mean();
  assert.equal(mean.total, 50);
  assert.ok(Math.abs(sum(mean) - 50) < 1e-9);
  for (let i = 0; i < 100; i++) meter.put(6000 + i, 10, splitLatency(10, frame));
  assert.equal(meter.mean().total, 10);
  meter.clear();
  assert.equal(meter.mean(), null);
});

test('offline comes before a busy daemon, that before a long queue, that before reduced quality', () => {
  const latency = { queue: 400 };
  const slow = { queue: 20, network: 60, render: 20, encode: 5, decode: 5 };
  const policy = { why: ['quality', 'time', 'bandwidth'] };
  const all = { isOnline: false, error: { status: 503 }, latency, policy, isMoving: true };
  assert.equal(overloadOf(all), 'offline');
  assert.equal(overloadOf({ ...all, isOnline: true }), 'busy');
  assert.equal(overloadOf({ ...all, isOnline: true, error: { status: 404 } }), 'queue');
  assert.equal(overloadOf({ policy, isMoving: true, latency: slow }), 'bandwidth');
  assert.equal(overloadOf({ policy, isMoving: true, detail: 50 }), 'time');
  assert.equal(overloadOf({ policy: { why: ['time'] }, isMoving: true, detail: 100 }), null, 'a picture in full detail is not said to have less');
  assert.equal(overloadOf({ policy: { why: ['shared_time'] }, isMoving: true, detail: 50 }), 'shared_time');
  assert.equal(overloadOf({ policy: { why: ['quality'] }, isMoving: true }), null, 'the usual quality of a moving view is no news');
  assert.equal(overloadOf({ policy, latency }), null, 'a view at rest has full quality');
});

test('the network is slow only if pictures wait for it longer than for the work on them', () => {
  const policy = { why: ['quality', 'bandwidth'] };
  const busy = { queue: 20, network: 12, render: 40, encode: 5, decode: 5 };
  const slow = { ...busy, network: 90 };
  assert.equal(overloadOf({ policy, isMoving: true, latency: busy, detail: 50 }), 'time');
  assert.equal(overloadOf({ policy, isMoving: true, detail: 50 }), 'time', 'no picture has been measured yet');
  assert.equal(overloadOf({ policy, isMoving: true, latency: slow }), 'bandwidth');
  assert.deepEqual(judged(policy, busy), { why: ['quality'] });
  assert.equal(judged(policy, slow), policy);
  assert.equal(judged(null, busy), null);
});

test('a series merges values per second, forgets old ones and shows gaps', () => {
  const mean = new Series({ span: 4000 });
  const rate = new Series({ span: 4000, merge: 'sum' });
  for (const [time, value] of [[100, 1], [900, 3], [2100, 5], [2200, NaN]]) {
    mean.put(time, value);
    rate.put(time, value);
  }
  assert.deepEqual(mean.values(4000), [2, null, 5, null]);
  assert.deepEqual(rate.values(4000, 0), [4, 0, 5, 0]);
  assert.deepEqual(mean.values(5000), [null, 5, null, null]);
  const most = new Series({ span: 2000, merge: 'max' });
  most.put(0, 1);
  most.put(1, 9);
  most.put(2, 3);
  assert.deepEqual(most.values(1000), [null, 9]);
});

test('graphs have runs without gaps and a round top', () => {
  assert.deepEqual(polylines([0, 5, null, 10], 30, 10, 10), ['0.0,10.0 10.0,5.0', '30.0,0.0 30.0,0.0']);
  assert.equal(roundTop([]), 1);
  assert.equal(roundTop([null, 37]), 50);
  assert.equal(roundTop([100]), 100);
  assert.equal(roundTop([101]), 200);
  assert.equal(roundTop([0.2], 0.1), 0.2);
});
