// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Emitter } from '../../../clients/web/core/emitter.js';
import { whenReady } from '../../../clients/web/core/ready.js';

/** A connection whose list is set by the test. */
class Connection extends Emitter {
  asked = 0;

  async refresh() { this.asked += 1; }
  list(...volumes) { this.emit('volumes', volumes); }
}

test('a volume is waited for until it is ready', async () => {
  const connection = new Connection();
  const ready = whenReady(connection, 'a');
  assert.equal(connection.asked, 1);
  const done = { id: 'a', state: 'ready' };
  connection.list({ id: 'b', state: 'ready' }); // a list from before it was asked for
  connection.list({ id: 'a', state: 'loading' });
  connection.list({ id: 'b', state: 'ready' }, done);
  assert.equal(await ready, done);
});

test('a volume that fails or is closed rejects', async () => {
  const connection = new Connection();
  const failed = whenReady(connection, 'a');
  connection.list({ id: 'a', state: 'failed', reason: 'a.nrrd: it has 3 axes' });
  await assert.rejects(failed, { message: 'a.nrrd: it has 3 axes' });
  const closed = whenReady(connection, 'b');
  connection.list({ id: 'b', state: 'loading' });
  connection.list();
  await assert.rejects(closed, { message: '' });
});
