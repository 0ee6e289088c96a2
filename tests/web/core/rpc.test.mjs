// SPDX-License-Identifier: Apache-2.0
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { Rpc, RpcError } from '../../../clients/web/core/rpc.js';

function setUp() {
  const it = { written: [], told: [] };
  it.rpc = new Rpc({
    write: (text) => it.written.push(JSON.parse(text)),
    notified: (method, params) => it.told.push([method, params]),
  });
  return it;
}

test('answers in any order resolve the right calls', async () => {
  const it = setUp();
  const [first, second] = [it.rpc.call('ping'), it.rpc.call('view.update', { seq: 1 })];
  assert.deepEqual(it.written[0], { jsonrpc: '2.0', id: 1, method: 'ping', params: {} });
  it.rpc.take('{"jsonrpc":"2.0","id":2,"result":{"seq":1}}');
  it.rpc.take('{"jsonrpc":"2.0","id":1,"result":{}}');
  assert.deepEqual(await second, { seq: 1 });
  assert.deepEqual(await first, {});
});

test('an error carries its code and pointer', async () => {
  const it = setUp();
  const call = it.rpc.call('view.update');
  it.rpc.take('{"jsonrpc":"2.0","id":1,"error":{"code":-32000,"message":"too wide","data":{"pointer":"/size/0"}}}');
  await assert.rejects(call, (e) => e instanceof RpcError && e.code === -32000 && e.pointer === '/size/0' && e.message === 'too wide');
});

test('notifications work in both directions without an id', () => {
  const it = setUp();
  it.rpc.notify('stream.ack', { frame: 3 });
  assert.deepEqual(it.written, [{ jsonrpc: '2.0', method: 'stream.ack', params: { frame: 3 } }]);
  it.rpc.take('{"jsonrpc":"2.0","method":"server.draining"}');
  assert.deepEqual(it.told, [['server.draining', {}]]);
});

test('invalid messages throw, and open calls continue', async () => {
  const it = setUp();
  const call = it.rpc.call('ping');
  for (const text of ['', '{', 'null', '[]', '{"jsonrpc":"1.0","id":1,"result":{}}', '{"jsonrpc":"2.0","id":77,"result":{}}',
    '{"jsonrpc":"2.0","id":null,"error":{"code":-32700,"message":"not JSON"}}']) {
    assert.throws(() => it.rpc.take(text), Error, text);
  }
  it.rpc.take('{"jsonrpc":"2.0","id":1,"result":"still here"}');
  assert.equal(await call, 'still here');
});

test('closing rejects open calls', async () => {
  const it = setUp();
  const calls = [it.rpc.call('ping'), it.rpc.call('ping')];
  it.rpc.close(new Error('gone'));
  for (const call of calls) await assert.rejects(call, /gone/);
});
