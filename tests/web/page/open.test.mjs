// SPDX-License-Identifier: Apache-2.0
// Opening volumes in the page: the data folder, files of this computer with interruptions, closing, and what guests see.
import assert from 'node:assert/strict';
import { execFileSync } from 'node:child_process';
import { copyFileSync, existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync, truncateSync, utimesSync, writeFileSync } from 'node:fs';
import http from 'node:http';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { boxOf, checkAxe, firstFrame, NEEDS_AXE, openPage, share, shot, until, visit } from '../support/browser.mjs';
import { BIN, startDaemon } from '../support/daemon.mjs';

const folder = mkdtempSync(path.join(tmpdir(), 'splatd-open-'));
const { browser } = await share(null, () => rmSync(folder, { recursive: true }));
let daemon;

/** An NRRD file with a box in side³ voxels. */
function cube(side) {
  const voxels = Buffer.alloc(side ** 3);
  for (let i = 0; i < voxels.length; i++) voxels[i] = [i % side, Math.floor(i / side) % side, Math.floor(i / side / side)].every((x) => x > side / 4 && x < side * 3 / 4) ? 200 : 0;
  return Buffer.concat([Buffer.from(`NRRD0004\ncontent: density\ntype: uint8\ndimension: 3\nsizes: ${side} ${side} ${side}\nencoding: raw\n\n`), voxels]);
}

/** Points with two fields, which one of them does not have. */
const CSV = `x,y,z,heat,age\n${Array.from({ length: 200 }, (_, i) => `${i % 6},${Math.floor(i / 6) % 6},${Math.floor(i / 36)},${i},${200 - i}`).join('\n')}\n3,3,9,,\n`;

/** A grid with a scalar and two vectors per sample. */
const STORM = `# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 4 4 4\nPOINT_DATA 64\nSCALARS heat float\nLOOKUP_TABLE default\n${
  Array.from({ length: 64 }, (_, i) => i).join(' ')}\nVECTORS wind float\n${'1 2 2 '.repeat(64)}\nVECTORS flow float\n${'0 3 4 '.repeat(64)}\n`;

/** A DICOM series of 4 slices. */
const SLICES = [0, 1, 2, 3].map((k) => path.join(import.meta.dirname, `../../unit/data/import/dicom/series${k}.dcm`));

const LARGE = { name: 'large.nrrd', mimeType: '', buffer: cube(150) }; // 3.4 MB: several parts
const SMALL = { name: 'Größe 1.nrrd', mimeType: '', buffer: cube(24) };

before(() => {
  for (const name of ['notes', 'slices']) mkdirSync(path.join(folder, 'scans', 'old', name), { recursive: true });
  writeFileSync(path.join(folder, 'scans', 'old', 'notes', 'notes.md'), 'About the scans.');
  for (const file of SLICES) copyFileSync(file, path.join(folder, 'scans', 'old', 'slices', path.basename(file)));
  writeFileSync(path.join(folder, 'cube.nrrd'), cube(24));
  writeFileSync(path.join(folder, 'scans', 'head10.nrrd'), cube(16));
  writeFileSync(path.join(folder, 'scans', 'head2.nrrd'), cube(16));
  for (const name of ['a', 'b']) writeFileSync(Buffer.concat([Buffer.from(path.join(folder, 'scans', name)), Buffer.from([0xff]), Buffer.from('.nrrd')]), cube(16)); // not UTF-8
  writeFileSync(path.join(folder, 'table.csv'), CSV);
  writeFileSync(path.join(folder, 'storm.vtk'), STORM);
  writeFileSync(path.join(folder, 'tri.ply'), 'ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n'
    + 'element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n');
  writeFileSync(path.join(folder, 'broken.nrrd'), 'NRRD0004\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\nshort');
});

async function open(context, { args = [], options } = {}) {
  daemon = await startDaemon(['--volume', 'demo:phantom?size=32', '--backend', 'null', '--data', folder, '--upload-bytes', '20M', ...args]);
  context.after(() => daemon.stop());
  return visit(context, browser, daemon.url, options);
}

/** Serves the files of a folder on a free port; resolves to "127.0.0.1:PORT". */
async function serve(context, root) {
  const server = http.createServer((request, response) => {
    const file = path.join(root, decodeURIComponent(new URL(request.url, 'http://x').pathname));
    const bytes = existsSync(file) && statSync(file).isFile() && readFileSync(file);
    response.writeHead(bytes ? 200 : 404);
    response.end(bytes || undefined);
  });
  await new Promise((ready) => { server.listen(0, '127.0.0.1', ready); });
  context.after(() => { server.closeAllConnections(); server.close(); });
  return `127.0.0.1:${server.address().port}`;
}

/** A guest of the page's session, who may control it. */
async function join(context, page) {
  const { origin, searchParams } = new URL(daemon.url);
  const id = await page.evaluate(() => window.splatd.session);
  const answer = await fetch(`${origin}/api/v1/sessions/${id}`, { headers: { Authorization: `Bearer ${searchParams.get('token')}` } });
  const { tokens } = await answer.json();
  const guest = await openPage(browser);
  context.after(() => guest.context.close());
  await guest.page.goto(`${origin}/#session=${id}&token=${tokens.control}`);
  await firstFrame(guest.page);
  return guest;
}

const shows = (page, name) => page.locator('#volumes .pick[aria-current]', { hasText: name }).waitFor();
const entries = (page) => page.locator('#open-list .name').allTextContents();

test('the data folder by keyboard: folders, filter, back, open; then it is among the recent ones', async (context) => {
  const { page, said } = await open(context);
  await page.focus('#screen');
  await page.keyboard.press('o');
  await page.locator('#open-list [data-name="scans"]').waitFor();
  assert.deepEqual(await entries(page), ['scans', 'broken.nrrd', 'cube.nrrd', 'storm.vtk', 'table.csv', 'tri.ply']);
  assert.match(await page.locator('[data-name="table.csv"] .about').textContent(), /^CSV · Points · [\d.]+ kB$/);
  assert.match(await page.locator('[data-name="tri.ply"] .about').textContent(), /^PLY · Triangles · \d+ B$/);
  assert.match(await page.locator('[data-name="cube.nrrd"] .about').textContent(), /^24 × 24 × 24 · uint8 · 14 kB$/);
  if (!NEEDS_AXE.skip) await checkAxe(page);
  await shot(page, 'open-folder');
  assert.ok(await page.locator('#open-unlisted').isHidden());
  await page.keyboard.press('ArrowDown');
  await page.keyboard.press('Enter');
  await page.locator('[data-name="head2.nrrd"]').waitFor();
  assert.deepEqual(await entries(page), ['old', 'head*.nrrd', 'head2.nrrd', 'head10.nrrd']);
  await page.keyboard.press('Backspace');
  await page.locator('#open-list [data-name="scans"]:focus').waitFor();
  await page.keyboard.press('Enter');
  await page.locator('[data-name="head2.nrrd"]').waitFor();
  await page.locator('#open-unlisted', { hasText: '2 files or folders are not listed, because their names are not UTF-8' }).waitFor();
  await page.fill('#open-filter', 'head 10');
  assert.deepEqual(await entries(page), ['head10.nrrd']);
  await page.keyboard.press('Enter');
  await shows(page, 'head10');
  await page.locator('#open').waitFor({ state: 'hidden' });
  await page.click('#open-button');
  await page.locator('#open-recent-list button', { hasText: 'head10.nrrd' }).waitFor();
  await page.keyboard.press('Escape');
  assert.deepEqual(said, []);
});

test('a folder of a DICOM series has one entry for all its files, and one without volumes says so', async (context) => {
  const { page, said } = await open(context);
  await page.click('#open-button');
  for (const name of ['scans', 'old', 'notes']) await page.locator(`#open-list [data-name="${name}"]`).click();
  await page.locator('#open-said', { hasText: 'This folder has no files that splatd reads.' }).waitFor();
  await page.locator('#open-crumbs button', { hasText: 'old' }).click();
  await page.locator('#open-list [data-name="slices"]').click();
  await page.locator('[data-name="series3.dcm"]').waitFor();
  await page.locator('#open-list [data-kind="series"]').waitFor();
  assert.deepEqual(await entries(page), ['Series without a name', ...SLICES.map((file) => path.basename(file))]);
  assert.match(await page.locator('#open-list [data-kind="series"] .about').textContent(), /^CT · 4 images · 16 × 12 · \d/);
  assert.match(await page.locator('[data-name="series0.dcm"] .about').textContent(), /^DICOM · opens its series · \d/);
  await shot(page, 'open-series');
  await page.fill('#open-filter', '3');
  assert.deepEqual(await entries(page), ['series3.dcm'], 'a filter looks for files');
  await page.fill('#open-filter', '');
  await page.locator('#open-list button').first().click();
  await shows(page, 'Series without a name');
  assert.match(await page.locator('#volumes .pick[aria-current] .about').textContent(), /× 4 · int16$/);
  await page.click('#open-button');
  await page.locator('#open-recent-list button', { hasText: 'Series without a name' }).waitFor();
  assert.deepEqual(said, []);
});

test('the filter finds names in sub-folders, with their folders; they open', async (context) => {
  const { page, said } = await open(context);
  const odd = path.join(folder, 'scans', 'old', 'rück & blick');
  mkdirSync(odd);
  context.after(() => rmSync(odd, { recursive: true }));
  for (const name of ['why? 100% *#1.nrrd', 'Übung.nrrd']) writeFileSync(path.join(odd, name), cube(16));
  const found = () => page.locator('#open-list li').evaluateAll((rows) => rows.map((row) => [...row.querySelectorAll('.name, .place')].map((part) => part.textContent)));
  const settled = () => page.waitForFunction(() => !document.getElementById('open-said').textContent.startsWith('Looking'));
  await page.click('#open-button');
  await page.locator('#open-list [data-name="scans"]').waitFor();
  await page.fill('#open-filter', 'head');
  await page.locator('#open-list .place').first().waitFor();
  assert.deepEqual(await found(), [['head*.nrrd', 'scans']]);
  await page.fill('#open-filter', '*');
  await page.locator('[data-name="scans/old/rück & blick/why? 100% *#1.nrrd"]').waitFor();
  await page.fill('#open-filter', 'Series');
  await page.locator('[data-name="scans/old/slices/series0.dcm"]').waitFor();
  assert.deepEqual(await found(), [['series0.dcm', 'scans/old/slices']]);
  assert.match(await page.locator('[data-name="scans/old/slices/series0.dcm"] .about').textContent(), /^opens its series: 4 DICOM files match · \d/);
  if (!NEEDS_AXE.skip) await checkAxe(page);
  await shot(page, 'open-search');
  await page.fill('#open-filter', 'no such name');
  await page.locator('#open-said', { hasText: 'No name contains “no such name”, neither here nor in sub-folders.' }).waitFor();
  await page.fill('#open-filter', 'blick');
  await page.locator('#open-list [data-kind="folder"]').click();
  await page.locator('#open-crumbs [aria-current]', { hasText: 'rück & blick' }).waitFor();
  assert.equal(await page.inputValue('#open-filter'), '');
  await page.locator('#open-crumbs button', { hasText: 'scans' }).click();
  await page.locator('#open-list [data-name="old"]').waitFor();
  await page.fill('#open-filter', 'why? 100%');
  await page.locator('#open-list .place', { hasText: /^old\/rück & blick$/ }).waitFor();
  await settled();
  await page.keyboard.press('Enter');
  await shows(page, 'why? 100% *#1');
  assert.deepEqual(said, []);
});

test('another field of the file is loaded and shown under the same camera', async (context) => {
  const { page, said } = await open(context);
  await page.click('#open-button');
  await page.locator('[data-name="table.csv"]').click();
  await shows(page, 'table');
  const field = page.locator('#volume-field');
  await field.waitFor();
  assert.equal(await field.inputValue(), 'heat');
  const warning = '1 of the 201 points are not drawn';
  await page.locator('#notice[data-tone="info"]', { hasText: `table: ${warning}` }).waitFor();
  await page.click('#volume-info summary');
  await page.locator('#volume-info dd', { hasText: warning }).waitFor();
  await shot(page, 'open-warning');
  await page.focus('#screen');
  await page.keyboard.press('ArrowLeft');
  const camera = await until(page, 'a turned picture', (s) => s.isIdle && s.seq === s.sent && s.camera);
  await field.selectOption('age');
  await shows(page, 'table age');
  await until(page, 'the other field', (s) => s.isIdle && s.volume === 'table-age');
  assert.equal(await field.inputValue(), 'age');
  assert.deepEqual(await page.evaluate(() => window.splatd.camera.position), camera.position);
  await shot(page, 'open-field');
  const guest = await join(context, page);
  const named = guest.page.locator('#volume-field');
  await named.waitFor();
  assert.deepEqual([await named.inputValue(), await named.isDisabled()], ['age', true], 'a guest sees which field it is');
  // Back: the volume exists already.
  await field.selectOption('heat');
  await until(page, 'the first field', (s) => s.isIdle && s.volume === 'table');
  await until(guest.page, 'the same', (s) => s.volume === 'table');
  await guest.page.waitForFunction(() => document.getElementById('volume-field').value === 'heat');
  assert.equal(await page.locator('#volumes li').count(), 3);
  await page.locator('#volumes .pick', { hasText: 'phantom' }).click();
  await field.waitFor({ state: 'hidden' });
  assert.deepEqual(said, []);
});

test('other vectors of the file, their length and their components are fields', async (context) => {
  const { page, said } = await open(context);
  await page.click('#open-button');
  await page.locator('[data-name="storm.vtk"]').click();
  await shows(page, 'storm');
  const [field, vectors] = ['#volume-field', '#volume-vectors'].map((id) => page.locator(id));
  const names = (select) => select.locator('option').allTextContents();
  await vectors.waitFor();
  assert.deepEqual([await names(field), await names(vectors)], [['heat', 'magnitude', 'wind x', 'wind y', 'wind z'], ['wind', 'flow']]);
  await vectors.selectOption('flow');
  await until(page, 'other vectors', (s) => s.isIdle && s.volume === 'storm-flow');
  assert.deepEqual([await field.inputValue(), await vectors.inputValue(), await names(field)], ['heat', 'flow', ['heat', 'magnitude', 'flow x', 'flow y', 'flow z']]);
  await field.selectOption('magnitude');
  await until(page, 'their lengths', (s) => s.isIdle && s.volume === 'storm-magnitude-flow');
  assert.equal(await vectors.inputValue(), 'flow');
  await shot(page, 'open-vectors');
  await page.click('#layer-add-vectors');
  const colors = page.locator('#vectors-color-by');
  assert.deepEqual(await names(colors), ['magnitude', 'heat', 'flow x', 'flow y', 'flow z']);
  await colors.selectOption('flow x');
  await until(page, 'the colours of another field', (s) => s.isIdle && s.view.layers.at(-1).color_by === 'storm-flow-x-flow');
  assert.equal(await colors.locator('option:checked').textContent(), 'flow x');
  assert.deepEqual(said, []);
});

test('a file is uploaded with progress, continues by itself after lost connections, and is shown', async (context) => {
  const { page } = await open(context);
  let parts = 0;
  await page.route('**/api/v1/uploads/*', (route) => {
    if (route.request().method() !== 'PATCH') return route.continue();
    parts += 1;
    return parts === 2 || parts === 3 ? route.abort('connectionreset') : route.continue();
  });
  await page.click('#open-button');
  await page.setInputFiles('#open-file', LARGE);
  await page.locator('#uploads [data-state="waiting"]', { hasText: 'no connection' }).waitFor();
  await shot(page, 'open-waiting');
  await shows(page, 'large');
  await page.locator('#uploads li').waitFor({ state: 'detached' });
  assert.ok(parts >= 4, `${parts} parts`);
});

/** The time of the last change of files on the disk: whole seconds, which every file system and browser keeps. */
const MTIME = new Date(Math.floor(Date.now() / 1000) * 1000);

/** Writes files to the disk, where they keep the time of their last change; returns their paths. */
function onDisk(context, files) {
  const own = mkdtempSync(path.join(tmpdir(), 'splatd-own-'));
  context.after(() => rmSync(own, { recursive: true }));
  return files.map(({ name, buffer }) => {
    const file = path.join(own, name);
    writeFileSync(file, buffer);
    utimesSync(file, MTIME, MTIME);
    return file;
  });
}

test('an upload is paused, a reload interrupts it, and the same file continues it, but not one that changed', async (context) => {
  const { page, said } = await open(context);
  const file = onDisk(context, [LARGE])[0];
  const offsets = [];
  let isHeld = true;
  await page.route('**/api/v1/uploads/*', (route) => {
    if (route.request().method() !== 'PATCH') return route.continue();
    offsets.push(Number(route.request().headers()['upload-offset']));
    return offsets.length > 1 && isHeld ? undefined : route.continue(); // the second part hangs
  });
  await page.click('#open-button');
  await page.setInputFiles('#open-file', file);
  await page.locator('#uploads .about', { hasText: /^31 % of 3.4 MB/ }).waitFor();
  await page.getByRole('button', { name: 'Pause the upload of large.nrrd' }).click();
  await page.locator('#uploads [data-state="paused"]', { hasText: 'paused at 31 %' }).waitFor();
  if (!NEEDS_AXE.skip) await checkAxe(page);
  await page.reload();
  await firstFrame(page);
  await page.locator('#uploads [data-before]', { hasText: '31 % of 3.4 MB arrived before' }).waitFor();
  await shot(page, 'open-before');
  const choose = async () => {
    const chooser = page.waitForEvent('filechooser');
    await page.click('#uploads .link');
    await (await chooser).setFiles(file);
  };
  utimesSync(file, MTIME, new Date(MTIME.getTime() + 5000)); // another file of this name and size
  const began = page.waitForRequest((request) => request.method() === 'PATCH' && request.headers()['upload-offset'] === '0');
  await choose();
  await began;
  await page.locator('#uploads [data-upload="large.nrrd"]').getByRole('button', { name: 'Cancel the upload of large.nrrd' }).click();
  utimesSync(file, MTIME, MTIME);
  isHeld = false;
  await choose();
  await shows(page, 'large');
  assert.deepEqual(offsets.slice(0, 4), [0, 1 << 20, 0, 1 << 20]);
  assert.deepEqual(said, []);
});

test('the files of a DICOM series are chosen together, share one row, and are one volume', async (context) => {
  const { page } = await open(context);
  await page.evaluate(() => {
    const seen = (window.rowsSeen = new Set());
    new MutationObserver(() => {
      for (const row of document.querySelectorAll('#uploads li:not([hidden])')) seen.add(row.dataset.upload);
    }).observe(document.getElementById('uploads'), { childList: true, subtree: true, attributes: true });
  });
  await page.setInputFiles('#open-file', SLICES);
  await shows(page, 'series0');
  assert.deepEqual(await page.evaluate(() => [...window.rowsSeen]), ['series0.dcm']);
});

test('files are dropped on the page: one is shown, the errors of others stand beside their names', async (context) => {
  const state = mkdtempSync(path.join(tmpdir(), 'splatd-state-')); // a daemon with it keeps the uploads of open volumes
  const { page } = await open(context, { args: ['--state', state] });
  context.after(() => rmSync(state, { recursive: true }));
  const drop = (type, files) => page.evaluate(([kind, list]) => {
    const data = new DataTransfer();
    for (const { name, bytes } of list) data.items.add(new File([new Uint8Array(bytes)], name));
    document.getElementById('screen').dispatchEvent(new DragEvent(kind, { bubbles: true, cancelable: true, dataTransfer: data }));
  }, [type, files]);
  const files = [{ name: SMALL.name, bytes: [...SMALL.buffer] }, { name: 'notes.txt', bytes: [1] }];
  await drop('dragenter', files);
  await page.locator('#drop', { hasText: 'Drop files' }).waitFor();
  await shot(page, 'open-drop');
  await drop('drop', files);
  assert.ok(await page.locator('#drop').isHidden());
  await shows(page, 'Größe 1');
  await page.locator('#uploads [data-upload="notes.txt"] .about', { hasText: 'its name must end in .nrrd' }).waitFor();
  await page.getByRole('button', { name: 'Cancel the upload of notes.txt' }).click();
  await page.locator('#uploads').waitFor({ state: 'hidden' });
  await page.click('#open-button');
  const huge = path.join(mkdtempSync(path.join(tmpdir(), 'splatd-huge-')), 'huge.nrrd');
  context.after(() => rmSync(path.dirname(huge), { recursive: true }));
  writeFileSync(huge, '');
  truncateSync(huge, 21 << 20);
  await page.setInputFiles('#open-file', huge);
  await page.locator('#uploads [data-state="failed"]', { hasText: 'The file has 22 MB, and the daemon takes at most 21 MB' }).waitFor();
  truncateSync(huge, (20 << 20) - 5000); // the volume that is open has 14 kB
  await page.setInputFiles('#open-file', huge);
  await page.locator('#uploads [data-state="failed"]', { hasText: 'The file has 20.97 MB, and 20.96 MB are free for uploads. Close volumes that you uploaded' }).waitFor();
  assert.equal(await page.locator('#uploads [data-upload="huge.nrrd"]').count(), 1, 'the refusal of before is gone');
  await page.setInputFiles('#open-file', { name: 'empty.nrrd', mimeType: '', buffer: Buffer.alloc(0) });
  await page.locator('#notice', { hasText: 'empty.nrrd is empty' }).waitFor();
  await shot(page, 'open-full');
  await page.setInputFiles('#open-file', { ...SMALL, name: 'next.nrrd' });
  await shows(page, 'next');
  assert.ok(await page.locator('#notice').isHidden(), 'the notice was about other files');
  let release;
  const held = new Promise((resolve) => { release = resolve; });
  await page.route('**/api/v1/uploads/*', async (route) => {
    if (route.request().method() === 'PATCH') await held;
    await route.continue();
  });
  await page.setInputFiles('#open-file', ['1', '2', '3', '4', '5'].map((name) => ({ ...SMALL, name: `many${name}.nrrd` })));
  await page.locator('#uploads [data-state="sending"]').nth(2).waitFor();
  assert.deepEqual(await page.locator('#uploads [data-state="idle"] .about').allTextContents(), Array(2).fill('14 kB, waits for other uploads'));
  await shot(page, 'open-many');
  release();
  for (const name of ['1', '2', '3', '4', '5']) await page.locator('#volumes .pick:not(:disabled)', { hasText: `many${name}` }).waitFor();
});

test('a failed load says why and is removed; closing the shown volume shows another one; the info follows', async (context) => {
  const { page, said } = await open(context);
  await page.click('#open-button');
  await page.click('[data-name="broken.nrrd"]');
  await page.locator('#volumes [data-state="failed"] .about', { hasText: 'the samples need 729 bytes' }).waitFor();
  await page.locator('#volumes [data-state="failed"] .about', { hasText: /failed: broken.nrrd: byte \d+: sizes: / }).waitFor();
  await page.locator('#notice', { hasText: /broken.nrrd: byte \d+: sizes: the samples/ }).waitFor();
  if (!NEEDS_AXE.skip) await checkAxe(page);
  await shot(page, 'open-failed');
  await page.getByRole('button', { name: 'Remove broken from the list' }).click();
  await page.locator('#volumes .pick[data-id="broken"]').waitFor({ state: 'detached' });
  await page.click('#volume-info summary');
  await page.locator('#volume-info dd', { hasText: 'demo:phantom?size=32' }).waitFor();
  await page.click('#open-button');
  await page.click('[data-name="cube.nrrd"]');
  await shows(page, 'cube');
  await page.locator('#volume-info dd', { hasText: '24 × 24 × 24' }).waitFor();
  await page.locator('#volume-info dd', { hasText: 'density' }).waitFor();
  const other = await openPage(browser); // another session, which also shows the volume
  context.after(() => other.context.close());
  await other.page.goto(`${daemon.url}&volume=cube`);
  await firstFrame(other.page);
  await shows(other.page, 'cube');
  await page.getByRole('button', { name: 'Close cube' }).click();
  await page.locator('dialog', { hasText: 'Others see it now' }).getByRole('button', { name: 'Close it' }).click();
  await shows(page, 'phantom');
  await shows(other.page, 'phantom');
  await other.context.close();
  const token = new URL(daemon.url).searchParams.get('token');
  await page.waitForFunction(async (key) => { // the daemon has noticed
    const answer = await fetch('api/v1/volumes/phantom', { headers: { Authorization: `Bearer ${key}` } });
    return (await answer.json()).sessions === 1;
  }, token);
  await page.locator('#notice', { hasText: 'cube was closed' }).waitFor();
  await page.getByRole('button', { name: 'Close phantom' }).click();
  await page.locator('#banner', { hasText: 'No volume is loaded' }).waitFor();
  await page.locator('#banner-text', { hasText: 'Use Open to choose one' }).waitFor();
  await page.click('#banner-open');
  await page.click('[data-name="cube.nrrd"]');
  await shows(page, 'cube');
  await until(page, 'a picture again', (s) => s.state === 'live' && s.count > 0);
  assert.deepEqual(said.filter((text) => !/404/.test(text)), []);
});

test('a choice of the dialog is remembered for a file once it opened with it; what is no unit is refused', async (context) => {
  const { page, said } = await open(context);
  const row = page.locator('#open-list [data-name="cube.nrrd"]');
  await page.click('#open-button');
  await page.selectOption('#open-as', 'time');
  await row.click();
  await page.locator('#notice[data-tone="error"]', { hasText: 'cube' }).waitFor();
  await page.click('#open-button');
  assert.equal(await row.locator('.about').textContent(), '24 × 24 × 24 · uint8 · 14 kB', 'what failed is not remembered');
  assert.ok(await page.locator('#open-recent').isHidden());
  await page.fill('#open-unit', 'mm mm');
  await row.click();
  await page.locator('#open-said.complaint', { hasText: '“mm mm” is not a unit' }).waitFor();
  await page.locator('#open-unit:focus').waitFor();
  await page.fill('#open-unit', 'µm');
  await row.click();
  await shows(page, 'cube');
  await page.waitForFunction(() => Object.values(localStorage).some((text) => text.includes('µm'))); // an older cube may have been shown
  await page.click('#open-button');
  await row.locator('.about', { hasText: /µm$/ }).waitFor(); // the dialog shows its last list until it has a new one
  await page.locator('#open-recent-list button', { hasText: 'cube.nrrd' }).waitFor();
  assert.deepEqual(said, []);
});

test('a guest by a join link opens and closes nothing, and reads why; a phone shows the whole dialog', async (context) => {
  const { page } = await open(context, { options: { viewport: { width: 390, height: 844 }, hasTouch: true } });
  await page.click('#panel-toggle');
  await page.click('#open-button');
  await page.locator('#open-list button').first().waitFor();
  const box = await boxOf(page.locator('#open'));
  assert.ok(box.x >= 0 && box.x + box.width <= 390 && box.y >= 0 && box.y + box.height <= 844, JSON.stringify(box));
  await shot(page, 'open-phone');
  await page.keyboard.press('Escape');
  const { url } = daemon;
  const token = new URL(url).searchParams.get('token');
  const base = new URL('.', url).href;
  const session = await (await fetch(`${base}api/v1/sessions`, { method: 'POST', body: '{}', headers: { Authorization: `Bearer ${token}`, 'Content-Type': 'application/json' } })).json();
  const guest = await openPage(browser);
  context.after(() => guest.context.close());
  const asked = [];
  guest.page.on('request', (request) => asked.push(new URL(request.url()).pathname));
  await guest.page.goto(`${base}#session=${session.id}&token=${session.tokens.control}`);
  await firstFrame(guest.page);
  await guest.page.locator('#volumes-why', { hasText: 'joined by a link' }).waitFor();
  assert.ok(await guest.page.locator('#open-button').isHidden());
  assert.deepEqual(asked.filter((name) => /\/v1\/(files|uploads|volumes)$/.test(name)), []);
});

/** A header and its samples, as two files; `data`: the name that the header gives. */
function pair(data = 'pair.raw', side = 150) {
  const whole = cube(side);
  const at = whole.indexOf('\n\n') + 2;
  const header = whole.subarray(0, at).toString().replace('\n\n', `\ndata file: ${data}\n\n`);
  return [{ name: 'pair.nhdr', mimeType: '', buffer: Buffer.from(header) }, { name: 'pair.raw', mimeType: '', buffer: whole.subarray(at) }];
}

test('a header and its samples are chosen together, survive a reload, and one volume is shown', async (context) => {
  const { page, said } = await open(context);
  const files = onDisk(context, pair());
  let isHeld = true;
  await page.route('**/api/v1/uploads/*', (route) => (route.request().method() === 'PATCH' && isHeld && Number(route.request().headers()['upload-offset']) > 0 ? undefined : route.continue()));
  await page.click('#open-button');
  await page.setInputFiles('#open-file', files);
  await page.locator('#uploads [data-upload="pair.raw"] .about', { hasText: /^31 % of 3.4 MB/ }).waitFor();
  await page.locator('#uploads [data-upload="pair.nhdr"] .about', { hasText: /^100 %/ }).waitFor();
  await shot(page, 'open-set');
  await page.reload();
  await firstFrame(page);
  await page.locator('#uploads [data-before]', { hasText: 'pair.raw' }).waitFor();
  isHeld = false;
  const chooser = page.waitForEvent('filechooser');
  await page.click('#uploads .link');
  await (await chooser).setFiles(files[1]); // the header is there already
  await shows(page, 'pair');
  await page.locator('#uploads').waitFor({ state: 'hidden' });
  assert.deepEqual(said, []);
});

test('a header without its file says which one is missing; a header that leads elsewhere fails and leaves nothing', async (context) => {
  const { page } = await open(context);
  await page.click('#open-button');
  await page.setInputFiles('#open-file', pair()[0]);
  await page.locator('#notice', { hasText: 'pair.nhdr is a header of pair.raw.' }).waitFor();
  await page.click('#open-button');
  await page.setInputFiles('#open-file', pair('../../etc/passwd'));
  await page.locator('#notice', { hasText: 'header of ../../etc/passwd' }).waitFor();
  assert.equal(await page.locator('#uploads [data-upload="pair.nhdr"]').count(), 0);
});

test('the role control opens, uploads, and closes only its own volumes', async (context) => {
  const tokens = path.join(folder, 'tokens');
  writeFileSync(tokens, 'admin-token-admin-token\ncontrol-token-control role=control name=c\n', { mode: 0o600 });
  const own = await startDaemon(['--volume', 'demo:phantom?size=32', '--backend', 'null', '--data', folder, '--token-file', tokens]);
  context.after(() => own.stop());
  const { page, context: tab } = await openPage(browser);
  context.after(() => tab.close());
  const base = new URL('.', own.url).href;
  await page.goto(`${base}?token=control-token-control`);
  await firstFrame(page);
  assert.equal(await page.getByRole('button', { name: 'Close phantom' }).count(), 0);
  await page.click('#open-button');
  await page.locator('#open-list [data-name="cube.nrrd"]').waitFor();
  await page.setInputFiles('#open-file', SMALL);
  await shows(page, 'Größe 1');
  await page.getByRole('button', { name: 'Close Größe 1' }).click();
  await shows(page, 'phantom');
});

test('a remote volume by its address, where the daemon allows its host', { skip: !existsSync(path.join(BIN, 'splat-fetch')) && 'built without libcurl' }, async (context) => {
  const root = mkdtempSync(path.join(tmpdir(), 'splatd-open-remote-'));
  context.after(() => rmSync(root, { recursive: true }));
  execFileSync(path.join(BIN, 'splatctl'), ['convert', 'demo:noise?size=32', path.join(root, 'far away.zarr')]);
  const host = await serve(context, root);
  const { page, said } = await open(context, { args: ['--allow-host', host] });
  // The folder is read only after the refusal, which must stay in view.
  let read = null;
  const mayRead = new Promise((resolve) => { read = resolve; });
  await page.route('**/api/v1/files?*', async (route) => {
    await mayRead;
    await route.continue();
  });
  await page.click('#open-button');
  await page.fill('#open-address', 'http://example.org/v.zarr');
  await page.click('#open-remote button');
  const refusal = page.locator('#open-said.complaint', { hasText: 'example.org, port 80, is not allowed' });
  await refusal.waitFor();
  read();
  await page.locator('#open-list button').first().waitFor();
  assert.ok(await refusal.isVisible());
  await checkAxe(page);
  await shot(page, 'open-remote');
  await page.fill('#open-address', `http://${host}/far%20away.zarr`);
  await page.press('#open-address', 'Enter');
  await shows(page, 'far');
  await page.click('#open-button');
  await page.locator('#open-recent-list button', { hasText: 'far' }).waitFor();
  assert.deepEqual(said.filter((line) => !line.includes('403')), []);
});

test('without allowed hosts no address is asked for', async (context) => {
  const { page } = await open(context);
  await page.click('#open-button');
  await page.locator('#open-upload').waitFor();
  assert.equal(await page.locator('#open-remote').isVisible(), false);
});
