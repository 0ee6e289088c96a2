// SPDX-License-Identifier: Apache-2.0
// Uploads: parts, pauses, lost connections, wrong offsets, refusals. The clock is virtual.
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ApiError } from '../../../clients/web/core/api.js';
import { arranged, below, crumbs, numberedSeries, parentOf, searched, sizeText, withRecent } from '../../../clients/web/core/files.js';
import { Upload, refusalText } from '../../../clients/web/core/upload.js';
import '../support/texts.mjs';

const settled = () => new Promise((resolve) => { setImmediate(resolve); });

/** A daemon that stores bytes, and fails as `faults` says: a list of functions (one per part) or nothing. */
function fixture({ bytes = 3 << 20, id = null, existing = 0 } = {}) {
  const f = { now: 0, timers: [], faults: [], stored: existing, calls: [], states: [], removed: [] };
  const file = { name: 'a.nrrd', size: bytes, slice: (from, to) => ({ from, size: Math.min(to, bytes) - from }) };
  const api = {
    createUpload: async ({ name, size }) => { f.calls.push(['create', name, size]); if (f.refusal) throw f.refusal; f.stored = 0; return { id: 'new' }; },
    upload: async (asked) => { f.calls.push(['ask', asked]); if (f.isGone) throw new ApiError(404, 'gone'); return { offset: f.stored }; },
    uploads: async () => f.limits,
    deleteUpload: async (asked) => { f.removed.push(asked); },
    sendPart: async (to, offset, part, { signal }) => {
      f.calls.push(['part', to, offset, part.size]);
      const fault = f.faults.shift();
      if (fault) await fault(signal, part);
      if (offset !== f.stored) throw new ApiError(409, 'offset');
      f.now += f.partMs ?? 500;
      f.stored += part.size;
      return f.stored;
    },
  };
  f.upload = new Upload({
    file, api: () => api, id,
    env: {
      now: () => f.now, checksum: async () => 'sha256 x', clearTimeout: () => { f.timers = []; },
      setTimeout: (run, ms) => { f.timers.push({ run, ms }); return f.timers.length; },
    },
  });
  f.upload.on('change', ({ state }) => { if (f.states.at(-1) !== state) f.states.push(state); });
  f.until = async (...states) => { for (let i = 0; i < 1000 && !states.includes(f.upload.state); i++) await settled(); assert.ok(states.includes(f.upload.state), f.upload.state); };
  return f;
}

test('a file is sent in parts to its end, with rate and remaining time', async () => {
  const f = fixture();
  f.upload.resume();
  await f.until('sent');
  assert.deepEqual(f.states, ['starting', 'sending', 'sent']);
  assert.deepEqual(f.calls.map((c) => c[0]), ['create', 'part', 'part', 'part']);
  assert.equal(f.upload.sent, 3 << 20);
});

test('rate and remaining time', async () => {
  const f = fixture({ bytes: 4 << 20 });
  const seen = [];
  f.upload.on('change', (u) => seen.push([u.rate, u.secondsLeft]));
  f.upload.resume();
  await f.until('sent');
  assert.deepEqual(seen[2], [(1 << 20) * 2, 1.5]);
});

test('parts grow on a fast connection and shrink on a slow one', async () => {
  const fast = fixture({ bytes: 64 << 20 });
  fast.partMs = 10;
  fast.upload.resume();
  await fast.until('sent');
  const sizes = fast.calls.filter(([what]) => what === 'part').map((c) => c[3] >> 20);
  assert.deepEqual(sizes, [1, 2, 4, 8, 16, 16, 16, 1]);
  const slow = fixture({ bytes: 2 << 20 });
  slow.partMs = 4000;
  slow.upload.resume();
  await slow.until('sent');
  assert.deepEqual(slow.calls.filter(([what]) => what === 'part').map((c) => c[3] >> 10), [1024, 512, 256, 256]);
});

test('after a lost connection it waits, asks how much arrived, and continues there', async () => {
  const f = fixture();
  f.faults = [null, async (_, part) => { f.stored += part.size / 2; throw new TypeError('network'); }];
  f.upload.resume();
  await f.until('waiting');
  assert.equal(f.timers[0].ms, 500);
  assert.match(f.upload.error.message, /network/);
  f.timers[0].run();
  await f.until('sent');
  assert.deepEqual(f.calls.slice(3, 5), [['ask', 'new'], ['part', 'new', 1.5 * (1 << 20), 1 << 20]]);
});

test('the wait grows, up to a limit, and resume() ends it', async () => {
  const f = fixture();
  const waits = [];
  f.faults = Array(8).fill(async () => { throw new ApiError(503, 'busy'); });
  f.upload.resume();
  for (let i = 0; i < 8; i++) {
    await f.until('waiting');
    waits.push(f.timers[0].ms);
    f.upload.resume();
    await settled();
  }
  assert.deepEqual(waits, [500, 1000, 2000, 4000, 8000, 10000, 10000, 10000]);
  await f.until('sent');
});

test('a pause stops the part that is being sent; resume() continues', async () => {
  const f = fixture();
  f.faults = [(signal) => new Promise((_, reject) => { signal.addEventListener('abort', () => reject(new Error('aborted'))); })];
  f.upload.resume();
  for (let i = 0; i < 20; i++) await settled();
  f.upload.pause();
  await f.until('paused');
  for (let i = 0; i < 20; i++) await settled();
  assert.equal(f.upload.state, 'paused');
  f.upload.resume();
  await f.until('sent');
  assert.equal(f.stored, 3 << 20);
});

test('an upload of before continues, and begins again if it has expired', async () => {
  const f = fixture({ id: 'old', existing: 1 << 20 });
  f.upload.resume();
  await f.until('sent');
  assert.deepEqual(f.calls.slice(0, 2), [['ask', 'old'], ['part', 'old', 1 << 20, 1 << 20]]);
  const gone = fixture({ id: 'old' });
  gone.isGone = true;
  gone.upload.resume();
  await gone.until('sent');
  assert.deepEqual(gone.calls.slice(0, 2), [['ask', 'old'], ['create', 'a.nrrd', 3 << 20]]);
});

test('a wrong checksum or offset is tried again three times', async () => {
  const f = fixture();
  f.faults = [async () => { throw new ApiError(460, 'checksum'); }];
  f.upload.resume();
  await f.until('sent');
  const never = fixture();
  never.faults = Array(9).fill(async () => { throw new ApiError(460, 'checksum'); });
  never.upload.resume();
  await never.until('failed');
  assert.equal(never.calls.filter(([what]) => what === 'part').length, 4);
});

test('a refusal is final until it is tried again; cancelling removes what arrived', async () => {
  const f = fixture();
  f.refusal = new ApiError(507, 'the disk for uploads is full');
  f.upload.resume();
  await f.until('failed');
  assert.equal(f.upload.error.message, 'the disk for uploads is full');
  f.refusal = null;
  f.faults = [null, async () => { throw new ApiError(403, 'no'); }];
  f.upload.resume();
  await f.until('failed');
  f.upload.cancel();
  assert.deepEqual([f.upload.state, f.removed], ['cancelled', ['new']]);
});

test('cancelled while the upload is being created: it is removed', async () => {
  const f = fixture();
  f.upload.resume();
  f.upload.cancel();
  for (let i = 0; i < 20; i++) await settled();
  assert.deepEqual([f.upload.state, f.removed], ['cancelled', ['new']]);
});

test('sizes, paths, filters and recent files', () => {
  assert.deepEqual([0, 999, 1000, 1234567, 9990000, 34e9, 5e15].map((bytes) => sizeText(bytes)), ['0 B', '999 B', '1.0 kB', '1.2 MB', '10 MB', '34 GB', '5000 TB']);
  assert.deepEqual(crumbs('a/b'), [{ name: 'a', path: 'a' }, { name: 'b', path: 'a/b' }]);
  assert.deepEqual([parentOf('a/b'), parentOf('a'), parentOf('')], ['a', '', '']);
  const entries = [{ name: 'scan10.nrrd', kind: 'volume' }, { name: 'Scan2.nrrd', kind: 'volume' }, { name: 'z', kind: 'folder' }];
  assert.deepEqual(arranged(entries, '').map(({ name }) => name), ['z', 'Scan2.nrrd', 'scan10.nrrd']);
  assert.deepEqual(arranged(entries, 'SCAN 2').map(({ name }) => name), ['Scan2.nrrd']);
  assert.deepEqual(arranged([{ name: 'GRO\u0308SSE.nrrd' }, { name: 'gross.nrrd' }], 'grösse').map(({ name }) => name), ['GRO\u0308SSE.nrrd'], 'accents make no difference');
  assert.deepEqual([searched('  a \t b '), searched(' '), searched('x'.repeat(300)).length], ['a b', '', 255]);
  const finds = [{ name: 'x', folder: 'a' }, { name: 'x', folder: 'a/b/c' }];
  assert.deepEqual(below('a', finds).map(({ place }) => place), ['b/c']);
  assert.deepEqual(below('', finds).map(({ place }) => place), ['a', 'a/b/c']);
  assert.deepEqual(withRecent([{ source: 'a' }, { source: 'b' }], { source: 'b' }, 2), [{ source: 'b' }, { source: 'a' }]);
});

test('a refusal is told in words and sizes for a person', async () => {
  const refused = async (bytes, error, name = 'a.nrrd', limits = {}) => {
    const f = fixture({ bytes });
    f.limits = { bytes: 5e6, bytes_max: 157286400, bytes_free: 1e6, uploads_free: 3, ...limits };
    f.upload.file.name = name;
    f.refusal = error;
    f.upload.resume();
    await f.until('failed');
    return refusalText(f.upload);
  };
  const large = new ApiError(413, 'the file has 199229440 bytes and --upload-bytes allows 157286400', { pointer: '/bytes' });
  assert.equal(await refused(199229440, large), 'The file has 199 MB, and the daemon takes at most 157 MB.');
  const full = new ApiError(507, 'the file has 2000000 bytes; …');
  assert.match(await refused(2e6, full), /^The file has 2\.0 MB, and 1\.0 MB are free for uploads\. Close volumes that you uploaded/);
  assert.match(await refused(1000400, full), /^The file has 1\.0004 MB, and 1\.0000 MB are free/, 'digits that show the difference');
  assert.match(await refused(2e6, full, 'a.nrrd', { bytes: 0 }), /other users or the disk take the rest\. Try again later/);
  assert.match(await refused(2e6, full, 'a.nrrd', { uploads_free: 0 }), /^The daemon takes no more files now/);
  assert.equal(await refused(9e5, full), 'the file has 2000000 bytes; …', 'there is space by now');
  assert.equal(await refused(1, new ApiError(422, 'the name has a slash', { pointer: '/name' })), 'the name has a slash');
});

test('numbered files of one format are a time series, slices are not', () => {
  const file = (name, format = 'VTK') => ({ name, kind: 'grid', format });
  const entries = [
    file('t1.vti'), file('t10.vti'), file('u1.vti'), file('v.vti'), file('a1_b2.nrrd', 'NRRD'), file('a1_b3.nrrd', 'NRRD'),
    file('s1.dcm', 'DICOM'), file('s2.dcm', 'DICOM'), { name: 'f1', kind: 'folder' }, { name: 'f2', kind: 'folder' },
  ];
  assert.deepEqual(numberedSeries(entries), [{ name: 't*.vti', count: 2 }, { name: 'a*_b*.nrrd', count: 2 }]);
});
