// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { LatencyMeter, PARTS, judged, limitOf, overloadOf, splitLatency } from '../../../clients/web/core/latency.js';
import { Series, polylines, roundTop } from '../../../clients/web/core/series.js';

const frame = { queueUs: 4000, renderUs: 20000, encodeUs: 3000, bytes: 50000 };
const sum = (parts) => PARTS.reduce((total, name) => total + parts[name], 0);

test('the parts of the latency sum up to the total, and the rest is the network', () => {
  const parts = splitLatency(50, frame, { waited: 2, decode: 6 });
  assert.deepEqual(parts, { network: 15, queue: 6, render: 20, encode: 3, browser: 6 });
  const cached = splitLatency(11, frame, { waited: 2, decode: 6 });
  assert.equal(cached.network, 0);
  assert.ok(Math.abs(sum(cached) - 11) < 1e-9, 'a picture from the cache states an earlier render time');
});

test('what the link does not explain is the wait for this browser', () => {
  const split = (bandwidth) => splitLatency(80, frame, { waited: 2, decode: 6, link: { rtt_ms: 5, bandwidth } });
  assert.deepEqual(split(12.5e6), { network: 9, queue: 6, render: 20, encode: 3, browser: 42 });
  assert.deepEqual(split(1e6), { network: 45, queue: 6, render: 20, encode: 3, browser: 6 }, 'a slow link explains all of it');
  assert.deepEqual(split(0), split(1e6), 'the link is not known yet');
  for (const bandwidth of [12.5e6, 1e6]) assert.ok(Math.abs(sum(split(bandwidth)) - 80) < 1e-9);
  assert.deepEqual(limitOf(split(12.5e6)), ['browser', 42]);
  assert.deepEqual(limitOf(split(1e6)), ['network', 45]);
  assert.deepEqual(limitOf(splitLatency(40, frame)), ['renderer', 23]);
  const policy = { why: ['quality', 'bandwidth'] };
  assert.equal(overloadOf({ policy, isMoving: true, latency: split(12.5e6), detail: 50 }), 'browser');
  assert.equal(overloadOf({ policy, isMoving: true, latency: split(1e6), detail: 50 }), 'bandwidth');
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
  const slow = { queue: 20, network: 60, render: 20, encode: 5, browser: 5 };
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
  const busy = { queue: 20, network: 12, render: 40, encode: 5, browser: 5 };
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
