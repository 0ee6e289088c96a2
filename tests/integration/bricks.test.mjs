// SPDX-License-Identifier: Apache-2.0
// Volumes that are larger than the memory of the daemon: brick files, progressive frames, and images that say whether they are complete.
import assert from 'node:assert/strict';
import { execFileSync, spawnSync } from 'node:child_process';
import { mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { compare } from '../support/compare.mjs';
import { writeVessels } from '../support/sparse.mjs';
import { BIN, Daemon, FINAL, INCOMPLETE } from './harness.mjs';

const SIDE = 200;
const MEMORY = 7 << 20; // bytes: less than the samples
const sameThreads = process.env.SPLATD_SANITIZE === 'thread' && 'the other tests run the same threads';
let daemon;
let folder;
let scene; // the description of the volume

const convert = (source, name) => execFileSync(path.join(BIN, 'splatctl'), ['convert', source, path.join(folder, name)]);
const image = (view, headers = {}, of = daemon) => of.fetch('/api/v1/render?format=png', {
  method: 'POST', headers: { 'Content-Type': 'application/json', ...headers }, body: JSON.stringify(view) });

before(async () => {
  folder = mkdtempSync(path.join(tmpdir(), 'splatd-bricks-'));
  convert(`demo:noise?size=${SIDE}`, 'large.bricks');
  convert('demo:noise?size=70', 'damaged.bricks');
  const bytes = readFileSync(path.join(folder, 'damaged.bricks'));
  bytes[5000] ^= 1; // in the first brick
  writeFileSync(path.join(folder, 'damaged.bricks'), bytes);
  daemon = await Daemon.start(['--data', folder, '--memory', `${MEMORY}`], { backend: 'cpu' });
  for (const name of ['large', 'damaged']) {
    assert.equal((await daemon.post('/api/v1/volumes', { path: `${name}.bricks` })).status, 202);
    assert.equal((await daemon.loaded(name)).state, 'ready');
  }
  scene = (await daemon.json('/api/v1/volumes/large')).json;
});
after(async () => {
  assert.equal(await daemon.stop(), 0);
  rmSync(folder, { recursive: true });
});

/** A view that few bricks fill. */
function close() {
  const target = [40, 40, 40];
  return { volume: 'large', size: [160, 160], camera: { target, position: [40, 40, 180], up: [0, 1, 0], fov_y: 10 },
    clip: { box: [[0, 0, 0], [0.3, 0.3, 0.3]] } };
}

test('a volume that is larger than memory opens, and tells its whole size', () => {
  assert.deepEqual(scene.whole, { dims: [SIDE, SIDE, SIDE], spacing: [1, 1, 1], origin: [0, 0, 0], levels: 3, bytes: SIDE ** 3 });
  compare(scene.bytes, '<', MEMORY, 'the part in memory');
});

test('brick files are listed with their size and type', async () => {
  const { json } = await daemon.json('/api/v1/files');
  const { format, dims, type, contents } = json.entries.find(({ name }) => name === 'large.bricks');
  assert.deepEqual({ format, dims, type, contents }, { format: 'brick file', dims: [SIDE, SIDE, SIDE], type: 'uint8', contents: 'grid' });
});

test('an image waits until it is complete, and says so', async () => {
  const first = await image(close());
  assert.equal(first.status, 200);
  assert.equal(first.headers.get('x-complete'), 'true');
  assert.deepEqual(['x-level', 'x-level-asked', 'x-bricks-lost'].map((name) => first.headers.get(name)), ['0', '0', '0']);
  const etag = first.headers.get('etag');
  assert.ok(etag);
  const again = await image(close());
  assert.ok(Buffer.from(await first.arrayBuffer()).equals(Buffer.from(await again.arrayBuffer())));
  assert.equal((await image(close(), { 'If-None-Match': etag })).status, 304);
});

test('an image with a damaged brick says that it is not complete, and is not cached', async () => {
  const answer = await image({ volume: 'damaged', size: [64, 64] });
  assert.equal(answer.status, 200);
  assert.equal(answer.headers.get('x-complete'), 'false');
  assert.equal(answer.headers.get('x-bricks-lost'), '1');
  assert.equal(answer.headers.get('etag'), null);
  assert.equal(answer.headers.get('cache-control'), 'no-store');
  await daemon.untilLogged('damaged');
  const { warnings } = (await daemon.json('/api/v1/volumes/damaged')).json;
  assert.match(warnings[0], /^1 bricks cannot be read, the first at voxels \(0, 0, 0\) to \(63, 63, 63\), level 0: .*damaged/);
});

test('an image that memory makes coarser is not complete, nor is a final frame', async () => {
  const view = { volume: 'large', size: [96, 96], quality: { level_of_detail: 'off' } };
  const answer = await image(view);
  assert.equal(answer.headers.get('x-complete'), 'false');
  assert.equal(answer.headers.get('etag'), null);
  const { level, asked } = { level: Number(answer.headers.get('x-level')), asked: Number(answer.headers.get('x-level-asked')) };
  assert.equal(asked, 0);
  compare(level, '>', asked, 'the level');
  assert.equal(answer.headers.get('x-bricks-lost'), '0');
  const stream = await daemon.stream({ session: await daemon.session(view) });
  assert.ok((await stream.final(0)).flags & INCOMPLETE, 'the final frame says so');
  const { bricks } = (await stream.note('stream.stats', (stats) => stats.bricks?.level === level)).params;
  assert.deepEqual([bricks.complete, bricks.asked, bricks.lost], [false, 0, 0]);
  await stream.end();
});

test('a stream shows something at once, then all of it, and tells its bricks', async () => {
  const view = close();
  view.camera.target = [150, 150, 150];
  view.camera.position = [150, 150, 10];
  view.clip = { box: [[0.7, 0.7, 0.7], [1, 1, 1]] };
  const stream = await daemon.stream({ session: await daemon.session(view) });
  await stream.final(0);
  compare(stream.frames.length, '>', 1, 'frames');
  assert.ok(stream.frames.slice(0, -1).every((frame) => !(frame.flags & FINAL)), 'a frame that is not complete is not final');
  const { bricks, memory } = (await stream.note('stream.stats', (stats) => stats.bricks?.resident > 0)).params;
  assert.equal(bricks.resident, bricks.wanted);
  assert.equal(bricks.level, 0);
  compare(memory, '<', MEMORY, 'memory');
  await stream.end();
});

/** Starts a daemon with a cache in one folder, for the files of another folder. */
const withCache = (data, cache, ...more) => Daemon.start(['--data', data, '--memory', `${MEMORY}`, '--cache', cache, ...more], { backend: 'cpu' });

test('with --cache, fields, vectors and time steps stay known, and each field and step has bricks of its own', async () => {
  const data = mkdtempSync(path.join(folder, 'data-'));
  const cache = mkdtempSync(path.join(folder, 'cache-'));
  const side = 100;
  const vtk = `# vtk DataFile Version 3.0\nfields\nBINARY\nDATASET STRUCTURED_POINTS\nDIMENSIONS ${side} ${side} ${side}\nORIGIN 0 0 0\nSPACING 1 1 1\nPOINT_DATA ${side ** 3}\n`;
  const scalars = (name, value) => [Buffer.from(`SCALARS ${name} unsigned_char 1\nLOOKUP_TABLE default\n`), Buffer.alloc(side ** 3, value), Buffer.from('\n')];
  writeFileSync(path.join(data, 'fields.vtk'), Buffer.concat([Buffer.from(vtk), ...scalars('a', 7), ...scalars('b', 9),
    Buffer.from('VECTORS flow float\n'), Buffer.alloc(12 * side ** 3), Buffer.from('\n')]));
  const dims = [SIDE, SIDE, SIDE, 2];
  const mha = `ObjectType = Image\nNDims = 4\nDimSize = ${dims.join(' ')}\nElementSpacing = 1 1 1 0.5\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n`;
  writeFileSync(path.join(data, 'series.mha'), Buffer.concat([Buffer.from(mha), Buffer.alloc(SIDE ** 3, 20), Buffer.alloc(SIDE ** 3, 60)]));
  const own = await withCache(data, cache);
  const open = async (file, id) => {
    assert.equal((await own.post('/api/v1/volumes', { path: file, id })).status, 202);
    const volume = await own.loaded(id);
    assert.equal(volume.state, 'ready', volume.reason);
    assert.ok(volume.whole, 'it is shown from bricks');
    return (await own.json(`/api/v1/volumes/${id}`)).json;
  };
  const a = await open('fields.vtk', 'a');
  assert.deepEqual([a.value_name ?? a.fields[0].name, a.other_fields, a.range], ['a', ['b', 'magnitude', 'flow x', 'flow y', 'flow z'], [7, 7]]);
  assert.deepEqual([a.fields[1].name, a.fields[1].components, a.warnings?.filter((text) => text.includes('left out'))], ['flow', 3, a.warnings ? [] : undefined]);
  assert.deepEqual((await open('fields.vtk?field=b', 'b')).range, [9, 9]);
  const series = await open('series.mha', 'series');
  assert.deepEqual([series.steps, series.range], [{ count: 2, unit: '', times: [0, 0.5] }, [20, 20]]);
  const sums = [];
  for (const step of [0, 1]) {
    const answer = await own.fetch('/api/v1/render?format=png', { method: 'POST', headers: { 'Content-Type': 'application/json' },
      body: JSON.stringify({ volume: 'series', size: [32, 32], time: { step }, transfer_function: { points: [0, 60].map((value) => ({ value, color: [1, 1, 1], opacity: value / 80 })) } }) });
    assert.equal(answer.status, 200, answer.status === 200 ? '' : await answer.text());
    sums.push(Buffer.from(await answer.arrayBuffer()));
  }
  assert.ok(!sums[0].equals(sums[1]), 'the second step is another image');
  assert.equal(readdirSync(cache).length, 4);
  assert.equal(await own.stop(), 0);
});

test('with --cache, vectors and rectilinear axes are shown from bricks', { skip: sameThreads }, async () => {
  const data = mkdtempSync(path.join(folder, 'data-'));
  const side = 90;
  const floats = (count, at) => {
    const bytes = Buffer.alloc(4 * count);
    for (let i = 0; i < count; i++) bytes.writeFloatBE(at(i), 4 * i);
    return bytes;
  };
  const places = Array.from({ length: side }, (_, i) => i + 0.9 * Math.sin(i / 9));
  const axes = ['X', 'Y', 'Z'].flatMap((name) => [Buffer.from(`${name}_COORDINATES ${side} float\n`), floats(side, (i) => places[i]), Buffer.from('\n')]);
  const wind = floats(3 * side ** 3, (i) => [(Math.floor(i / 3) % side) - 45, 20, Math.floor(i / 3 / side) % side][i % 3]);
  writeFileSync(path.join(data, 'wind.vtk'), Buffer.concat([
    Buffer.from(`# vtk DataFile Version 3.0\nwind\nBINARY\nDATASET RECTILINEAR_GRID\nDIMENSIONS ${side} ${side} ${side}\n`), ...axes,
    Buffer.from(`POINT_DATA ${side ** 3}\nVECTORS wind float\n`), wind, Buffer.from('\n')]));
  const own = await withCache(data, mkdtempSync(path.join(folder, 'cache-')));
  const open = async (file, id) => {
    await own.post('/api/v1/volumes', { path: file, id });
    const { state, reason } = await own.loaded(id);
    assert.equal(state, 'ready', reason);
    return (await own.json(`/api/v1/volumes/${id}`)).json;
  };
  const volume = await open('wind.vtk', 'wind');
  const { whole, fields, coordinates, dims, warnings } = volume;
  assert.deepEqual([whole.dims, fields.map(({ name, components }) => `${name} ${components}`), warnings], [[side, side, side], ['magnitude 1', 'wind 3'], undefined]);
  assert.deepEqual(coordinates.map((places) => places.length), dims);
  const means = places.slice(1).map((place, i) => (place + places[i]) / 2).filter((_, i) => i % 2 === 0);
  assert.equal(dims[0], side / 2);
  for (const [i, place] of coordinates[0].entries()) compare(Math.abs(place - (means[i] - means[0])), '<', 1e-4, 'a place of the coarse level');
  const view = { volume: 'wind', size: [96, 96], layers: [{ type: 'vectors', style: 'blend', color_by: 'magnitude' }], clip: { box: [[0, 0, 0], [0.3, 0.3, 0.3]] },
    camera: { target: [10, 10, 10], position: [12, 14, 90], up: [0, 1, 0], fov_y: 5 },
    transfer_function: { points: [20, 110].map((value) => ({ value, color: [1, 1, value / 110], opacity: 0.3 })) } };
  const images = [];
  for (const phase of [0, 0.5]) {
    view.layers[0].phase = phase;
    const answer = await image(view, {}, own);
    assert.equal(answer.status, 200, answer.status === 200 ? '' : await answer.text());
    assert.deepEqual(['x-complete', 'x-level', 'x-bricks-lost'].map((name) => answer.headers.get(name)), ['true', '0', '0']);
    images.push(Buffer.from(await answer.arrayBuffer()));
  }
  assert.ok(!images[0].equals(images[1]), 'streaks move');
  assert.deepEqual((await open('wind.vtk?field=wind y', 'y')).range, [20, 20]);
  assert.equal(await own.stop(), 0);
});

test('--cache-size removes the files that were used longest ago, and none that is open', { skip: sameThreads }, async () => {
  const data = mkdtempSync(path.join(folder, 'data-'));
  const cache = mkdtempSync(path.join(folder, 'cache-'));
  const header = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${SIDE} ${SIDE} ${SIDE}\nencoding: raw\n\n`;
  for (const name of ['one', 'two']) writeFileSync(path.join(data, `${name}.nrrd`), Buffer.concat([Buffer.from(header), Buffer.alloc(SIDE ** 3, 3)]));
  const own = await withCache(data, cache, '--cache-size', '1');
  const metric = async (name) => Number(new RegExp(`^splatd_cache_${name} (.*)`, 'm').exec(await (await own.fetch('/metrics')).text())[1]);
  const open = async (name) => {
    await own.post('/api/v1/volumes', { path: `${name}.nrrd` });
    assert.equal((await own.loaded(name)).state, 'ready');
  };
  await open('one');
  const [first] = readdirSync(cache);
  assert.deepEqual([await metric('files'), await metric('removals_total')], [1, 0], 'it is open');
  await own.fetch('/api/v1/volumes/one', { method: 'DELETE' });
  await open('two');
  assert.deepEqual([await metric('files'), await metric('removals_total'), await metric('conversions_total')], [1, 1, 2]);
  const [second, ...others] = readdirSync(cache);
  assert.deepEqual(others, []);
  assert.notEqual(second, first);
  assert.equal(await own.stop(), 0);
});

test('with --cache, a volume that does not fit is converted once', async () => {
  const cache = mkdtempSync(path.join(folder, 'cache-'));
  const data = mkdtempSync(path.join(folder, 'data-'));
  const side = 210;
  const header = `NRRD0004\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n\n`;
  writeFileSync(path.join(data, 'big.nrrd'), Buffer.concat([Buffer.from(header), Buffer.alloc(side ** 3, 7)]));
  let file;
  for (let i = 0; i < 2; i++) {
    const own = await Daemon.start(['--data', data, '--memory', `${MEMORY}`, '--cache', cache], { backend: 'cpu' });
    await own.post('/api/v1/volumes', { path: 'big.nrrd' });
    const { state, name, source, whole } = await own.loaded('big');
    assert.deepEqual([state, name, source, whole.dims], ['ready', 'big', 'big.nrrd', [side, side, side]]);
    const files = readdirSync(cache);
    assert.equal(files.length, 1);
    const { ino } = statSync(path.join(cache, files[0]));
    assert.equal(file ??= ino, ino, 'it is converted once');
    assert.equal(own.log.includes('is converted for the brick cache'), i === 0);
    assert.equal(await own.stop(), 0);
  }
});

/** The largest amount of memory that the daemon has had [bytes]. */
const peak = (own) => Number(/^VmHWM:\s+(\d+)/m.exec(readFileSync(`/proc/${own.child.pid}/status`, 'utf8'))[1]) * 1024;

const small = process.env.SPLATD_SANITIZE && 'the other tests run the same code with fewer samples under a sanitizer';

test('2048³ samples (8 GiB) with --memory 512M: complete pictures from afar and from near', { skip: small }, async () => {
  const [side, memory] = [2048, 512 << 20];
  const data = mkdtempSync(path.join(folder, 'data-'));
  const { point } = writeVessels(path.join(data, 'vessels.nrrd'), side, 3);
  execFileSync(path.join(BIN, 'splatctl'), ['convert', path.join(data, 'vessels.nrrd'), path.join(data, 'vessels.bricks')]);
  rmSync(path.join(data, 'vessels.nrrd'));
  const own = await Daemon.start(['--data', data, '--memory', '512M'], { backend: 'cpu' });
  assert.equal((await own.post('/api/v1/volumes', { path: 'vessels.bricks' })).status, 202);
  const { state, whole } = await own.loaded('vessels');
  assert.deepEqual([state, whole.dims, whole.bytes], ['ready', [side, side, side], side ** 3]);
  const { camera } = (await own.json('/api/v1/volumes/vessels/view')).json;
  const near = { target: point, position: [point[0], point[1], point[2] + 1000], up: [0, 1, 0], fov_y: 1 };
  const clip = { box: [0, 1].map((end) => point.map((at) => at / side + (end ? 0.02 : -0.02))) };
  for (const [level, view] of [[3, { size: [64, 64], camera }], [2, { size: [800, 800], camera }], [0, { size: [64, 64], camera: near, clip }]]) {
    const answer = await image({ volume: 'vessels', ...view }, {}, own);
    assert.equal(answer.status, 200);
    assert.deepEqual(['x-complete', 'x-level', 'x-level-asked', 'x-bricks-lost'].map((name) => answer.headers.get(name)), ['true', `${level}`, `${level}`, '0']);
    compare(Number(answer.headers.get('x-splats')), '>', 0, 'splats');
  }
  compare(peak(own), '<=', 1.1 * memory, 'peak memory of the daemon');
  assert.equal(await own.stop(), 0);
  rmSync(data, { recursive: true });
});

test('a sparse volume whose samples do not fit onto the disk is an error that says so, and leaves nothing', (t) => {
  if (spawnSync('unshare', ['-rm', 'true']).status !== 0) return t.skip('no disk of its own: unshare -rm');
  const data = mkdtempSync(path.join(folder, 'data-'));
  const disk = path.join(data, 'disk');
  writeVessels(path.join(data, 'vessels.nrrd'), 256, 3); // 0.4 MB in 16 MiB
  mkdirSync(disk);
  const script = `mount -t tmpfs -o size=64k none ${disk} && { "$0" "$@"; echo "status $?" >&2; ls -A ${disk}; }`;
  const { stdout, stderr } = spawnSync('unshare', ['-rm', 'sh', '-c', script, path.join(BIN, 'splatctl'), 'convert', path.join(data, 'vessels.nrrd'), path.join(disk, 'out.bricks')], { encoding: 'utf8' });
  assert.match(stderr, /vessels\.nrrd: cannot write the samples: the disk is full or fails\n[^]*status 1\n/);
  assert.equal(stdout, '');
});

test('a disk that fills up while an output is written is an error that says so, and leaves nothing', (t) => {
  if (spawnSync('unshare', ['-rm', 'true']).status !== 0) return t.skip('no disk of its own: unshare -rm');
  const disk = mkdtempSync(path.join(folder, 'disk-'));
  const script = `mount -t tmpfs -o size=160k none ${disk} && for name in a.nrrd a.nii a.nii.gz a.vdb a.bricks a.zarr; do
    "$0" convert 'demo:noise?size=50' ${disk}/$name; echo "$name $? $(ls -A ${disk})"; done`; // 125 kB of samples
  const { stdout, stderr } = spawnSync('unshare', ['-rm', 'sh', '-c', script, path.join(BIN, 'splatctl')], { encoding: 'utf8' });
  assert.equal(stdout, ['nrrd', 'nii', 'nii.gz', 'vdb', 'bricks', 'zarr'].map((suffix) => `a.${suffix} 1 \n`).join(''), stderr);
  assert.equal(stderr.match(/cannot write.*: No space left on device\n/g)?.length, 6, stderr);
});

test('slices and measurements of a volume that is larger than memory have all voxels', async () => {
  const query = (more) => `/api/v1/volumes/large/slice?format=raw&${more}`;
  const coarse = await daemon.fetch(query('axis=2&index=0'));
  assert.deepEqual(JSON.parse(coarse.headers.get('x-slice')).shape, scene.dims.slice(0, 2));
  const fine = await daemon.fetch(query('axis=2&index=100&level=0'));
  assert.equal(fine.status, 200, fine.status === 200 ? '' : await fine.text());
  const { shape, type } = JSON.parse(fine.headers.get('x-slice'));
  assert.deepEqual([shape, type, fine.headers.get('x-level'), fine.headers.get('x-complete')], [[SIDE, SIDE], 'uint8', '0', 'true']);
  const values = new Uint8Array(await fine.arrayBuffer());
  const marker = await daemon.post('/api/v1/measure', { volume: 'large', kind: 'marker', points: [[37, 51, 100]] });
  assert.equal(marker.json.value, values[51 * SIDE + 37], 'the value of a voxel');
  assert.equal((await daemon.fetch(query('axis=2&index=0&level=9'))).status, 422);
});
