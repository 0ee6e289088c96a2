// SPDX-License-Identifier: Apache-2.0
// splatctl with the real daemon, and equal images with and without the daemon.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { once } from 'node:events';
import { copyFileSync, existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { BIN, Daemon, within } from './harness.mjs';

let daemon;
let folder;
const inFolder = (name) => path.join(folder, name);

/** Runs splatctl. Resolves to {status, out (bytes), err}. */
async function splatctl(args, { input = '', url = `${daemon.base}/?token=${daemon.token}` } = {}) {
  const env = { ...process.env, SPLATD_URL: url };
  delete env.SPLATD_TOKEN;
  const child = spawn(path.join(BIN, 'splatctl'), args, { env });
  const out = [];
  let err = '';
  child.stdout.on('data', (data) => out.push(data));
  child.stderr.on('data', (data) => { err += data; });
  child.stdin.on('error', () => {}); // it may exit before it has read all its input
  child.stdin.end(input);
  const [status] = await within(once(child, 'close'), `splatctl ${args.join(' ')}`);
  return { status, out: Buffer.concat(out), err };
}

async function succeeds(args, options) {
  const result = await splatctl(args, options);
  assert.deepEqual({ status: result.status, err: result.err }, { status: 0, err: '' }, args.join(' '));
  return result.out;
}

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatctl-'));
  const header = 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 2\nencoding: raw\n\n';
  writeFileSync(inFolder('cube.nrrd'), Buffer.concat([Buffer.from(header), Buffer.from([...Array(64).keys()])]));
  writeFileSync(inFolder('cut.nrrd'), header);
  daemon = await Daemon.start(['--volume', 'demo:engine?size=32', '--data', folder], { backend: 'cpu' });
  await daemon.loaded('engine');
});

after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

test('volumes are listed and loaded', async () => {
  assert.match((await succeeds(['volumes'])).toString(), /^engine +ready /m);
  assert.equal((await succeeds(['load', 'cube.nrrd'])).toString(), 'cube\n');
  assert.equal((await succeeds(['load', 'demo:phantom?size=16'])).toString(), 'phantom\n');
  const { volumes } = JSON.parse(await succeeds(['volumes', '--json']));
  assert.deepEqual(volumes.map(({ id, state }) => [id, state]),
    [['engine', 'ready'], ['cube', 'ready'], ['phantom', 'ready']]);
});

test('info describes a file without a daemon', async () => {
  const about = JSON.parse(await succeeds(['info', '--json', 'demo:engine?size=16']));
  assert.deepEqual([about.dims, about.type, about.histogram.counts.length], [[16, 9, 9], 'uint8', 256]);
  const text = `${await succeeds(['info', 'demo:engine?size=16'])}`;
  const counts = [...text.matchAll(/^ *[\d.]+ +(\d+) +#*$/gm)].map(([, count]) => Number(count));
  assert.equal(counts.length, 16);
  assert.equal(counts.reduce((a, b) => a + b), 16 * 9 * 9);
  const { status, err } = await splatctl(['info', './nothing.nii']);
  assert.deepEqual([status, err], [1, 'splatctl: ./nothing.nii: there is no such file\n']);
});

test('what differs from the file of a volume is said on standard error', async () => {
  writeFileSync(inFolder('half.csv'), 'x,y,z,heat\n0,0,0,1\n1,0,0,\n');
  const warning = /^splatctl: warning: (\S*)half(.csv)?: 1 of the 2 points are not drawn, [^\n]*\n$/;
  for (const args of [['load', 'half.csv'], ['volumes'], ['render', '--local', '--volume', inFolder('half.csv'), '--size', '8x8', '--out', inFolder('half.png')]]) {
    const { status, err } = await splatctl(args);
    assert.equal(status, 0, err);
    assert.match(err, warning, args[0]);
  }
  assert.equal(JSON.parse(await succeeds(['info', inFolder('half.csv')])).warnings.length, 1);
  // Options that need a grid or a projection are refused.
  for (const [args, reason] of [[['render', '--local', '--surface', '1'], /\/layers\/0\/type: this volume has no grid of samples/], [['slice', '--axis', 'z'], /slices need a grid of samples, and this volume has points/],
    [['render', '--local', '--window', '40,400'], /--window: is the window of a projection: add --projection/]]) {
    const { status, err } = await splatctl([...args, '--volume', args[0] === 'render' ? inFolder('half.csv') : 'half', '--out', inFolder('half.png')]);
    assert.equal(status, 1, err);
    assert.match(err, reason);
  }
  await succeeds(['unload', 'half']);
});

test('a volume that cannot be loaded is refused with the reason', async () => {
  const cut = await splatctl(['load', 'cut.nrrd']);
  assert.equal(cut.status, 1);
  assert.match(cut.err, /^splatctl: cut: loading failed: .*byte/);
  const outside = await splatctl(['load', '../../etc/passwd']);
  assert.equal(outside.status, 1);
  assert.match(outside.err, /^splatctl: .*HTTP 40[34]/);
  const unknown = await splatctl(['load', 'demo:nothing']);
  assert.equal(unknown.status, 1);
  assert.match(unknown.err, /^splatctl: .*nothing/);
});

test('a volume is unloaded, and an unknown id names those that exist', async () => {
  await succeeds(['load', 'demo:noise?size=8']);
  await succeeds(['unload', 'noise']);
  const unknown = await splatctl(['render', '--volume', 'noise', '--out', '-']);
  assert.equal(unknown.status, 1);
  assert.match(unknown.err, /^splatctl: noise: no volume has this id \(the daemon has engine[^)]*\), and loading it fails: /);
  assert.match((await splatctl(['unload', 'noise'])).err, /^splatctl: DELETE \/volumes\/noise: .*HTTP 404/);
});

test('a picture by a preset and by angles equals that of the same view', async () => {
  const common = ['render', '--volume', 'engine', '--size', '40x30', '--out', '-'];
  await succeeds(['preset', 'side', '--view', '-'], { input: '{"camera": {"azimuth": 90, "elevation": 0}, "shading": {"mode": "none"}}' });
  const expected = await succeeds([...common, '--view', '-'], { input: '{"camera": {"azimuth": 90, "elevation": 15}, "shading": {"mode": "none"}}' });
  assert.deepEqual(await succeeds([...common, '--preset', 'side', '--elevation', '15']), expected);
  assert.notDeepEqual(await succeeds(common), expected);
  await succeeds(['preset', 'side', '--delete']);
});

test('a slice is written as an image and as values', async () => {
  await succeeds(['load', 'cube.nrrd']);
  const png = await succeeds(['slice', '--volume', 'cube', '--axis', 'z', '--out', '-']);
  assert.equal(png.toString('latin1', 1, 4), 'PNG');
  const values = await succeeds(['slice', '--volume', 'cube', '--axis', 'z', '--index', '1', '--format', 'raw', '--out', '-']);
  assert.deepEqual([...values], [...Array(16).keys()].map((i) => 16 + i));
  const oblique = await succeeds(['slice', '--volume', 'cube', '--origin', '1,1,2', '--normal', '1,1,0', '--size', '8x6', '--out', '-']);
  assert.equal(oblique.readUInt32BE(16), 8);
  const outside = await splatctl(['slice', '--volume', 'cube', '--axis', 'z', '--index', '4', '--out', '-']);
  assert.equal(outside.status, 1);
  assert.match(outside.err, /4.*3/);
});

test('https at a daemon without TLS is said', async () => {
  const { status, err } = await splatctl(['volumes'], { url: daemon.base.replace('http:', 'https:') });
  assert.equal(status, 1);
  assert.match(err, /^splatctl: https:\S+: this server speaks HTTP without TLS; use http:\/\/127/);
});

test('the daemon accepts its own default view', async () => {
  const view = await succeeds(['view', 'engine']);
  assert.equal(JSON.parse(view).volume, 'engine');
  const asDefault = await succeeds(['render', '--volume', 'engine', '--out', '-']);
  assert.deepEqual(await succeeds(['render', '--view', '-', '--out', '-'], { input: view }), asDefault);
});

test('channels are loaded, and the image is the same with and without the daemon', async () => {
  const values = (f) => [...Array(512).keys()].map((i) => f(i % 8, Math.floor(i / 8) % 8)).join(' ');
  const field = (name, f) => `SCALARS ${name} float 1\nLOOKUP_TABLE default\n${values(f)}\n`;
  writeFileSync(inFolder('cells.vtk'), `# vtk DataFile Version 3.0\ncells\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 8 8 8\nORIGIN 0 0 0\nSPACING 1 1 1\n`
    + `POINT_DATA 512\n${field('left', (x) => Number(x < 4))}${field('top', (x, y) => Number(y < 4))}`);
  const common = ['--size', '40x30', '--no-volume', '--projection', 'maximum', '--out', '-'];
  const local = inFolder('cells.vtk');
  const render = (source, more, second) => succeeds(['render', ...more, '--volume', source, '--channel', source, '--channel', `${source}?field=top${second}`, ...common]);
  const own = await render('cells.vtk', [], '');
  assert.deepEqual(await render(local, ['--local'], ''), own);
  assert.deepEqual(await render('cells.vtk', [], ',ff00ff'), own, 'the second colour of the list');
  assert.notDeepEqual(await render('cells.vtk', [], ',ff00ff,0,2'), own);
  const { status, err } = await splatctl(['render', '--volume', 'engine', '--channel', 'cells.vtk', '--out', '-']);
  assert.equal(status, 1);
  assert.match(err, /grid/);
});

test('the daemon and splatctl in process give the same image', async () => {
  const view = JSON.stringify({
    size: [200, 150], background: [0.2, 0.1, 0.4, 0.5], filter: { mode: 'ewa' }, camera: { fov_y: 40 },
  });
  copyFileSync(inFolder('cube.nrrd'), inFolder('elsewhere.nrrd'));
  for (const [volume, local] of [['engine', 'demo:engine?size=32'], ['cube', inFolder('elsewhere.nrrd')]]) {
    if (volume === 'cube') await succeeds(['load', 'cube.nrrd']);
    for (const format of ['png', 'jpeg', 'webp', 'exr']) {
      const common = ['--view', '-', '--format', format, '--out', '-'];
      const remote = await succeeds(['render', '--volume', volume, ...common], { input: view });
      const here = await succeeds(['render', '--local', '--volume', local, ...common], { input: view });
      compare(remote.length, '>', 500, `${volume} as ${format}: ${remote.length} bytes`);
      assert.ok(remote.equals(here), `${volume} as ${format} differs`);
    }
  }
});

test('a layer shows another volume: by its id in the daemon, by its source in process', async () => {
  await succeeds(['load', 'demo:gaussians?size=8']);
  const example = JSON.parse(readFileSync(new URL('../../clients/cli/examples/mixed.json', import.meta.url), 'utf8'));
  const [, layer] = example.layers;
  const view = (id) => JSON.stringify({ ...example, size: [120, 90], layers: [{ type: 'volume' }, { ...layer, id, transform: [8, 0, 0, 16, 0, 8, 0, 9, 0, 0, 8, 9, 0, 0, 0, 1] }, { ...layer, id }] });
  const common = ['--view', '-', '--out', '-'];
  const remote = await succeeds(['render', '--volume', 'engine', ...common], { input: view(layer.id) });
  const local = ['render', '--local', '--volume', 'demo:engine?size=32', ...common];
  assert.ok(remote.equals(await succeeds(local, { input: view('demo:gaussians?size=8') })));
  assert.ok(!remote.equals(await succeeds(local, { input: '{"size": [120, 90]}' })), 'the layer is visible');
  for (const [args, id, expected] of [
    [['render', '--volume', 'engine', ...common], 'nothing', /^splatctl: \/layers\/1\/id: no volume "nothing" is loaded/],
    [local, './nothing.ply', /^splatctl: \.\/nothing\.ply: there is no such file/],
    [local, 'demo:engine?size=8', /^splatctl: \/layers\/1\/id: this volume has no Gaussians/],
  ]) {
    const { status, err } = await splatctl(args, { input: view(id) });
    assert.equal(status, 1);
    assert.match(err, expected);
  }
  assert.match((await succeeds(['volumes'])).toString(), /^gaussians +ready +128 +gaussians +\d/m, 'elements in place of voxels');
  await succeeds(['unload', 'gaussians']);
});

test('a refused view is reported with its JSON pointer and creates no file', async () => {
  const before = readdirSync(folder);
  const refused = async (view, expected) => {
    const args = ['render', '--volume', 'engine', '--view', '-', '--out', inFolder('never.png')];
    for (const more of [[], ['--local', '--volume', 'demo:engine?size=32']]) {
      const { status, err } = await splatctl([...args, ...more], { input: view });
      assert.equal(status, 1, err);
      assert.match(err, expected);
    }
  };
  await refused('{"camera":{"up":[0,0,0]}}', /^splatctl: \/camera\/up: up is zero/);
  await refused('{"camra":{}}', /^splatctl: \/camra: unknown field; did you mean "camera"\?/);
  await refused('{"primitive":{"type":"shell"}}', /^splatctl: \/primitive\/type: .*layers/);
  await refused('{"transfer_function":{"order":"post"},"compositing":{"mode":"splat"}}', /^splatctl: \/transfer_function\/order: .*slab/);
  await refused('{"camera":', /^splatctl: standard input: not valid JSON at line 1/);
  assert.deepEqual(readdirSync(folder), before);
});

test('the example in --help is a valid view', async () => {
  const [, example] = /^For example[^{]*(\{[^]*\})\n\nExit/m.exec((await succeeds(['--help'])).toString());
  const common = ['render', '--local', '--backend', 'null', '--volume', 'demo:engine?size=16', '--size', '16,16', '--out', '-'];
  assert.equal(JSON.parse(example).transfer_function.order, 'post');
  compare((await succeeds([...common, '--view', '-'], { input: example })).length, '>', 0);
});

test('render loads the volume that its argument names', async () => {
  await succeeds(['render', '--volume', 'demo:checkerboard?size=32', '--size', '64,64', '--out', inFolder('new.png')]);
  assert.ok(existsSync(inFolder('new.png')));
  assert.equal(readFileSync(inFolder('new.png')).toString('latin1', 1, 4), 'PNG');
});

test('a wrong token is reported', async () => {
  const { status, err } = await splatctl(['volumes'], { url: `${daemon.base}/?token=wrong` });
  assert.equal(status, 1);
  assert.match(err, /^splatctl: GET \/volumes: .*HTTP 401.*token/);
});

test('views are saved, listed, printed and deleted', async () => {
  const view = JSON.stringify({ background: [0.25, 0, 0, 1] });
  const id = (await succeeds(['save', '--volume', 'engine', '--view', '-', '--size', '24,16'], { input: view })).toString().trim();
  assert.match(id, /^[0-9a-f]{32}$/);
  assert.equal(JSON.parse(await succeeds(['save', '--volume', 'engine', '--view', '-', '--size', '24,16', '--json'], { input: view })).id, id);
  assert.match((await succeeds(['views'])).toString(), new RegExp(`^${id} +engine +24x16$`, 'm'));
  const whole = JSON.parse(await succeeds(['saved', id]));
  assert.deepEqual([whole.background, whole.size], [[0.25, 0, 0, 1], [24, 16]]);
  const ids = new Set([id]);
  for (let i = 1; i <= 120; i += 1) { // more than one page
    ids.add((await daemon.post('/api/v1/views', { size: [i, 1] })).json.id);
  }
  const { views, next } = JSON.parse(await succeeds(['views', '--json']));
  assert.equal(next, undefined);
  assert.deepEqual(new Set(views.map((v) => v.id)), ids);
  await succeeds(['saved', id, '--delete']);
  const gone = await splatctl(['saved', id]);
  assert.equal(gone.status, 1);
  assert.match(gone.err, /no saved view/);
});

test('presets are stored under names, listed, printed and deleted', async () => {
  await succeeds(['preset', 'narrow', '--view', '-'], { input: '{"camera":{"fov_y":12}}' });
  assert.equal((await succeeds(['presets'])).toString(), 'narrow\n');
  assert.deepEqual(JSON.parse(await succeeds(['presets', '--json'])), { presets: ['narrow'] });
  assert.deepEqual(JSON.parse(await succeeds(['preset', 'narrow'])), { camera: { fov_y: 12 } });
  const wrong = await splatctl(['preset', 'wrong', '--view', '-'], { input: '{"camera":{"fov_y":999}}' });
  assert.deepEqual([wrong.status, /\/camera\/fov_y/.test(wrong.err)], [1, true]);
  assert.equal((await splatctl(['preset', 'narrow', '--view', '-', '--delete'])).status, 2);
  await succeeds(['preset', 'narrow', '--delete']);
  assert.equal((await splatctl(['preset', 'narrow', '--delete'])).status, 1);
  assert.equal((await succeeds(['presets'])).toString(), '');
});

test('sessions are created, forked, listed and ended, and their links join them', async () => {
  const links = JSON.parse(await succeeds(['share', '--volume', 'engine', '--size', '30,20', '--json']));
  const made = (await daemon.json(`/api/v1/sessions/${links.session}`)).json;
  assert.deepEqual(made.view.size, [30, 20]);
  assert.equal(links.control, `${daemon.base}/#session=${links.session}&token=${made.tokens.control}`);
  assert.equal(links.view, `${daemon.base}/#session=${links.session}&token=${made.tokens.view}`);
  const fork = JSON.parse(await succeeds(['share', links.session, '--json']));
  assert.notEqual(fork.session, links.session);
  assert.deepEqual((await daemon.json(`/api/v1/sessions/${fork.session}`)).json.view, made.view);
  assert.equal((await succeeds(['session', fork.session])).toString(),
    `session ${fork.session}\ncontrol ${fork.control}\nview    ${fork.view}\n`);
  const table = (await succeeds(['sessions'])).toString();
  for (const id of [links.session, fork.session]) assert.match(table, new RegExp(`^${id} +engine +active +0 +\\d+$`, 'm'));
  await succeeds(['session', fork.session, '--delete']);
  const { sessions } = JSON.parse(await succeeds(['sessions', '--json']));
  assert.deepEqual(sessions.map((s) => s.id), [links.session]);
  assert.equal((await splatctl(['sessions', '--delete'])).status, 2);
  assert.equal((await splatctl(['share', 'nothing-there'])).status, 1);
});

test('the measurements of a session are listed and written as CSV', async () => {
  const { id } = await daemon.session({ volume: 'engine' });
  const at = `/api/v1/sessions/${id}/measures`;
  const body = JSON.stringify({ kind: 'distance', points: [[0, 0, 0], [3, 4, 0]], text: '=Wall' });
  const { status, json } = await daemon.json(`${at}/wall`, { method: 'PUT', body, headers: { 'Content-Type': 'application/json' } });
  assert.deepEqual([status, json.value], [201, 5]);
  const table = (await succeeds(['measures', id])).toString();
  assert.match(table, /^wall +distance +=Wall +5 +- +- +- +- +- +the volume does not state the unit of its coordinates *$/m);
  assert.deepEqual(JSON.parse(await succeeds(['measures', id, '--json'])).measures, [json]);
  const part = await daemon.post(`${at}`, { kind: 'part', points: [[0, 0, 0]], range: [-1e9, 1e9], text: 'all' });
  assert.match((await succeeds(['measures', id])).toString(), new RegExp(`all +[\\d.e+]+ +- +- +- +- +area [\\d.e+]+, ${part.json.samples} samples`));
  await daemon.fetch(`${at}/${part.json.id}`, { method: 'DELETE' });
  const csv = (await succeeds(['measures', id, '--format', 'csv'])).toString();
  assert.match(csv, /^id,kind,volume,text,.*\r\nwall,distance,engine,"'=Wall",/);
  await succeeds(['measures', id, '--format', 'csv', '--out', inFolder('m.csv')]);
  assert.equal(readFileSync(inFolder('m.csv'), 'utf8'), csv);
  assert.equal((await splatctl(['measures', 'nothing-there'])).status, 1);
  for (const wrong of [['measures'], ['measures', id, '--format', 'xml'], ['measures', id, '--out', '-'], ['measures', id, '--json', '--format', 'csv']]) {
    assert.equal((await splatctl(wrong)).status, 2, wrong.join(' '));
  }
});

const TURN = { view: { volume: 'engine' }, size: [24, 16], frames: 5, keyframes: [{ frame: 4, view: { camera: { fov_y: 60 } } }] };

test('a camera path becomes a folder of frames, each equal to the image of its view', async () => {
  const report = JSON.parse(await succeeds(['path', '-', '--out', inFolder('frames'), '--json'], { input: JSON.stringify(TURN) }));
  assert.deepEqual(report, { out: inFolder('frames'), format: 'png', frames: 5 });
  assert.deepEqual(readdirSync(inFolder('frames')).sort(), [0, 1, 2, 3, 4].map((n) => `00000${n}.png`));
  const last = await succeeds(['render', '--volume', 'engine', '--view', '-', '--size', '24,16', '--out', '-'], { input: '{"camera": {"fov_y": 60}}' });
  assert.ok(readFileSync(inFolder('frames/000004.png')).equals(last));
  assert.ok(!readFileSync(inFolder('frames/000000.png')).equals(last));
  assert.deepEqual((await daemon.json('/api/v1/paths')).json.paths, [], 'the daemon deletes a path once it is fetched');
});

test('a camera path becomes a movie', async () => {
  writeFileSync(inFolder('movie.json'), JSON.stringify({ ...TURN, format: 'webm' }));
  await succeeds(['path', inFolder('movie.json'), '--out', inFolder('movie.webm')]);
  assert.equal(readFileSync(inFolder('movie.webm')).toString('latin1', 0, 4), '\x1a\x45\xdf\xa3'); // EBML
});

test('an invalid camera path is refused with its JSON pointer', async () => {
  for (const [args, input, status, err] of [
    [['path', '-'], '{}', 2, /--out/], [['path', '--out', 'x'], '{}', 2, /needs a file/], [['path', '-', '--out', inFolder('x')], '{', 1, /splatctl: -: /],
    [['path', '-', '--out', inFolder('x')], JSON.stringify({ ...TURN, frames: 0 }), 1, /splatctl: \/frames: /],
    [['path', '-', '--out', inFolder('cube.nrrd')], JSON.stringify(TURN), 1, /cube.nrrd/],
  ]) {
    const result = await splatctl(args, { input });
    assert.equal(result.status, status, result.err);
    assert.match(result.err, err);
  }
});

test('a camera path that could not be fetched stays and can be fetched later', async () => {
  writeFileSync(inFolder('path.json'), JSON.stringify(TURN));
  const failed = await splatctl(['path', inFolder('path.json'), '--out', inFolder('missing/frames')]);
  assert.equal(failed.status, 1); // refused before the path was created
  assert.deepEqual((await daemon.json('/api/v1/paths')).json.paths, []);
  mkdirSync(inFolder('path/000002.png'), { recursive: true });
  const stopped = await splatctl(['path', inFolder('path.json'), '--out', inFolder('path')]);
  assert.equal(stopped.status, 1);
  const [, id] = /path --id ([0-9a-f]+) --out/.exec(stopped.err);
  assert.match((await succeeds(['paths'])).toString(), new RegExp(`^${id} +\\w+ +png +\\d +5$`, 'm'));
  rmSync(inFolder('path/000002.png'), { recursive: true });
  assert.equal(JSON.parse(await succeeds(['path', '--id', id, '--out', inFolder('path'), '--json'])).frames, 5);
  assert.equal(readdirSync(inFolder('path')).length, 5);
  assert.equal((await daemon.json('/api/v1/paths')).json.paths.length, 1, 'a path that is fetched by its id stays');
  await succeeds(['path', '--id', id, '--out', inFolder('path'), '--delete']);
  assert.deepEqual((await daemon.json('/api/v1/paths')).json.paths, []);
  assert.match((await splatctl(['path', '--id', id])).err, /HTTP 404/);
});

test('the examples of layers and edits are valid, with the daemon and in process, and so are the options', async () => {
  const view = new URL('../../clients/cli/examples/layers.json', import.meta.url).pathname;
  const edits = new URL('../../clients/cli/examples/edits.json', import.meta.url).pathname;
  for (const how of [['--volume', 'engine'], ['--local', '--backend', 'cpu', '--volume', 'demo:engine?size=32']]) {
    const image = (...options) => succeeds(['render', ...how, '--size', '64', '--out', '-', ...options]);
    await image('--view', view);
    await image('--view', edits);
    const [surface, same, both, volume] = [
      await image('--no-volume', '--surface', '90,ff0066,0.5'),
      await succeeds(['render', ...how, '--size', '64', '--out', '-', '--view', '-'], { input: JSON.stringify({ layers: [{ type: 'surface', value: 90, color: [1, 0, 0.4], opacity: 0.5 }] }) }),
      await image('--surface', '90,ff0066,0.5'), await image(),
    ];
    assert.ok(surface.equals(same), 'the option and the view give the same image');
    assert.deepEqual([surface.equals(both), both.equals(volume), surface.equals(volume)], [false, false, false]);
  }
});

test('projections: the options and the view give the same image, with the daemon and in process', async () => {
  for (const how of [['--volume', 'engine'], ['--local', '--backend', 'cpu', '--volume', 'demo:engine?size=32']]) {
    const image = (options, view) => succeeds(['render', ...how, '--size', '64', '--out', '-', '--view', '-', ...options], { input: JSON.stringify(view) });
    const compositing = { mode: 'maximum', window: { center: 100, width: 80 } };
    const [option, same, automatic, sum] = [
      await image(['--projection', 'maximum', '--window', '100,80'], {}), await image([], { compositing }),
      await image(['--projection', 'maximum'], { compositing }), await image(['--projection', 'sum'], {}),
    ];
    assert.ok(option.equals(same));
    assert.deepEqual([option.equals(automatic), automatic.equals(sum)], [false, false]);
  }
});

test('a camera path moves streaks by several lengths, and each length ends as it began', async () => {
  await succeeds(['load', 'demo:tornado?size=24']);
  const layers = (phase) => [{ type: 'vectors', style: 'blend', stretch: 3, density: 0.5, phase }];
  const path = {
    view: { volume: 'tornado', layers: layers(0) }, size: [48, 48], frames: 5, fps: 4, format: 'png', keyframes: [{ time: 1, view: { layers: layers(2) } }],
  };
  await succeeds(['path', '-', '--out', inFolder('wind')], { input: JSON.stringify(path) });
  const frames = [0, 1, 2, 3, 4].map((n) => readFileSync(inFolder(`wind/00000${n}.png`)));
  assert.deepEqual([2, 4].map((n) => frames[n].equals(frames[0])), [true, true]);
  assert.ok(frames[1].equals(frames[3]) && !frames[1].equals(frames[0]));
  const options = await succeeds(['render', '--volume', 'tornado', '--vectors', 'blend,3,0.5', '--size', '48', '--out', '-']);
  assert.ok(options.equals(frames[0]), 'the option and the view give the same image');
});

test('the example camera paths are valid', async () => {
  for (const name of ['turn', 'wind']) {
    const example = JSON.parse(readFileSync(new URL(`../../clients/cli/examples/${name}.json`, import.meta.url)));
    const { status, json } = await daemon.post('/api/v1/paths', example);
    assert.equal(status, 202, JSON.stringify(json));
    await daemon.fetch(`/api/v1/paths/${json.id}`, { method: 'DELETE' });
  }
});
