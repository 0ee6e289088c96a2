#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Measures hand to picture over slow and distant networks: one client sends sixty changes per second through a proxy that delays,
// limits the rate, and stalls (serve/proxy.mjs).
//
//   node tests/bench/network.mjs [--bin DIR] [--seconds N] [--volume V] [--px N] [--rtt LIST] [--mbit LIST] [--stalls LIST]
//     [--formats LIST] [--out FILE.csv]
//
// `allowed_ms` is the goal for the median latency: the round trip, two frame times, and the time to send one frame.
import fs from 'node:fs';
import { parseArgs } from 'node:util';
import { Client, Daemon, pause, round, watch } from './serve/peers.mjs';
import { startProxy } from './serve/proxy.mjs';

const COLUMNS = ['rtt_ms', 'mbit', 'stalls_percent', 'format', 'volume', 'px', 'side', 'fps_mean', 'p50_ms', 'p95_ms', 'allowed_ms', 'work_ms',
  'kbytes_frame', 'mbit_used'];
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string', default: 'build/release/bin' },
    seconds: { type: 'string', default: '5' },
    volume: { type: 'string', default: 'demo:engine?size=128' },
    px: { type: 'string', default: '512' },
    rtt: { type: 'string', default: '0,20,50,100,200' },
    mbit: { type: 'string', default: '2,10,50' },
    stalls: { type: 'string', default: '0,1' },
    formats: { type: 'string', default: 'jpeg,auto' },
    out: { type: 'string' },
    help: { type: 'boolean' },
  },
});
const rows = [];
const px = Number(options.px);
const list = (text) => text.split(',');

async function measure(daemon, rttMs, mbit, percent, format) {
  const proxy = await startProxy(daemon.port, { rttMs, mbit, stalls: percent / 100 });
  const client = await Client.open({ ...daemon, port: proxy.port, secure: false, views: daemon.views }, await daemon.session(px));
  client.configure({ max_fps: 60, format: format === 'auto' ? ['jpeg', 'vp8'] : format });
  await pause(1000); // until the view rests: a user does not begin at once
  client.drive(1000 / 60);
  const seen = await watch(daemon, [client], Number(options.seconds), 2);
  client.end();
  proxy.close();
  const frameMs = 1000 / seen.fps_mean;
  const row = { rtt_ms: rttMs, mbit, stalls_percent: percent, format, volume: options.volume, px, ...seen,
    allowed_ms: round(rttMs + 2 * frameMs + seen.kbytes_frame * 8 / mbit), mbit_used: round(seen.kbytes_frame * seen.fps_mean * 8 / 1000, 2) };
  rows.push(row);
  process.stdout.write(`${COLUMNS.map((name) => `${name} ${row[name]}`).join('  ')}\n`);
}

if (options.help) {
  const [, , ...head] = fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n', 9);
  process.stdout.write(`${head.map((line) => line.slice(3)).join('\n')}\n`);
} else {
  const daemon = await Daemon.start(options.bin, 'auto', [options.volume]);
  for (const format of list(options.formats))
    for (const percent of list(options.stalls).map(Number))
      for (const mbit of list(options.mbit).map(Number))
        for (const rttMs of list(options.rtt).map(Number)) await measure(daemon, rttMs, mbit, percent, format);
  await daemon.stop();
  if (options.out) fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((name) => row[name]))].map((line) => line.join(',')).join('\n')}\n`);
}
