// SPDX-License-Identifier: Apache-2.0
// Start-up, limits, failing renders and shutdown.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { closeSync, constants, mkdtempSync, openSync, readlinkSync, rmSync, writeFileSync, writeSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, Raw, redirected, runToEnd, Stream, within } from './harness.mjs';

let folder;
before(() => { folder = mkdtempSync(path.join(tmpdir(), 'splatd-life-')); });
after(() => rmSync(folder, { recursive: true }));

function file(name, text) {
  const at = path.join(folder, name);
  writeFileSync(at, text);
  return at;
}

test('--help, --version, --print-config', async () => {
  const help = await runToEnd(['--help']);
  assert.equal(help.status, 0);
  for (const text of ['--listen', '--token-file', '--render-queue', 'demo:NAME', 'null']) assert.ok(help.out.includes(text), text);
  const version = await runToEnd(['--version']);
  assert.match(version.out, /^splatd \d+\.\d+\.\d+\n$/);
  const printed = await runToEnd(['--memory', '3G', '--volume', 'demo:engine', '--print-config']);
  assert.match(printed.out, /^memory = 3G$/m);
  // --config reads what --print-config prints.
  const again = await runToEnd(['--config', file('printed', printed.out), '--print-config']);
  assert.equal(again.out, printed.out);
});

test('output that cannot be written makes the program fail, also for the ready line', async () => {
  for (const [redirection, why] of [['>/dev/full', 'No space left on device'], ['>&-', 'Bad file descriptor']]) {
    for (const args of [['--help'], ['--version'], ['--print-config'], ['--probe'], ['--listen', '127.0.0.1:0', '--backend', 'null']]) {
      const { status, err } = await runToEnd(args, { prefix: redirected(redirection) });
      assert.equal(status, 1, `${args} ${redirection}: ${err}`);
      assert.equal(err.trim().split('\n').at(-1), `splatd: standard output: cannot write: ${why}`);
    }
  }
});

test('closed standard descriptors are opened on /dev/null, so that no connection gets their number', async () => {
  const daemon = await Daemon.start([], { prefix: redirected('<&- 2>&-') });
  for (const fd of [0, 2]) assert.equal(readlinkSync(`/proc/${daemon.child.pid}/fd/${fd}`), '/dev/null');
  assert.equal(await daemon.stop(), 0);
});

test('with --end-with-input the daemon ends when standard input closes', async () => {
  const daemon = await Daemon.start(['--end-with-input'], { stdin: 'pipe' });
  daemon.child.stdin.write('what comes before is dropped\n');
  assert.equal((await fetch(`${daemon.base}/readyz`)).status, 200);
  daemon.child.stdin.end();
  assert.equal(await daemon.ended, 0);
  assert.match(daemon.log, /received signal 15/);
});

test('wrong options give exit status 2 and an error message', async () => {
  for (const [args, text] of [
    [['--nonsense'], /^splatd: --nonsense: unknown option/], [['--threads'], /^splatd: --threads: needs a value/],
    [['--threads', 'many'], /whole number in \[0, 256\]/], [['--memory', '1Q'], /^splatd: --memory: .*size/],
    [['volume.nrrd'], /^splatd: volume.nrrd: unexpected argument/], [['--listen', 'nowhere'], /ADDRESS:PORT/],
    [['--listen', '0.0.0.0:0'], /TLS.*--token-file/], [['--backend', 'abacus', '--listen', '127.0.0.1:0'], /abacus/],
    [['--config', file('bad', '# fine\nlisten = 127.0.0.1:0\nnonsense = 1\n')], /bad:3: unknown setting 'nonsense'/],
    [['--log-level', 'loud'], /--log-level/], [['--log-format', 'xml'], /--log-format: 'xml' is not one of/], [['--token-file', file('short', 'abc\n'), '--listen', '127.0.0.1:0'], /16 to 128/]]) {
    const { status, out, err } = await runToEnd(args);
    assert.equal(status, 2, `${args}: ${err}`);
    assert.equal(out, '');
    assert.match(err.trim().split('\n').at(-1), text);
  }
  const absent = await runToEnd(['--listen', '127.0.0.1:0', '--volume', '/nonexistent.nrrd']);
  assert.equal(absent.status, 1);
  assert.match(absent.err, /splatd: \/nonexistent.nrrd: cannot open/);
  assert.equal((await runToEnd(['--config', '/nonexistent'])).status, 1);
  for (const [args, wanted, text] of [
    [['--volume', 'demo:nope'], 1, /demo:nope: no such built-in volume; the built-in volumes are .*engine/],
    [['--volume', 'demo:engine?size=-1'], 2, /demo:engine\?size=-1: .*\?size=N/],
    [['--data', file('no-folder', '')], 1, /no-folder: cannot use this folder for --data/]]) {
    const { status, out, err } = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', ...args]);
    assert.equal(status, wanted, err);
    assert.equal(out, '');
    assert.match(err.trim().split('\n').at(-1), text);
  }
});

test('the error about a port in use names the port', async () => {
  const daemon = await Daemon.start([]);
  const second = await runToEnd(['--listen', `127.0.0.1:${daemon.port}`, '--backend', 'null']);
  assert.equal(second.status, 1);
  assert.match(second.err, new RegExp(`splatd: 127.0.0.1:${daemon.port}: the port is in use`));
  assert.equal(await daemon.stop(), 0);
});

test('a token from a file is used and not printed', async () => {
  const token = 'a-token-of-a-file-0123456789';
  const daemon = await Daemon.start(['--token-file', file('token', `${token}\n`)]);
  assert.ok(!daemon.out.includes(token));
  assert.ok(!daemon.log.includes(token));
  assert.equal((await daemon.json('/api/v1/volumes', { token })).status, 200);
  assert.equal((await daemon.json('/api/v1/volumes', { token: 'another' })).status, 401);
  assert.equal(await daemon.stop(), 0);
});

test('a daemon without volumes reports that', async () => {
  const daemon = await Daemon.start([]);
  assert.equal((await daemon.json('/readyz', { token: null })).status, 200);
  const { status, json } = await daemon.post('/api/v1/sessions', {});
  assert.equal(status, 422);
  assert.match(json.detail, /no volume is loaded/);
  assert.equal(await daemon.stop(), 0);
});

test('sessions, participants and the render queue are limited, and idle sessions end', async () => {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--sessions', '2', '--participants', '2',
    '--session-time', '0.3', '--render-queue', '1', '--encode-threads', '1']);
  await daemon.loaded('engine');
  const session = await daemon.session();
  const streams = [await daemon.stream({ session }), await daemon.stream({ session })];
  await streams[0].note('session.participants', (p) => p.participants.length === 2);
  await assert.rejects(Stream.open(daemon.streamUrl(session)), { status: 503 });
  await daemon.session();
  const { status, headers, json } = await daemon.post('/api/v1/sessions', {});
  assert.equal(status, 503);
  assert.equal(headers.get('retry-after'), '1');
  assert.match(json.detail, /--sessions allows 2/);
  await daemon.untilLogged('ended: no client joined');
  assert.equal((await daemon.post('/api/v1/sessions', {})).status, 201);
  // Large PNG images keep the only encoder busy: of many concurrent requests some must be refused, and none may hang.
  const answers = await Promise.all(Array.from({ length: 16 }, (_, i) => daemon.post('/api/v1/render?format=png', '', {
    body: JSON.stringify({ size: [1500, 1500 + i] }),
  }).catch((e) => (e instanceof SyntaxError ? { status: 200 } : Promise.reject(e)))));
  const statuses = answers.map((a) => a.status);
  assert.ok(statuses.includes(200), `${statuses}`);
  assert.ok(statuses.includes(503), `${statuses}`);
  assert.ok(statuses.every((s) => s === 200 || s === 503), `${statuses}`);
  await Promise.all(streams.map((s) => s.end()));
  assert.equal(await daemon.stop(), 0);
});

test('a view that the backend cannot render is refused; the session continues', async () => {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--threads', '2'], { backend: 'cpu' });
  await daemon.loaded('engine');
  const wrong = { shading: { occlusion: 1 }, compositing: { mode: 'slab' } };
  const answer = await daemon.post('/api/v1/render', wrong);
  assert.equal(answer.status, 422);
  assert.equal(answer.json.pointer, '/shading/occlusion');
  const stream = await daemon.stream({ session: await daemon.session({ size: [64, 64] }) });
  await assert.rejects(stream.update(wrong), (e) => e.code === -32001 && e.data.pointer === '/shading/occlusion');
  await stream.update({ background: [1, 1, 1, 1] }, 8);
  await stream.final(8);
  await stream.end();
  assert.equal(await daemon.stop(), 0);
});

test('a failed render is reported to its session and does not end the daemon', async (t) => {
  if (process.env.SPLATD_SANITIZE) {
    t.skip('a sanitizer needs the address space that this test limits');
    return;
  }
  // Leaves too little address space for a frame of 8192×8192 pixels.
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--memory', '64M', '--frame-size', '8192x8192'],
    { prefix: ['bash', '-c', 'ulimit -v 700000; exec "$@"', 'bash'] });
  await daemon.loaded('engine');
  const large = await daemon.post('/api/v1/render', { size: [8192, 8192] });
  assert.equal(large.status, 503);
  assert.match(large.json.detail, /memory/);
  const session = await daemon.session({ size: [64, 64] });
  const [small, huge] = [await daemon.stream({ session }), await daemon.stream({ session })];
  await huge.call('stream.configure', { size: [8192, 8192], progressive: false });
  const { params } = await huge.note('render.error');
  assert.match(params.message, /memory/);
  compare(params.code, '<', 0);
  await small.update({ background: [1, 1, 1, 1] }, 8);
  await small.final(8);
  await huge.call('stream.configure', { size: [32, 32] });
  await huge.frame((f) => f.width === 32, 'a frame again');
  await Promise.all([small.end(), huge.end()]);
  assert.equal(await daemon.stop(), 0);
});

for (const signal of ['SIGTERM', 'SIGINT']) {
  test(`${signal} drains: clients are notified, running renders finish, exit status 0`, async () => {
    const daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--volume', 'demo:marschner-lobb?size=400']);
    await daemon.loaded('engine');
    const stream = await daemon.stream();
    await stream.final(0);
    const body = JSON.stringify({ volume: 'engine', size: [1000, 1000] });
    const raw = await Raw.begin(daemon, '/api/v1/render?format=png', body.length + 1);
    raw.write(body);
    // The request lacks its last byte until the daemon has refused another one.
    daemon.kill(signal);
    await stream.note('server.draining');
    // A new request is refused at once, even before its body arrives.
    const late = await Raw.connect(daemon.port);
    late.write('POST /api/v1/render HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n');
    await late.until(() => late.text().includes('shutting down'), 'the refusal');
    for (const part of [/^HTTP\/1.1 503/, /^Retry-After: 1\r$/m, /^Connection: close\r$/m]) assert.match(late.text(), part);
    late.destroy();
    raw.write(' ');
    await raw.until(() => raw.text().includes('\r\n\r\n'), 'the answer');
    assert.match(raw.text(), /^HTTP\/1.1 200/);
    const size = Number(/Content-Length: (\d+)/.exec(raw.text())[1]);
    await raw.until(() => raw.bytes.length === raw.bytes.indexOf('\r\n\r\n') + 4 + size, 'the whole image');
    const { code } = await stream.until(() => stream.closed, 'the close');
    assert.equal(code, 1001);
    assert.equal(await within(daemon.ended, 'the end of the daemon'), 0, daemon.log);
    assert.match(daemon.log, /stopped/);
    await assert.rejects(Raw.connect(daemon.port));
  });
}

test('failed starts and shutdowns under traffic have the documented exit status', async () => {
  const absent = path.join(folder, 'absent.nrrd');
  for (let i = 0; i < 20; i++) {
    const { status, err } = await runToEnd(['--listen', '127.0.0.1:0', '--backend', 'null', '--volume', absent]);
    assert.equal(status, 1, err);
  }
  for (let i = 0; i < 8; i++) {
    const daemon = await Daemon.start([]);
    const traffic = Array.from({ length: 4 }, async () => {
      for (;;) await daemon.json('/healthz');
    });
    await Promise.all(Array.from({ length: 4 }, () => daemon.json('/healthz')));
    const ended = Promise.all(traffic.map((t) => t.catch(() => {})));
    assert.equal(await daemon.stop(), 0, daemon.log);
    await ended;
  }
});

test('a second signal ends the daemon at once', async () => {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=16', '--drain-time', '500']);
  await daemon.loaded('engine');
  const raw = await Raw.begin(daemon, '/api/v1/render', 100);
  raw.write('{');
  const stream = await daemon.stream();
  daemon.kill('SIGTERM');
  await stream.note('server.draining');
  daemon.kill('SIGTERM');
  assert.equal(await within(daemon.ended, 'the end of the daemon'), 1);
  raw.destroy();
});

test('the first image of a built-in volume is rendered', async () => {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=32'], { backend: 'auto' });
  await daemon.loaded('engine');
  const answer = await daemon.fetch('/api/v1/render?format=png', { method: 'POST', body: '{"size": [96, 96]}', headers: { 'Content-Type': 'application/json' } });
  assert.equal(answer.status, 200);
  compare(Number(answer.headers.get('x-splats')), '>', 0);
  compare((await answer.arrayBuffer()).byteLength, '>', 500);
  assert.equal(await daemon.stop(), 0);
});


test('a log pipe without a reader delays neither requests nor shutdown', async () => {
  const fifo = path.join(folder, 'log');
  execFileSync('mkfifo', [fifo]);
  const filler = openSync(fifo, constants.O_RDWR | constants.O_NONBLOCK);
  try {
    assert.throws(() => { for (;;) writeSync(filler, Buffer.alloc(4096)); }, { code: 'EAGAIN' });
    const prefix = ['sh', '-c', `exec "$0" "$@" 2>'${fifo}'`];
    const daemon = await Daemon.start(['--volume', 'demo:engine?size=8', '--log-level', 'debug'], { prefix });
    await daemon.loaded('engine');
    assert.equal((await daemon.post('/api/v1/sessions', {})).status, 201);
    assert.equal((await daemon.fetch('/healthz')).status, 200);
    daemon.kill('SIGTERM');
    assert.equal(await within(daemon.ended, 'the end of the daemon'), 0);
  } finally {
    closeSync(filler);
  }
});
