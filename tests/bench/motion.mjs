#!/usr/bin/env node
// SPDX-License-Identifier: Apache-2.0
// Measures what a user sees while a hand turns, zooms or pans, with 60 updates per second: at ticks of the display, the image on the
// screen against the snapshot of the view that was asked for at that moment ("seen"), and the newest frame against its own snapshot ("frame").
// Both in dB, over the whole image and over the pixels that the object covers.
//
//   node tests/bench/motion.mjs [--bin DIR] [--volumes LIST] [--clients stream,page] [--moves turn,sway,zoom,pan] [--px LIST] [--seconds N]
//     [--rtt LIST] [--mbit LIST] [--looks N] [--images DIR] [--out FILE.csv]
//
// The client "stream" shows the newest image, enlarged; "page" is splatd's page in Chromium, whose canvas is read back. --looks: per
// second. --images: a folder that gets each image that was seen.
import fs from 'node:fs';
import path from 'node:path';
import { parseArgs } from 'node:util';
import { launch, openPage, WHOLE } from '../web/support/browser.mjs';
import { Judge, Score } from './motion/judge.mjs';
import { recordPage, recordStream } from './motion/record.mjs';
import { Daemon, median, round, share } from './serve/peers.mjs';
import { startProxy } from './serve/proxy.mjs';

const COLUMNS = ['client', 'move', 'volume', 'px', 'canvas', 'rtt_ms', 'mbit', 'seen_db', 'seen_object_db', 'frame_db', 'frame_object_db', 'width_p50', 'width_min',
  'fps', 'changes_fps', 'p50_ms', 'p95_ms', 'kbytes_frame', 'mbit_used', 'video_percent'];
const { values: options } = parseArgs({
  options: {
    bin: { type: 'string', default: 'build/release/bin' },
    volumes: { type: 'string', default: 'demo:engine' },
    clients: { type: 'string', default: 'stream,page' },
    moves: { type: 'string', default: 'turn,zoom,pan' },
    px: { type: 'string', default: '512,1024' },
    seconds: { type: 'string', default: '2.5' },
    rtt: { type: 'string' },
    mbit: { type: 'string' },
    looks: { type: 'string', default: '8' },
    images: { type: 'string' },
    out: { type: 'string' },
    help: { type: 'boolean' },
  },
});
const list = (name) => options[name].split(',');
const numbers = (name) => list(name).map(Number);
const rows = [];

/** The networks of a run, [round trip in ms, Mbit/s]: all of the lists; by default the whole grid for turns of 1024 px, and two for the rest. */
function networksOf(move, px) {
  const [trips, rates] = [options.rtt ?? '0,50,100,200', options.mbit ?? '50,10,2'].map((text) => text.split(',').map(Number));
  if (options.rtt || options.mbit || (move === 'turn' && px === 1024)) return rates.flatMap((mbit) => trips.map((rttMs) => [rttMs, mbit]));
  return [[0, 50], [100, 10]];
}

/** Scores of a record: {seen, frame}. */
async function score(judge, { looks, frames }, name) {
  const [seen, frame] = [new Score(), new Score()];
  const known = new Map(); // sums of frames that several looks have
  for (const [i, look] of looks.entries()) {
    seen.add(await judge.compare(look.image, look.wanted));
    if (options.images) fs.writeFileSync(path.join(options.images, `${name}-${String(i).padStart(2, '0')}.${look.image.type.slice(6)}`), look.image.bytes);
    const own = frames[look.frame];
    if (!own?.bytes || !look.of) continue;
    if (!known.has(own)) known.set(own, await judge.compare({ bytes: own.bytes, type: own.type }, look.of));
    frame.add(known.get(own));
  }
  return { seen, frame };
}

async function measure(judge, daemon, client, browser, { move, px, rttMs, mbit, volume }) {
  const proxy = await startProxy(daemon.port, { rttMs, mbit });
  const settings = { move, px, seconds: Number(options.seconds), looksPerSecond: Number(options.looks) };
  const far = Object.assign(Object.create(Object.getPrototypeOf(daemon)), daemon, { port: proxy.port });
  const [view] = daemon.views;
  let record;
  if (client === 'stream') {
    record = { ...await recordStream(far, view, settings), size: [px, px] };
  } else {
    const { context, page } = await openPage(browser);
    record = await recordPage(page, `http://127.0.0.1:${proxy.port}/?token=${daemon.token}`, settings);
    await context.close();
  }
  proxy.close();
  await judge.begin(view, record.size);
  const { seen, frame } = await score(judge, record, [client, volume, move, px, rttMs, mbit].join('-'));
  const { frames, hands, seconds, changes } = record;
  const widths = frames.map(({ width }) => width);
  const bytes = frames.reduce((sum, { length }) => sum + length, 0);
  const row = { client, move, volume, px, canvas: record.size.join('x'), rtt_ms: rttMs, mbit, seen_db: round(seen.whole, 2), seen_object_db: round(seen.object, 2),
    frame_db: round(frame.whole, 2), frame_object_db: round(frame.object, 2), width_p50: median(widths), width_min: Math.min(...widths),
    fps: round(frames.length / seconds), changes_fps: round(changes / seconds), p50_ms: round(share(hands, 0.5)), p95_ms: round(share(hands, 0.95)),
    kbytes_frame: round(bytes / frames.length / 1000), mbit_used: round(bytes * 8 / seconds / 1e6, 2),
    video_percent: round(100 * frames.filter(({ type }) => !type).length / frames.length, 0) };
  rows.push(row);
  process.stdout.write(`${COLUMNS.map((name) => `${name} ${row[name]}`).join('  ')}\n`);
}

async function main() {
  if (options.images) fs.mkdirSync(options.images, { recursive: true });
  const browser = await launch(WHOLE);
  const { context } = await openPage(browser);
  for (const volume of list('volumes')) {
    const daemon = await Daemon.start(options.bin, 'auto', [volume]);
    const judge = await Judge.open(context, daemon);
    for (const client of list('clients'))
      for (const move of list('moves'))
        for (const px of numbers('px'))
          for (const [rttMs, mbit] of networksOf(move, px)) await measure(judge, daemon, client, browser, { move, px, rttMs, mbit, volume: path.basename(volume) });
    await daemon.stop();
  }
  await browser.close();
  if (options.out) fs.writeFileSync(options.out, `${[COLUMNS, ...rows.map((row) => COLUMNS.map((name) => row[name]))].map((line) => line.join(',')).join('\n')}\n`);
}

if (options.help) {
  const [, , ...head] = fs.readFileSync(new URL(import.meta.url), 'utf8').split('\n', 11);
  process.stdout.write(`${head.map((line) => line.slice(3)).join('\n')}\n`);
} else {
  await main();
}
