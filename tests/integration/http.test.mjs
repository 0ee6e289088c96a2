// SPDX-License-Identifier: Apache-2.0
// Every route of the HTTP interface: its results and its errors.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, rmSync, symlinkSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { Daemon, nrrd, Raw } from './harness.mjs';

const PATCHES = 'application/json, application/merge-patch+json';

let daemon;
let folder;

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-data-'));
  mkdirSync(path.join(folder, 'data'));
  writeFileSync(path.join(folder, 'data', 'cube.nrrd'), nrrd());
  writeFileSync(path.join(folder, 'data', 'short.nrrd'), nrrd(Buffer.alloc(10)));
  writeFileSync(path.join(folder, 'data', 'rubbish.nrrd'), Buffer.from('\x00\xff\xfenot a volume'));
  writeFileSync(path.join(folder, 'secret.nrrd'), nrrd());
  symlinkSync('../secret.nrrd', path.join(folder, 'data', 'link.nrrd'));
  writeFileSync(path.join(folder, 'data', 'lying.nrrd'),
    'NRRD0004\ntype: double\ndimension: 3\nsizes: 4000 4000 4000\nencoding: raw\n\n');
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--data', path.join(folder, 'data'), '--memory', '64M']);
  await daemon.loaded('engine');
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

function isProblem({ status, headers, json }, expected, detail = /./) {
  assert.equal(status, expected);
  assert.equal(headers.get('content-type'), 'application/problem+json');
  assert.equal(json.status, expected);
  assert.ok(json.type);
  assert.ok(json.title);
  assert.match(json.detail, detail);
}

test('health and readiness need no token', async () => {
  const health = await daemon.json('/healthz', { token: null });
  assert.deepEqual([health.status, health.json], [200, { status: 'ok' }]);
  const ready = await daemon.json('/readyz', { token: null });
  assert.equal(ready.status, 200);
  assert.equal(ready.json.backend, 'null');
  assert.deepEqual(ready.json.refused, []);
});

test('routes under /api need the token, by header or query, and reveal nothing without it', async () => {
  for (const target of ['/api/v1/volumes', '/api/v1/volumes/engine', '/api/v1/nothing', '/api/v1/views', '/api/v1/sessions/0']) {
    const answer = await daemon.json(target, { token: null });
    isProblem(answer, 401, /^a token is missing; /);
    assert.match(answer.headers.get('www-authenticate'), /^Bearer realm="splatd"$/);
    for (const token of [`${daemon.token}0`, daemon.token.slice(1), 'x']) {
      const unknown = await daemon.json(target, { token });
      isProblem(unknown, 401, /^the daemon does not know this token; /);
      assert.match(unknown.headers.get('www-authenticate'), /^Bearer .*error="invalid_token"$/);
    }
  }
  assert.equal((await daemon.json(`/api/v1/volumes?token=${daemon.token}`, { token: null })).status, 200);
});

test('the page has content types, a content security policy and cache headers', async () => {
  const page = await daemon.fetch('/', { token: null });
  assert.equal(page.status, 200);
  assert.equal(page.headers.get('content-type'), 'text/html; charset=utf-8');
  assert.match(page.headers.get('content-security-policy'), /default-src 'none'/);
  assert.equal(page.headers.get('x-content-type-options'), 'nosniff');
  assert.equal(page.headers.get('cache-control'), 'no-cache');
  const html = await page.text();
  const etag = page.headers.get('etag');
  const again = await daemon.fetch('/', { token: null, headers: { 'If-None-Match': etag } });
  assert.deepEqual([again.status, await again.text()], [304, '']);
  const links = [...html.matchAll(/(?:src|href)="([^":]+)"/g)].map((m) => m[1]);
  compare(links.length, '>=', 3);
  const types = { js: 'text/javascript; charset=utf-8', css: 'text/css; charset=utf-8', svg: 'image/svg+xml' };
  for (const link of links) {
    const file = await daemon.fetch(`/${link}`, { token: null });
    assert.equal(file.status, 200, link);
    assert.equal(file.headers.get('content-type'), types[link.split('.').pop()]);
    compare((await file.arrayBuffer()).byteLength, '>', 0);
  }
  isProblem(await daemon.json('/nothing.js', { token: null }), 404);
  isProblem(await daemon.json('/..%2f..%2fetc%2fpasswd', { token: null }), 404);
});

test('HEAD returns the headers of GET', async () => {
  const headers = { 'Accept-Encoding': 'identity' };
  const head = await daemon.fetch('/api/v1/volumes', { method: 'HEAD', headers });
  const get = await daemon.fetch('/api/v1/volumes', { headers });
  assert.equal(head.status, 200);
  assert.equal(head.headers.get('content-length'), String((await get.arrayBuffer()).byteLength));
  assert.equal(await head.text(), '');
});

test('the contract is served without a token', async () => {
  for (const file of ['openapi.json', 'openapi.yaml', 'view.schema.json', 'stream.schema.json', 'stream.md']) {
    assert.equal((await daemon.fetch(`/api/v1/${file}`, { token: null })).status, 200, file);
  }
  const bundle = await daemon.json('/api/v1/openapi.json');
  assert.deepEqual([bundle.status, bundle.headers.get('content-type')], [200, 'application/json']);
  assert.match(bundle.json.openapi, /^3\.1/);
  const schema = await daemon.json('/api/v1/view.schema.json');
  assert.equal(schema.status, 200);
  assert.match(schema.json.$schema, /2020-12/);
  const api = await daemon.fetch('/api/v1/openapi.yaml');
  assert.equal(api.status, 200);
  assert.match(await api.text(), /^openapi: "?3\.1/m);
  const stream = await daemon.fetch('/api/v1/stream.md');
  assert.deepEqual([stream.status, stream.headers.get('content-type')], [200, 'text/markdown; charset=utf-8']);
});

test('the daemon has exactly the paths and methods of the contract', async () => {
  const text = await (await daemon.fetch('/api/v1/openapi.yaml')).text();
  const paths = new Map();
  let at;
  for (const line of text.slice(text.indexOf('\npaths:')).split('\n').slice(2)) {
    if (/^\S/.test(line)) break;
    const [, target] = /^ {2}(\/\S*):/.exec(line) ?? [];
    const [, method] = /^ {4}(get|post|patch|delete|put|options):/.exec(line) ?? [];
    if (target) paths.set(target, at = []);
    if (method) at.push(method.toUpperCase());
  }
  compare(paths.size, '>=', 10);
  for (const [target, methods] of paths) {
    const answer = await daemon.json(target.replace(/\{\w+\}/, 'engine'), { method: 'PROPFIND' });
    isProblem(answer, 405);
    const allowed = answer.headers.get('allow').split(', ').filter((m) => m !== 'HEAD');
    assert.deepEqual(allowed.sort(), methods.sort(), target);
    const kind = target.startsWith('/api/v1/uploads') ? 'application/offset+octet-stream' : PATCHES;
    assert.equal(answer.headers.get('accept-patch'), methods.includes('PATCH') ? kind : null, target);
  }
});

test('other methods get 405 with Allow, other paths get 404', async () => {
  const answer = await daemon.json('/api/v1/volumes/engine', { method: 'PUT' });
  isProblem(answer, 405);
  assert.deepEqual(answer.headers.get('allow').split(', ').sort(), ['DELETE', 'GET', 'HEAD']);
  const head = await daemon.fetch('/api/v1/render', { method: 'HEAD' });
  assert.equal(head.status, 405);
  assert.equal(head.headers.get('allow'), 'POST');
  isProblem(await daemon.json('/', { method: 'POST', token: null }), 405);
  isProblem(await daemon.json('/api/v1/volume'), 404);
  isProblem(await daemon.json('/api/v1/volumes/'), 404);
  isProblem(await daemon.json('/api/v1/volumes/engine/'), 404);
});

test('volumes are listed, described, and have a default view', async () => {
  const { json } = await daemon.json('/api/v1/volumes');
  const engine = json.volumes.find((v) => v.id === 'engine');
  assert.equal(engine.state, 'ready');
  assert.equal(engine.progress, 1);
  assert.equal(engine.dims.length, 3);
  assert.equal(engine.histogram, undefined);
  const one = (await daemon.json('/api/v1/volumes/engine')).json;
  assert.equal(one.histogram.counts.length, 256);
  assert.equal(one.histogram.counts.reduce((a, b) => a + b), one.dims.reduce((a, b) => a * b));
  assert.equal(one.memory.voxels, one.bytes);
  assert.equal(one.memory.derived_per_voxel, 0); // the test-card backend caches nothing per volume
  const view = (await daemon.json('/api/v1/volumes/engine/view')).json;
  assert.equal(view.volume, 'engine');
  assert.deepEqual(view.size, [512, 512]);
  isProblem(await daemon.json('/api/v1/volumes/nope'), 404, /nope/);
  isProblem(await daemon.json('/api/v1/volumes/nope/view'), 404);
});

test('memory is reported, with vectors; cached data of an 8-bit volume take at most two bytes per voxel', async () => {
  const real = await Daemon.start(['--volume', 'demo:engine?size=64', '--volume', 'demo:jet?size=32'], { backend: 'cpu' });
  await real.loaded('engine');
  const jet = await real.loaded('jet');
  assert.deepEqual(jet.fields.map(({ name, components, type }) => [name, components, type]), [['magnitude', 1, 'float32'], ['wind', 3, 'float32']]);
  assert.deepEqual(jet.fields[0].range, jet.range);
  assert.equal(jet.bytes, 32 * 16 * 8 * (1 + 3) * 4);
  assert.equal(jet.memory.voxels, jet.bytes);
  for (const shading of ['none', 'phong']) {
    const snapshot = await real.fetch('/api/v1/render', {
      method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify({ size: [64, 64], shading: { mode: shading } }),
    });
    assert.equal(snapshot.status, 200);
    const { memory, dims } = (await real.json('/api/v1/volumes/engine')).json;
    compare(memory.derived, '>', 0);
    assert.equal(memory.derived_per_voxel, memory.derived / dims.reduce((a, b) => a * b));
    compare(memory.derived_per_voxel, '<=', 2, `${memory.derived_per_voxel} bytes per voxel`);
  }
  await real.stop();
});

test('a volume is loaded once, shared, and can be closed while a session shows it', async () => {
  const first = await daemon.post('/api/v1/volumes', { source: 'cube.nrrd', id: 'cube', name: 'A cube' });
  assert.equal(first.status, 202);
  assert.equal(first.headers.get('location'), 'volumes/cube');
  const loaded = await daemon.loaded('cube');
  assert.equal(loaded.state, 'ready', loaded.reason);
  assert.equal(loaded.name, 'A cube');
  assert.deepEqual(loaded.dims, [4, 4, 4]);
  const again = await daemon.post('/api/v1/volumes', { path: './cube.nrrd' });
  assert.equal(again.status, 201);
  assert.equal(again.json.id, 'cube');
  isProblem(await daemon.post('/api/v1/volumes', { uri: 'demo:phantom?size=8', id: 'cube' }), 409, /belongs/);
  const session = await daemon.session({ volume: 'cube' });
  assert.equal((await daemon.fetch('/api/v1/volumes/cube', { method: 'DELETE' })).status, 204);
  assert.equal((await daemon.json(`/api/v1/sessions/${session.id}`)).json.view.volume, 'engine');
  assert.equal((await daemon.fetch(`/api/v1/sessions/${session.id}`, { method: 'DELETE' })).status, 204);
  isProblem(await daemon.json('/api/v1/volumes/cube', { method: 'DELETE' }), 404);
});

test('files outside the data folder are reported as missing', async () => {
  for (const file of ['../secret.nrrd', 'link.nrrd', '../absent.nrrd', 'absent.nrrd']) {
    isProblem(await daemon.post('/api/v1/volumes', { path: file }), 404, /below the data folder/);
  }
  for (const file of ['/etc/passwd', path.join(folder, 'secret.nrrd'), path.join(folder, 'data', 'cube.nrrd')]) {
    isProblem(await daemon.post('/api/v1/volumes', { path: file }), 422, /relative to the data folder/);
  }
});

test('pipes, devices, folders, loops and odd paths in the data folder neither hang nor leak', async () => {
  const at = (name) => path.join(folder, 'data', name);
  execFileSync('mkfifo', [at('pipe.nrrd')]);
  mkdirSync(at('folder.nrrd'));
  symlinkSync('/dev/zero', at('zero.nrrd'));
  symlinkSync('/proc/self/environ', at('environ.nrrd'));
  symlinkSync('loop.nrrd', at('loop.nrrd'));
  for (const name of ['pipe', 'folder']) {
    assert.equal((await daemon.post('/api/v1/volumes', { path: `${name}.nrrd` })).status, 202);
    assert.equal((await daemon.loaded(name)).state, 'failed', name);
    assert.equal((await daemon.fetch(`/api/v1/volumes/${name}`, { method: 'DELETE' })).status, 204);
  }
  for (const file of ['zero.nrrd', 'environ.nrrd', 'loop.nrrd', './../secret.nrrd', 'folder.nrrd/../../secret.nrrd'])
    isProblem(await daemon.post('/api/v1/volumes', { path: file }), 404, /below the data folder/);
  for (const [file, status] of [['x'.repeat(300), 422], ['x/'.repeat(3000), 422], ['', 422], ['/dev/zero', 422], ['/proc/self/environ', 422]])
    isProblem(await daemon.post('/api/v1/volumes', { path: file }), status);
  isProblem(await daemon.post('/api/v1/volumes', '{"path": "cube.nrrd\\u0000/etc/passwd"}'), 400);
});

test('files that are not volumes fail with a reason and can be loaded again', async () => {
  for (const [file, reason] of [['short', /./], ['rubbish', /./], ['lying', /./]]) {
    assert.equal((await daemon.post('/api/v1/volumes', { path: `${file}.nrrd` })).status, 202);
    const volume = await daemon.loaded(file);
    assert.equal(volume.state, 'failed');
    assert.match(volume.reason, reason);
    isProblem(await daemon.json(`/api/v1/volumes/${file}/view`), 409, /failed/);
    isProblem(await daemon.post('/api/v1/render', { volume: file }), 409, /failed/);
    assert.equal((await daemon.post('/api/v1/volumes', { path: `${file}.nrrd` })).status, 202);
    await daemon.loaded(file);
    assert.equal((await daemon.fetch(`/api/v1/volumes/${file}`, { method: 'DELETE' })).status, 204);
  }
});

test('a volume over the memory budget is refused with its size and the limit', async () => {
  assert.equal((await daemon.post('/api/v1/volumes', { uri: 'demo:marschner-lobb?size=512', id: 'big' })).status, 202);
  const volume = await daemon.loaded('big');
  assert.equal(volume.state, 'failed');
  assert.match(volume.reason, /needs \d{9,} bytes and \d+ of 67108864 are free/);
});

test('load requests that name no valid volume are refused', async () => {
  isProblem(await daemon.post('/api/v1/volumes', { uri: 'demo:nope' }), 404, /demo:nope: no such built-in volume/);
  isProblem(await daemon.post('/api/v1/volumes', { uri: 'demo:engine?size=-1' }), 422, /size=N/);
  isProblem(await daemon.post('/api/v1/volumes', {}), 422);
  isProblem(await daemon.post('/api/v1/volumes', { path: 'a', uri: 'demo:engine' }), 422);
  isProblem(await daemon.post('/api/v1/volumes', { path: 3 }), 422);
  isProblem(await daemon.post('/api/v1/volumes', { uri: 'http://example.org/x' }), 422, /demo/);
  const unknown = await daemon.post('/api/v1/volumes', { path: 'a', what: 1 });
  isProblem(unknown, 422);
  assert.equal(unknown.json.pointer, '/what');
  isProblem(await daemon.post('/api/v1/volumes', { uri: 'demo:engine', id: '../x' }), 422);
  isProblem(await daemon.post('/api/v1/volumes', '[1]'), 422);
  isProblem(await daemon.post('/api/v1/volumes', '{"path": '), 400);
  const plain = await daemon.post('/api/v1/volumes', { uri: 'demo:engine' }, { headers: { 'Content-Type': 'text/plain' } });
  isProblem(plain, 415, /application\/json or application\/merge-patch\+json/);
  assert.equal(plain.headers.get('accept-patch'), null);
});

test('render: the format follows Accept and ?format=', async () => {
  const render = (query = '', headers = {}) => daemon.fetch(`/api/v1/render${query}`, { method: 'POST', headers, body: null });
  const magic = { 'image/jpeg': [0, 'ffd8'], 'image/png': [1, '504e47'], 'image/webp': [0, '52494646'], 'image/x-exr': [0, '762f3101'] };
  for (const [query, accept, type] of [
    ['', undefined, 'image/jpeg'], ['', '*/*', 'image/jpeg'], ['', 'image/png', 'image/png'],
    ['', 'text/html, image/webp;q=0.9, image/png;q=0.5', 'image/webp'], ['', 'image/*;q=0.5, image/jpeg;q=0', 'image/png'],
    ['?format=png', 'image/jpeg', 'image/png'], ['?format=exr', undefined, 'image/x-exr'], ['?format=webp', undefined, 'image/webp']]) {
    const answer = await render(query, accept ? { Accept: accept } : {});
    const bytes = Buffer.from(await answer.arrayBuffer());
    assert.equal(answer.status, 200, `${query} ${accept}: ${bytes}`);
    assert.equal(answer.headers.get('content-type'), type);
    const [at, hex] = magic[type];
    assert.equal(bytes.toString('hex', at, at + hex.length / 2), hex);
    compare(Number(answer.headers.get('x-render-time')), '>=', 0);
    assert.equal(answer.headers.get('x-backend'), 'null');
    assert.equal(answer.headers.get('x-splats'), '0');
  }
  isProblem(await daemon.post('/api/v1/render?format=gif', {}), 406, /image\/png/);
  isProblem(await daemon.post('/api/v1/render', {}, { headers: { Accept: 'text/html', 'Content-Type': 'application/json' } }), 406);
  isProblem(await daemon.post('/api/v1/render?quality=0', {}), 400, /quality/);
  isProblem(await daemon.post('/api/v1/render?quality=9x', {}), 400, /quality/);
});

test('render: the ETag depends on view, format and quality', async () => {
  const tag = async (view, query = '?format=png', headers = {}) => {
    const answer = await daemon.fetch(`/api/v1/render${query}`, {
      method: 'POST', body: JSON.stringify(view), headers: { 'Content-Type': 'application/json', ...headers },
    });
    await answer.arrayBuffer();
    return [answer.status, answer.headers.get('etag')];
  };
  const [, plain] = await tag({});
  assert.match(plain, /^"[0-9a-f]{32}"$/);
  assert.equal((await tag({ volume: 'engine', size: [512, 512] }))[1], plain, 'the same view in another notation');
  assert.notEqual((await tag({ size: [512, 511] }))[1], plain);
  assert.notEqual((await tag({}, '?format=jpeg'))[1], plain);
  assert.notEqual((await tag({}, '?format=jpeg&quality=50'))[1], (await tag({}, '?format=jpeg&quality=51'))[1]);
  assert.equal((await tag({}, '?format=png&quality=50&subsampling=4:2:0'))[1], plain, 'quality and subsampling do not apply to PNG');
  const chroma = async (name) => (await tag({}, `?format=jpeg&quality=90&subsampling=${name}`))[1];
  assert.equal(await chroma('auto'), await chroma('4:4:4'), 'auto means 4:4:4 here');
  assert.notEqual(await chroma('auto'), await chroma('4:2:0'));
  assert.deepEqual(await tag({}, '?format=png', { 'If-None-Match': plain }), [304, plain]);
  assert.deepEqual(await tag({}, '?format=png', { 'If-None-Match': `"x", ${plain}` }), [304, plain]);
  assert.equal((await tag({}, '?format=png', { 'If-None-Match': '"x"' }))[0], 200);
});

test('an unknown volume names those that exist, as many as fit, to tokens that may list them', async () => {
  const own = await Daemon.start(['--volume', 'demo:engine?size=16']);
  await own.loaded('engine');
  const known = /^there is no volume 'nope'; the daemon has engine$/;
  const session = await own.session();
  for (const [method, target, status, body] of [
    ['GET', '/volumes/nope', 404], ['GET', '/volumes/nope/view', 404], ['GET', '/volumes/nope/histogram', 404],
    ['GET', '/volumes/nope/slice?axis=0&index=0', 404], ['DELETE', '/volumes/nope', 404], ['POST', '/render', 422, { volume: 'nope' }],
    ['POST', '/sessions', 422, { view: { volume: 'nope' } }], ['PATCH', `/sessions/${session.id}`, 422, { view: { volume: 'nope' } }],
    ['POST', '/paths', 422, { view: { volume: 'nope' }, frames: 1, keyframes: [{ frame: 0, view: {} }] }]]) {
    const answer = body ? await own.post(`/api/v1${target}`, body, { method }) : await own.json(`/api/v1${target}`, { method });
    isProblem(answer, status, known);
  }
  const guest = await own.post(`/api/v1/sessions/${session.id}`, { view: { volume: 'nope' } }, { method: 'PATCH', token: session.tokens.control });
  isProblem(guest, 422, /^there is no volume 'nope'$/);
  const layers = [{ type: 'points', id: 'nope' }], missing = /^no volume "nope" is loaded: load it, or remove the layer$/;
  const drawn = await own.post('/api/v1/render', { layers });
  isProblem(drawn, 422, missing);
  assert.equal(drawn.json.pointer, '/layers/0/id');
  const { json: kept } = await own.post('/api/v1/views', { layers });
  isProblem(await own.json(`/api/v1/render/${kept.id}`), 409, missing);
  for (let i = 0; i < 5; i += 1) {
    await own.post('/api/v1/volumes', { uri: `demo:noise?size=${i + 8}`, id: `${i}`.repeat(100) });
  }
  isProblem(await own.json('/api/v1/volumes/nope'), 404, /^there is no volume 'nope'; the daemon has engine, 0{100}, 1{100}, 2{100}, …$/);
  assert.equal(await own.stop(), 0);
});

test('a query parameter without a value is refused', async () => {
  for (const target of ['/volumes/engine/histogram?axis', '/volumes/engine/slice?axis=0&index', '/sessions?limit']) {
    isProblem(await daemon.json(`/api/v1${target}`), 400, /^the query parameter "\w+" has no value; give \w+=VALUE$/);
  }
  isProblem(await daemon.json('/api/v1/volumes/engine/histogram?axis='), 400, /must be value/);
});

test('render: an invalid view is refused with a JSON pointer', async () => {
  for (const [view, status, pointer] of [
    [{ size: [0, 10] }, 422, /^\/size/], [{ camera: { fov_y: 1000 } }, 422, /^\/camera\/fov_y$/], [{ nonsense: 1 }, 422, /^\/nonsense$/],
    [{ volume: 'nope' }, 422, /^\/volume$/], ['{"size": [1, 2', 400, /./], ['{"size": 1, "size": 2}', 400, /./], ['nonsense', 400, undefined]]) {
    const answer = await daemon.post('/api/v1/render', view);
    isProblem(answer, status);
    if (pointer) assert.match(answer.json.pointer, pointer);
  }
  isProblem(await daemon.post('/api/v1/render', '"text"'), 422);
  isProblem(await daemon.post('/api/v1/render', {}, { headers: { 'Content-Type': 'image/png' } }), 415);
});

test('sessions are created, read and forked as far as their tokens allow', async () => {
  const created = await daemon.post('/api/v1/sessions', { view: { size: [64, 48] } });
  assert.equal(created.status, 201);
  const { id, tokens, view } = created.json;
  assert.equal(created.headers.get('location'), `sessions/${id}`);
  compare(tokens.control.length, '>=', 32);
  compare(tokens.view.length, '>=', 32);
  assert.notEqual(tokens.control, tokens.view);
  assert.deepEqual(view.size, [64, 48]);
  const target = `/api/v1/sessions/${id}`;
  assert.deepEqual((await daemon.json(target)).json.tokens, tokens);
  const own = await daemon.json(target, { token: tokens.view });
  assert.equal(own.status, 200);
  assert.equal(own.json.tokens, undefined);
  isProblem(await daemon.json(target, { token: null }), 401);
  isProblem(await daemon.json(target, { token: 'wrong' }), 401);
  // Without a token a client learns neither which sessions exist nor what is wrong with a body.
  const nowhere = await daemon.json('/api/v1/sessions/ffffffffffffffff', { token: 'wrong' });
  assert.deepEqual(nowhere.json, (await daemon.json(target, { token: 'wrong' })).json);
  for (const text of [`{"view": [${'1,'.repeat(10000)}`, ' '.repeat(300)]) isProblem(await daemon.post('/api/v1/sessions', text, { token: 'wrong' }), 401);
  const patch = (token) => daemon.json(target, { token, method: 'PATCH', body: '{"view":{"size":[10,10]}}', headers: { 'Content-Type': 'application/json' } });
  isProblem(await patch(tokens.view), 403);
  const text = await daemon.json(target, { method: 'PATCH', body: 'x', headers: { 'Content-Type': 'application/json-patch+json' } });
  isProblem(text, 415);
  assert.equal(text.headers.get('accept-patch'), PATCHES);
  assert.deepEqual((await patch(tokens.control)).json.view.size, [10, 10]);
  isProblem(await daemon.json(target, { method: 'DELETE', token: tokens.control }), 403);
  const fork = await daemon.post('/api/v1/sessions', { from: id });
  assert.equal(fork.status, 201);
  assert.deepEqual(fork.json.view.size, [10, 10]);
  assert.notEqual(fork.json.id, id);
  isProblem(await daemon.post('/api/v1/sessions', { from: 'nope' }), 422);
  isProblem(await daemon.post('/api/v1/sessions', { from: id, view: {} }), 422);
  const wrong = await daemon.post('/api/v1/sessions', { view: { camera: { up: [0, 0, 0] } } });
  isProblem(wrong, 422);
  assert.equal(wrong.json.pointer, '/view/camera/up');
  isProblem(await daemon.post('/api/v1/sessions', { view: 7 }), 422);
  isProblem(await daemon.post('/api/v1/sessions', { what: 7 }), 422);
  isProblem(await daemon.json('/api/v1/sessions/nope', { method: 'DELETE' }), 404);
  const plain = await daemon.json(`${target}/stream`);
  isProblem(plain, 426);
  assert.equal(plain.headers.get('upgrade'), 'websocket');
});

test('a body over the limit gets 413, both by its Content-Length and by its real length', async () => {
  const large = 'x'.repeat((1 << 20) + 1);
  isProblem(await daemon.post('/api/v1/render', large), 413);
  const raw = await Raw.connect(daemon.port);
  raw.write(`POST /api/v1/render HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nTransfer-Encoding: chunked\r\n\r\n`);
  for (let i = 0; i < 17; i++) raw.write(`10000\r\n${'y'.repeat(65536)}\r\n`);
  raw.write('0\r\n\r\n');
  await raw.until(() => raw.text().startsWith('HTTP/1.1 413') && raw.text().includes('--body-size'), '413');
  raw.destroy();
  const polite = await Raw.connect(daemon.port);
  polite.write(`POST /api/v1/render HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer ${daemon.token}\r\nContent-Length: 9999999\r\nExpect: 100-continue\r\n\r\n`);
  await polite.until(() => polite.text().startsWith('HTTP/1.1 413'), '413 instead of 100');
  polite.destroy();
});
