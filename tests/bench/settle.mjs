#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Measures how the image gets sharp after the hand stops. The hand turns, sways or zooms for a second, with 60 updates per second, and stops. Then
// the image on the screen is compared with the snapshot of the last view, at each tick of the display, over the pixels that the object covers.
// Results are medians over several stops, in dB.
//
//   node tests/bench/settle.mjs [--bin DIR] [--volumes LIST] [--clients stream,page] [--moves turn,sway,zoom] [--px N] [--stops N] [--rtt MS]
//     [--mbit N] [--images DIR] [--out FILE.csv]
//
// The client "stream" shows the newest image, enlarged; "page" is splatd's page in Chromium, with the frames that fade out. --images: a folder
// that gets what the page shows after the last stop.
import fs from 'node:fs';
import path from 'node:path';
import { parseArgs } from 'node:util';
import { launch, openPage, WHOLE } from '../web/support/browser.mjs';
import { Judge } from './motion/judge.mjs';
import { recordPageStops, recordStreamStops } from './motion/record.mjs';
import { LOOK_MS, MOVE_S, SETTLE_COLUMNS, settleRow } from './motion/settle.mjs';
import { Daemon } from './serve/peers.mjs';
import { startProxy } from './serve/proxy.mjs';

const { values: options } = parseArgs({
  options: {
    bin: { type: 'string', default: 'build/release/bin' },
    volumes: { type: 'string', default: 'demo:engine' },
    clients: { type: 'string', default: 'stream,page' },
    moves: { type: 'string', default: 'turn,sway,zoom' },
    px: { type: 'string', default: '1024' },
    stops: { type: 'string', default: '7' },
    rtt: { type: 'string', default: '0' },
    mbit: { type: 'string', default: '50' },
    images: { type: 'string' },
    out: { type: 'string' },
    help: { type: 'boolean' },
  },
});
const [px, stops, rttMs, mbit] = ['px', 'stops', 'rtt', 'mbit'].map((name) => Number(options[name]));
const rows = [];

async function measure(judge, daemon, client, browser, { move, volume }) {
  const proxy = await startProxy(daemon.port, { rttMs, mbit });
  const settings = { move, px, stops, moveSeconds: MOVE_S, lookMs: LOOK_MS };
  const far = Object.assign(Object.create(Object.getPrototypeOf(daemon)), daemon, { port: proxy.port });
  const [view] = daemon.views;
  let record;
  if (client === 'stream') {
    record = { ...await recordStreamStops(far, view, settings), size: [px, px] };
  } else {
    const { context, page } = await openPage(browser);
    record = await recordPageStops(page, `http://127.0.0.1:${proxy.port}/?token=${daemon.token}`, settings);
    await context.close();
  }
  proxy.close();
  for (const { at, image } of options.images && client === 'page' ? record.stops.at(-1).looks : [])
    fs.writeFileSync(path.join(options.images, `${volume}-${move}-${String(Math.round(at)).padStart(4, '0')}.png`), image.bytes);
  await judge.begin(view, record.size);
  const row = { client, move, volume, px, canvas: record.size.join('x'), rtt_ms: rttMs, mbit, ...await settleRow(judge, record) };
  rows.push(row);
  process.stdout.write(`${SETTLE_COLUMNS.map((name) => `${name} ${row[name]}`).join('  ')}\n`);
}

async function main() {
  if (options.images) fs.mkdirSync(options.images, { recursive: true });
  const browser = await launch(WHOLE);
  const { context } = await openPage(browser);
  for (const volume of options.volumes.split(',')) {
    const daemon = await Daemon.start(options.bin, 'auto', [volume]);
    const judge = await Judge.open(context, daemon);
    for (const client of options.clients.split(','))
      for (const move of options.moves.split(',')) await measure(judge, daemon, client, browser, { move, volume: path.basename(volume) });
    await daemon.stop();
  }
  await browser.close();
  if (options.out) fs.writeFileSync(options.out, `${[SETTLE_COLUMNS, ...rows.map((row) => SETTLE_COLUMNS.map((name) => row[name]))].map((line) => line.join(',')).join('\n')}\n`);
}

if (options.help) {
  const [, , ...head] = fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n', 11);
  process.stdout.write(`${head.map((line) => line.slice(3)).join('\n')}\n`);
} else {
  await main();
}
