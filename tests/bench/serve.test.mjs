// SPDX-License-Identifier: Apache-2.0
// Small runs of serve.mjs and motion.mjs: they complete and write a row for every measurement. They fail if a client's message is refused.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import { after, before, test } from 'node:test';
import { fileURLToPath } from 'node:url';
import { others, plain, secure } from './serve/hostile.mjs';

const here = path.dirname(fileURLToPath(import.meta.url));
let folder;

before(() => { folder = fs.mkdtempSync(path.join(os.tmpdir(), 'splat-serve-test-')); });
after(() => fs.rmSync(folder, { recursive: true }));

const out = () => path.join(folder, 'serve.csv');

const run = (program, ...args) =>
  spawnSync(process.execPath, [path.join(here, program), '--bin', process.env.SPLATD_BIN_DIR, '--out', out(), ...args], { encoding: 'utf8' });
const serve = (...args) => run('serve.mjs', '--seconds', '0.1', '--rounds', '1', '--volume', 'demo:engine?size=16', '--large', 'demo:phantom?size=16',
  '--large', 'demo:vessels?size=16', ...args);

/** The rows that a run has written. */
function rowsOf({ status, stderr }) {
  assert.equal(status, 0, stderr);
  const [head, ...rows] = fs.readFileSync(out(), 'utf8').trimEnd().split('\n').map((line) => line.split(/,(?=(?:[^"]*"[^"]*")*[^"]*$)/));
  return rows.map((row) => Object.fromEntries(head.map((key, i) => [key, row[i].replaceAll('"', '')])));
}

const table = (...args) => rowsOf(serve(...args));

test('users and memory are measured', () => {
  const rows = table('--only', 'overhead,viewers,memory');
  assert.deepEqual(rows.map(({ part, what }) => [part, part === 'memory' && what]), [['overhead', false], ['overhead', false], ['viewers', false],
    ['viewers', false], ['viewers', false], ['memory', 'a viewer, jpeg'], ['memory', 'a session, jpeg'], ['memory', 'a session, vp8'], ['memory', 'a session, vp9']]);
  assert.deepEqual(rows.slice(0, 2).map(({ px }) => px), ['512', '1024']);
  for (const { kib_each: each } of rows.slice(-4)) assert.notEqual(each, '');
});

test('a drag is measured until its final frame', () => {
  const rows = table('--only', 'drag', '--seconds', '1'); // in less time, a busy machine may show no frame
  assert.deepEqual(rows.map(({ part, px }) => [part, px]), [['drag', '512']]);
  assert.ok(Number(rows[0].fps_mean) > 0 && Number(rows[0].final_ms) > 0);
});

test('active sessions are measured', () => {
  const rows = table('--only', 'awake');
  assert.deepEqual(rows.map(({ clients }) => clients), ['1', '1000']);
  for (const { cpu_rest_percent: rest } of rows) assert.notEqual(rest, '');
});

test('sessions are added until there are too many', () => {
  const rows = table('--only', 'sessions');
  assert.deepEqual(rows.slice(0, 3).map(({ clients, what }) => [clients, what.startsWith('full')]), [['1', false], ['8', false], ['16', false]]);
  const whole = rows.slice(3);
  assert.ok(whole.every(({ what }) => what.startsWith('full')));
  const fits = whole.filter(({ fps_min: fps }) => Number(fps) >= 10).map(({ clients }) => Number(clients));
  const [most, least] = [Math.max(0, ...fits), Math.min(65, ...whole.map(({ clients }) => Number(clients)).filter((n) => !fits.includes(n)))];
  assert.equal(least - most, 1, `${most} fit, ${least} do not`);
});

test('every client behaviour has a row', () => {
  const rows = table('--only', 'hostile');
  assert.deepEqual(rows.map(({ what }) => what), Object.keys({ ...plain, ...others, ...secure }));
  for (const { part, what } of rows) assert.equal(part, what in others ? 'beside' : 'hostile');
});

test('unknown parts are refused, and soak cannot be combined with other parts', () => {
  assert.match(serve('--only', 'idle,tea').stderr, /"tea" is not one of overhead, /);
  assert.match(serve('--only', 'soak,idle').stderr, /soak is measured alone/);
});

test('what a client of the stream and the page show in motion is measured', () => {
  const rows = rowsOf(run('motion.mjs', '--volumes', 'demo:engine?size=32', '--moves', 'turn', '--px', '256', '--seconds', '0.5', '--rtt', '20', '--mbit', '50'));
  assert.deepEqual(rows.map(({ client, move }) => `${client} ${move}`), ['stream turn', 'page turn']);
  for (const row of rows) {
    assert.equal(row.canvas, '256x256');
    const keys = ['seen_db', 'seen_object_db', ...(row.client === 'stream' ? ['frame_db'] : [])]; // the page may get video alone
    for (const key of keys) assert.ok(Number(row[key]) > 10, `${row.client} ${row.move}: ${key} ${row[key]}`);
    assert.ok(Number(row.p50_ms) >= 20, 'an image cannot come sooner than the network allows');
  }
});
