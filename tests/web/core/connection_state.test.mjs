// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ConnectionState, STEPS } from '../../../clients/web/core/connection_state.js';

const walk = (...steps) => {
  const states = new ConnectionState();
  for (const step of steps) states.step(step);
  return states;
};
const PATHS = {
  idle: [], seeking: ['start'], waiting: ['start', 'empty'], joining: ['start', 'found'],
  live: ['start', 'found', 'opened'], draining: ['start', 'found', 'opened', 'drain'], lost: ['start', 'lose'],
  refused: ['start', 'refuse'], stopped: ['stop'],
};

test('the steps lead to a first frame, and to another frame after a loss', () => {
  const seen = [];
  const states = new ConnectionState((state, step, before) => seen.push(`${before} ${step} ${state}`));
  for (const step of ['start', 'empty', 'again', 'found', 'opened', 'lose', 'retry', 'found', 'gone', 'found', 'opened']) {
    states.step(step);
  }
  assert.equal(states.state, 'live');
  assert.equal(seen[0], 'idle start seeking');
  assert.equal(seen.at(-1), 'joining opened live');
});

test('in every state a step that is not in the table is rejected and changes nothing', () => {
  assert.deepEqual(Object.keys(PATHS).sort(), Object.keys(STEPS).sort());
  const all = new Set(Object.values(STEPS).flatMap((steps) => Object.keys(steps)));
  for (const [state, path] of Object.entries(PATHS)) {
    for (const step of [...all, 'toString', '__proto__', '']) {
      const states = walk(...path);
      assert.equal(states.state, state);
      if (Object.hasOwn(STEPS[state], step)) {
        assert.ok(states.can(step));
        states.step(step);
        assert.equal(states.state, STEPS[state][step]);
      } else {
        assert.ok(!states.can(step));
        assert.throws(() => states.step(step), /is not a step/);
        assert.equal(states.state, state);
      }
    }
  }
});

test('stop is allowed once in every state, and is final', () => {
  for (const path of Object.values(PATHS).filter((p) => p[0] !== 'stop')) {
    const states = walk(...path, 'stop');
    assert.equal(states.state, 'stopped');
    assert.throws(() => states.step('stop'));
    assert.throws(() => states.step('retry'));
  }
});
