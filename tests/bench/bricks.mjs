#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Volumes that are larger than memory: conversion to a brick file, first and complete picture, bytes read and peak memory, against the size of the volume.
//
//   node tests/bench/bricks.mjs [--bin DIR] [--sides LIST] [--memory BYTES] [--folder DIR] [--keep] [--out FILE.csv]
//
// The volumes are winding vessels in empty space, uint8: a file with holes, so that 4096³ (64 GiB) takes 10 GB of disk while it is converted, and 0.1 GB after
// that. --folder (a new one below $TMPDIR or /tmp) has the files; they are removed at the end, except brick files with --keep. A brick file that is there
// is not made again. `read_bytes` and `peak_bytes` are values of the daemon's process; times begin with the request that opens the volume, or the stream.
import { spawn } from 'node:child_process';
import fs from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { parseArgs } from 'node:util';
import { writeVessels } from '../support/sparse.mjs';

const COLUMNS = ['side', 'memory_bytes', 'matter_bytes', 'file_bytes', 'convert_ms', 'convert_cpu_ms', 'convert_peak_bytes', 'view', 'width', 'height', 'load_ms', 'first_ms',
  'complete_ms', 'is_complete', 'level', 'asked', 'bricks', 'read_bytes', 'peak_bytes'];
const VESSELS = 24;
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string' },
    sides: { type: 'string', default: '512,1024,2048,4096' },
    memory: { type: 'string', default: String(512 << 20) },
    folder: { type: 'string' },
    keep: { type: 'boolean' },
    out: { type: 'string' },
  },
});
if (options.bin) process.env.SPLATD_BIN_DIR = options.bin; // the harness looks for the programs there
const { BIN, Daemon, FINAL, INCOMPLETE } = await import('../integration/harness.mjs');
const rows = [];

/** A number from a file of /proc, or NaN when the process has ended. */
function proc(pid, file, pattern) {
  try {
    return Number(pattern.exec(fs.readFileSync(`/proc/${pid}/${file}`, 'utf8'))[1]);
  } catch {
    return NaN;
  }
}
const peakBytes = (pid) => proc(pid, 'status', /^VmHWM:\s+(\d+)/m) * 1024;
const bytesRead = (pid) => proc(pid, 'io', /^rchar:\s+(\d+)/m);

/** CPU time of a process and of its children that have ended [ms]. */
function cpuMs(pid) {
  const [, ...ticks] = /^\d+ \(.*\) (?:\S+ ){11}(\d+) (\d+) (\d+) (\d+)/.exec(fs.readFileSync(`/proc/${pid}/stat`, 'utf8'));
  return 10 * ticks.reduce((sum, n) => sum + Number(n), 0);
}

/** Converts a file and looks at splatctl every 50 ms. The peak is the memory of splatctl: the samples, which the importer maps, are in the page cache. */
async function convert(source, out) {
  const start = performance.now();
  const child = spawn(path.join(BIN, 'splatctl'), ['convert', '--timeout', '3600', source, out], { stdio: ['ignore', 'ignore', 'inherit'] });
  const seen = {};
  const timer = setInterval(() => {
    try {
      Object.assign(seen, { convert_cpu_ms: cpuMs(child.pid), convert_peak_bytes: peakBytes(child.pid) || seen.convert_peak_bytes });
    } catch { /* it has just ended */ }
  }, 50);
  const status = await new Promise((resolve) => { child.on('close', resolve); });
  clearInterval(timer);
  if (status !== 0) throw new Error(`splatctl convert: exit status ${status}`);
  return { ...seen, convert_ms: performance.now() - start };
}

async function makeBricks(folder, side) {
  const [source, bricks] = ['nrrd', 'bricks'].map((suffix) => path.join(folder, `vessels-${side}.${suffix}`));
  const made = {};
  if (!fs.existsSync(bricks)) {
    try {
      made.matter_bytes = writeVessels(source, side, VESSELS).bytes;
      Object.assign(made, await convert(source, bricks));
    } finally {
      fs.rmSync(source, { force: true });
    }
  }
  return { ...made, file_bytes: fs.statSync(bricks).size };
}

/** Opens a stream of a new session: the times of the first and the final frame, and the bytes read for them. */
async function watch(daemon, view) {
  const { pid } = daemon.child;
  const before = bytesRead(pid);
  const session = await daemon.session(view);
  const start = performance.now();
  const stream = await daemon.stream({ session });
  await stream.until(() => stream.frames[0], 'the first frame');
  const first = performance.now() - start;
  const { flags } = await stream.until(() => stream.frames.find((frame) => frame.flags & FINAL), 'the final frame');
  const complete = performance.now() - start;
  const isComplete = !(flags & INCOMPLETE);
  // A smaller frame before the final frame may also be complete.
  const tells = ({ method, params: { width, bricks: of } }) => method === 'stream.stats' && width === view.size[0] && of?.complete === isComplete && (isComplete || (of.wanted > 0 && of.resident === of.wanted));
  const { bricks } = (await stream.until(() => stream.notes.findLast(tells), 'the numbers of the final frame')).params;
  await stream.end();
  return { first_ms: first, complete_ms: complete, is_complete: Number(isComplete), level: bricks.level, asked: bricks.asked, bricks: bricks.resident,
    read_bytes: bytesRead(pid) - before, peak_bytes: peakBytes(pid) };
}

async function measure(folder, side) {
  const made = await makeBricks(folder, side);
  const daemon = await Daemon.start(['--data', folder, '--memory', options.memory, '--frame-size', '1920x1080'], { backend: 'cpu' });
  const start = performance.now();
  await daemon.post('/api/v1/volumes', { path: `vessels-${side}.bricks`, id: 'v' });
  await daemon.loaded('v');
  const load = performance.now() - start;
  const { json: view } = await daemon.json('/api/v1/volumes/v/view');
  const near = structuredClone(view.camera);
  near.position = near.position.map((p, i) => near.target[i] + (p - near.target[i]) / 6);
  for (const [what, size, camera] of [['default', [512, 512], view.camera], ['default', [1920, 1080], view.camera], ['near', [1920, 1080], near]]) {
    const got = await watch(daemon, { volume: 'v', size, camera });
    const row = { side, memory_bytes: options.memory, ...made, view: what, width: size[0], height: size[1], load_ms: load, ...got };
    rows.push(row);
    process.stdout.write(`${COLUMNS.filter((name) => row[name] !== undefined).map((name) => `${name} ${Number.isFinite(row[name]) ? Math.round(row[name]) : row[name]}`).join('  ')}\n`);
  }
  await daemon.stop();
  if (!options.keep) fs.rmSync(path.join(folder, `vessels-${side}.bricks`));
}

/** Returns the disk space that a volume needs while it is made: the rows with matter, three times, and the brick file. */
const diskBytes = (side) => 0.17 * side ** 3;

const folder = options.folder ?? fs.mkdtempSync(path.join(tmpdir(), 'splat-bricks-'));
try {
  for (const side of options.sides.split(',').map(Number)) {
    const { bavail, bsize } = fs.statfsSync(folder);
    if (bavail * bsize > diskBytes(side)) await measure(folder, side);
    else process.stderr.write(`skipped: ${side}³; it needs ${(diskBytes(side) / 2 ** 30).toFixed(1)} GiB in ${folder} (TMPDIR chooses another folder)\n`);
  }
} finally {
  if (!options.folder) fs.rmSync(folder, { recursive: true });
}
const cell = (value) => (typeof value === 'number' ? Math.round(value) : value ?? '');
if (options.out) fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((name) => cell(row[name])))].map((line) => line.join(',')).join('\n')}\n`);
