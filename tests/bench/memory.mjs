#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// The memory of frames: resident memory of the daemon after each of many heavy images, of a heavy session, and at rest, against --render-bytes.
//
//   node tests/bench/memory.mjs [--bin DIR] [--sides LIST] [--images N] [--render-bytes SIZE] [--out FILE.csv]
//
// An image has the volume and seven surfaces. Each side, in px, has a daemon of its own. `counted_mib` is what the daemon counts as memory of frames then
// (splatd_memory_bytes without voxels); `peak_mib` is the largest resident memory so far.
import { once } from 'node:events';
import fs from 'node:fs';
import http from 'node:http';
import { parseArgs } from 'node:util';

const COLUMNS = ['what', 'side', 'layers', 'render_bytes_mib', 'status', 'ms', 'rss_mib', 'peak_mib', 'counted_mib'];
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string' },
    sides: { type: 'string', default: '1024' },
    images: { type: 'string', default: '20' },
    'render-bytes': { type: 'string', default: '0' },
    out: { type: 'string' },
  },
});
if (options.bin) process.env.SPLATD_BIN_DIR = options.bin; // the harness looks for the programs there
const { Daemon, FINAL } = await import('../integration/harness.mjs');
const MIB = 2 ** 20;
const layers = [{ type: 'volume' }, ...[30, 60, 90, 120, 150, 180, 210].map((value) => ({ type: 'surface', value, opacity: 0.4 }))];
const rows = [];
const pause = () => new Promise((resolve) => { setTimeout(resolve, 100); });

/** Resolves to the status of one image. fetch() would give up after five minutes. */
async function render(daemon, view) {
  const request = http.request(`${daemon.base}/api/v1/render`, { method: 'POST', headers: { Authorization: `Bearer ${daemon.token}`, 'Content-Type': 'application/json' } });
  request.end(JSON.stringify(view));
  const [answer] = await once(request, 'response');
  answer.resume();
  await once(answer, 'end');
  return answer.statusCode;
}

async function metrics(daemon) {
  const text = await (await daemon.fetch('/metrics')).text();
  const kinds = [...text.matchAll(/^splatd_memory_bytes\{kind="(\w+)"\} (\d+)$/gm)].filter(([, kind]) => kind !== 'voxels');
  return { counted: kinds.reduce((sum, [, , bytes]) => sum + Number(bytes), 0), limit: Number(/^splatd_frame_memory_budget_bytes (\d+)/m.exec(text)[1]) };
}

async function measure(side) {
  const daemon = await Daemon.start(['--volume', 'demo:engine?size=64', '--render-bytes', options['render-bytes']], { backend: 'cpu' });
  await daemon.loaded('engine');
  const mib = (name) => Math.round(Number(new RegExp(`${name}:\\s+(\\d+) kB`).exec(fs.readFileSync(`/proc/${daemon.child.pid}/status`, 'utf8'))[1]) / 102.4) / 10;
  const note = async (what, status, ms) => {
    const { counted, limit } = await metrics(daemon);
    const row = { what, side, layers: layers.length, render_bytes_mib: Math.round(limit / MIB), status, ms: Math.round(ms), rss_mib: mib('VmRSS'), peak_mib: mib('VmHWM'),
      counted_mib: Math.round(counted / MIB * 10) / 10 };
    rows.push(row);
    process.stdout.write(`memory: ${Object.entries(row).map(([key, value]) => `${key} ${value}`).join('  ')}\n`);
  };
  /** Waits until the daemon has given back the memory of frames. */
  const rest = async (what) => {
    const begin = performance.now();
    while ((await metrics(daemon)).counted > 0) await pause();
    await note(what, '', performance.now() - begin);
  };

  await note('start', '', 0);
  for (let i = 1; i <= Number(options.images); i += 1) {
    const begin = performance.now();
    const status = await render(daemon, { size: [side, side], layers, camera: { fov_y: 20 + i } });
    await note(`image ${i}`, status, performance.now() - begin);
  }
  await rest('rest after the images');
  const stream = await daemon.stream({ session: await daemon.session({ size: [side, side], layers }) });
  const begin = performance.now();
  while (!stream.closed && !stream.frames.some(({ flags }) => flags & FINAL)) await pause();
  await note('session', '', performance.now() - begin);
  await stream.end();
  await rest('rest after the session');
  await daemon.stop();
}

for (const side of options.sides.split(',')) await measure(Number(side));
if (options.out) fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((column) => row[column]))].map((line) => line.join(',')).join('\n')}\n`);
process.exit(0);
