// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Machine, STEPS } from '../../../clients/web/core/machine.js';

const walk = (...steps) => {
  const machine = new Machine();
  for (const step of steps) machine.step(step);
  return machine;
};
const PATHS = {
  idle: [], seeking: ['start'], waiting: ['start', 'empty'], joining: ['start', 'found'],
  live: ['start', 'found', 'opened'], draining: ['start', 'found', 'opened', 'drain'], lost: ['start', 'lose'],
  refused: ['start', 'refuse'], stopped: ['stop'],
};

test('the way to a picture, and back to one after a loss', () => {
  const seen = [];
  const machine = new Machine((state, step, before) => seen.push(`${before} ${step} ${state}`));
  for (const step of ['start', 'empty', 'again', 'found', 'opened', 'lose', 'retry', 'found', 'gone', 'found', 'opened']) {
    machine.step(step);
  }
  assert.equal(machine.state, 'live');
  assert.equal(seen[0], 'idle start seeking');
  assert.equal(seen.at(-1), 'joining opened live');
});

test('every step that is not in the table is rejected, in every state, and changes nothing', () => {
  assert.deepEqual(Object.keys(PATHS).sort(), Object.keys(STEPS).sort());
  const all = new Set(Object.values(STEPS).flatMap((steps) => Object.keys(steps)));
  for (const [state, path] of Object.entries(PATHS)) {
    for (const step of [...all, 'toString', '__proto__', '']) {
      const machine = walk(...path);
      assert.equal(machine.state, state);
      if (Object.hasOwn(STEPS[state], step)) {
        assert.ok(machine.can(step));
        machine.step(step);
        assert.equal(machine.state, STEPS[state][step]);
      } else {
        assert.ok(!machine.can(step));
        assert.throws(() => machine.step(step), /is not a step/);
        assert.equal(machine.state, state);
      }
    }
  }
});

test('stop is possible everywhere, once, and final', () => {
  for (const path of Object.values(PATHS).filter((p) => p[0] !== 'stop')) {
    const machine = walk(...path, 'stop');
    assert.equal(machine.state, 'stopped');
    assert.throws(() => machine.step('stop'));
    assert.throws(() => machine.step('retry'));
  }
});
