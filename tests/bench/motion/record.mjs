// SPDX-License-Identifier: Apache-2.0
// Records what a client shows while a hand moves. A record is
//   {frames: [{at, seq, width, bytes, type}], looks: [{wanted (a camera), frame (an index, or -1), image ({bytes, type, map}), of (camera of the frame)}], hands (ms
//    from a change to its image), …}; times in ms.
// A look is one tick of the display: the image on the screen, and the camera that the hand asked for at that moment.
import { Client, pause } from '../serve/peers.mjs';
import { resize, until } from '../../web/support/browser.mjs';
import { isActive, MOVES, moveInPage, TICK_MS } from './hand.mjs';

const FINAL = 2; // flag in the frame header
export const TYPES = { 1: 'image/jpeg', 2: 'image/png', 3: 'image/webp' };
export const WARM = 1; // seconds of motion before the first look

/** A client of the stream that shows the newest image, enlarged, and nothing else. settings: of stream.configure. */
export async function recordStream(daemon, view, { move, px, seconds, looksPerSecond, settings }) {
  const client = await Client.open(daemon, await daemon.session(px, view));
  client.configure({ max_fps: 60, format: 'jpeg', ...settings });
  await pause(1000); // until the view rests: a user does not begin at once
  const [frames, looks, cameras] = [[], [], [view.camera]];
  client.onFrame = (seq, data) => {
    const width = data.readUInt16LE(16);
    frames.push({ at: performance.now(), seq, width, length: data.length, bytes: data.subarray(data.length - data.readUInt32LE(28)), type: TYPES[data[4]] });
  };
  const first = Math.round(1000 * WARM / TICK_MS);
  const last = first + Math.round(1000 * seconds / TICK_MS);
  const step = Math.round(1000 / looksPerSecond / TICK_MS);
  await new Promise((resolve) => {
    let tick = 0;
    client.drive(TICK_MS, () => {
      tick += 1;
      if (tick === first) client.reset();
      if (tick > last) {
        clearTimeout(client.timer);
        resolve();
        return;
      }
      if (isActive(move, tick)) {
        cameras.push(MOVES[move](view.camera, tick * TICK_MS / 1000));
        client.update({ camera: cameras.at(-1) });
      }
      if (tick >= first && (tick - first) % step === 0 && frames.length) looks.push({ wanted: cameras.at(-1), frame: frames.length - 1 });
    });
  });
  const base = looks[0]?.frame ?? 0;
  const seen = frames.slice(base);
  for (const look of looks) Object.assign(look, { image: frames[look.frame], frame: look.frame - base, of: cameras[frames[look.frame].seq] });
  const result = { frames: seen, looks, hands: client.latencies, seconds, changes: seen.length };
  client.end();
  return result;
}

/** The same client, whose hand moves for a while and stops, `stops` times. Gives {stops: [{looks: [{at (ms after the stop), image}], wanted, frames, first, final}]}; see settle.mjs. */
export async function recordStreamStops(daemon, view, { move, px, stops, moveSeconds, lookMs, settings }) {
  const client = await Client.open(daemon, await daemon.session(px, view));
  client.configure({ max_fps: 60, format: 'jpeg', ...settings });
  await pause(1000);
  let [frames, camera, time, way] = [[], view.camera, 0, 1];
  client.onFrame = (seq, data) => {
    frames.push({ at: performance.now(), seq, isFinal: (data[5] & FINAL) !== 0, bytes: data.subarray(data.length - data.readUInt32LE(28)), type: TYPES[data[4]] });
  };
  const record = { stops: [] };
  for (let i = 0; i < stops; i += 1) {
    const ticks = Math.round(1000 * moveSeconds / TICK_MS);
    await new Promise((resolve) => {
      let tick = 0;
      client.drive(TICK_MS, () => {
        tick += 1;
        time += way * TICK_MS / 1000;
        camera = MOVES[move](view.camera, time);
        client.update({ camera });
        if (tick < ticks) return;
        clearTimeout(client.timer);
        resolve();
      });
    });
    const stopped = performance.now();
    await pause(lookMs + 500);
    const looks = [];
    for (let at = 0; at < lookMs; at += TICK_MS) looks.push({ at, image: frames.findLast((frame) => frame.at <= stopped + at) });
    record.stops.push({ looks, wanted: camera, ...arrivals(frames, client.seq, stopped) });
    if (move === 'zoom') way = -way;
    frames = frames.slice(-1);
  }
  client.end();
  return record;
}

/** How many frames came after the stop, and when the first and the last one of the newest view did (ms). */
function arrivals(frames, seq, stopped) {
  const after = frames.filter(({ at }) => at > stopped);
  const own = after.filter((frame) => frame.seq === seq);
  return { frames: after.length, first: own[0]?.at - stopped, final: own.find(({ isFinal }) => isFinal)?.at - stopped };
}

/** Runs in the page before its scripts: records the images that arrive and the cameras that are sent. */
function listen() {
  const Plain = window.WebSocket;
  const record = { frames: [], cameras: [[0, null]], isOn: false };
  window.motion = record;
  /** Looks after each animation frame, until motion.isOn is false. A task after the frame sees what it has drawn. */
  window.eachFrame = (look) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = look;
    const next = () => {
      if (!record.isOn) return;
      port2.postMessage(0);
      requestAnimationFrame(next);
    };
    requestAnimationFrame(next);
  };
  window.WebSocket = class extends Plain {
    constructor(...rest) {
      super(...rest);
      this.addEventListener('message', ({ data }) => {
        if (!record.isOn || typeof data === 'string') return;
        const view = new DataView(data);
        const isFinal = (view.getUint8(5) & 2) !== 0;
        const kept = view.getUint8(4) <= 3 ? data.slice(data.byteLength - view.getUint32(28, true)) : null; // the daemon may send video
        const number = (at) => view.getFloat64(at, true);
        const vector = (at) => [number(at), number(at + 8), number(at + 16)];
        const camera = view.getUint8(5) & 16 ? { position: vector(56), target: vector(80), up: vector(104) } : null; // the daemon may be ahead of the view
        record.frames.push({ at: performance.now(), length: data.byteLength, camera, seq: view.getUint32(12, true), width: view.getUint16(16, true), codec: view.getUint8(4), isFinal, data: kept });
      });
    }

    send(text) {
      if (typeof text === 'string' && text.includes('"view.update"')) {
        const { params } = JSON.parse(text);
        if (params.patch.camera) record.cameras.push([params.seq, params.patch.camera, performance.now()]);
      }
      super.send(text);
    }
  };
}

/** Runs in the page: looks at its canvas at every `every`-th animation frame, until motion.isOn is false. */
function watch(every) {
  const { motion } = window;
  Object.assign(motion, { isOn: true, looks: [], hands: [], shown: '', changes: 0, ticks: 0, begin: performance.now() });
  const layer = document.getElementById('warp');
  const look = async () => {
    if (!motion.isOn) return;
    const { count, camera, latencyMs, warps } = window.splatd;
    const isByDepth = layer.dataset.kind === 'depth';
    const sheet = layer.hidden || isByDepth ? null : layer.firstElementChild;
    const shown = `${count} ${layer.hidden ? '' : isByDepth ? warps : sheet.style.transform}`;
    if (shown !== motion.shown) motion.changes += 1;
    if (!motion.shown.startsWith(`${count} `)) motion.hands.push(latencyMs);
    motion.shown = shown;
    motion.ticks += 1;
    if (motion.ticks % every !== 0) return;
    const canvas = layer.hidden ? document.getElementById('screen') : isByDepth ? layer.lastElementChild : sheet.querySelector('canvas');
    const matrix = sheet ? new DOMMatrix(sheet.style.transform) : null;
    const { width, height } = canvas;
    const one = { wanted: camera, frame: motion.frames.length - 1, matrix: matrix && [...matrix.toFloat64Array()], scale: width / canvas.clientWidth };
    motion.looks.push(one);
    one.image = await createImageBitmap(canvas, 0, 0, width, height);
  };
  window.eachFrame(look);
}

/** Runs in the page: the record, with images as base64. */
async function tell() {
  const { motion } = window;
  motion.isOn = false;
  const seconds = (performance.now() - motion.begin) / 1000;
  const textOf = async (blob) => {
    const bytes = new Uint8Array(await blob.arrayBuffer());
    let text = '';
    for (let at = 0; at < bytes.length; at += 32768) text += String.fromCharCode(...bytes.subarray(at, at + 32768));
    return btoa(text);
  };
  for (const look of motion.looks) {
    const canvas = new OffscreenCanvas(look.image.width, look.image.height);
    canvas.getContext('2d').drawImage(look.image, 0, 0);
    look.image = await textOf(await canvas.convertToBlob());
  }
  for (const frame of motion.frames) frame.data = frame.data && await textOf(new Blob([frame.data]));
  const { frames, looks, cameras, hands, changes, ticks } = motion;
  return { frames, looks, cameras, hands, changes, ticks, seconds };
}

/** The homography of a CSS matrix between canvases whose px are `scale` per CSS px. */
const homographyOf = (m, scale) => [[m[0], m[4], m[12] * scale], [m[1], m[5], m[13] * scale], [m[3] / scale, m[7] / scale, m[15]]];

/** Opens the page of splatd with a canvas of px x px, and waits until it rests. Gives {box (of the canvas), rest (waits again)}. */
async function openAtRest(page, url, px) {
  await page.addInitScript(listen);
  await page.setViewportSize({ width: px, height: px });
  await page.goto(url);
  const rest = () => until(page, 'a snapshot', (s) => s.isFinal && s.isIdle && s.isComplete && String(s.size) === String(s.wanted));
  const boxOf = () => page.evaluate(() => {
    const { x, y, width, height } = document.getElementById('screen').getBoundingClientRect();
    return { x, y, width, height };
  });
  let box = null;
  for (let tries = 3, [width, height] = [px, px]; tries > 0; tries -= 1) { // the panel and the toolbar take a part of the window
    await rest();
    box = await boxOf();
    if (Math.round(box.width) === px && Math.round(box.height) === px) break;
    [width, height] = [width + px - Math.round(box.width), height + px - Math.round(box.height)];
    await resize(page, { width, height });
  }
  return { box, rest };
}

/** The page of splatd. Returns a record, and `size` of its canvas. */
export async function recordPage(page, url, { move, px, seconds, looksPerSecond }) {
  const { box } = await openAtRest(page, url, px);
  const size = await page.evaluate(() => window.splatd.wanted);
  const moved = moveInPage(page, move, box, WARM + seconds);
  await pause(1000 * WARM);
  await page.evaluate(watch, Math.round(1000 / looksPerSecond / TICK_MS));
  await moved;
  const { cameras, ...record } = await page.evaluate(tell);
  const sent = new Map(cameras.map(([seq, camera]) => [seq, camera]));
  for (const frame of record.frames) Object.assign(frame, { bytes: frame.data && Buffer.from(frame.data, 'base64'), type: TYPES[frame.codec] });
  for (const look of record.looks) {
    look.image = { bytes: Buffer.from(look.image, 'base64'), type: 'image/png', map: look.matrix && homographyOf(look.matrix, look.scale) };
    const frame = record.frames[look.frame];
    look.of = frame ? frame.camera ?? sent.get(frame.seq) : null;
  }
  return { ...record, size };
}

/** Runs in the page: looks at every animation frame, until motion.isOn is false. A look is what is on the screen: the canvas or the warped picture,
 * and above it a frame that fades out. */
function watchEach() {
  const { motion } = window;
  Object.assign(motion, { isOn: true, looks: [], frames: [], shown: '' });
  const layer = document.getElementById('warp');
  const screen = document.getElementById('screen');
  const look = () => {
    if (!motion.isOn) return;
    const { count, warps } = window.splatd;
    const old = document.querySelector('#screen + canvas');
    const opacity = old && layer.hidden ? Number(getComputedStyle(old).opacity) : 0;
    const shown = [count, !layer.hidden && warps, opacity].join(' ');
    const at = performance.now();
    if (shown === motion.shown) {
      motion.looks.push({ at, image: null }); // as the one before
      return;
    }
    motion.shown = shown;
    const canvas = new OffscreenCanvas(screen.width, screen.height);
    const context = canvas.getContext('2d', { alpha: false });
    context.imageSmoothingQuality = 'low';
    context.drawImage(layer.hidden ? screen : layer.lastElementChild, 0, 0, canvas.width, canvas.height);
    context.globalAlpha = opacity;
    if (opacity > 0) context.drawImage(old, 0, 0, canvas.width, canvas.height);
    motion.looks.push({ at, image: canvas.transferToImageBitmap() });
  };
  window.eachFrame(look);
}

/** Runs in the page: what watchEach() saw since the last camera was sent. */
async function tellEach() {
  const { motion } = window;
  motion.isOn = false;
  const [seq, wanted, stopped] = motion.cameras.at(-1);
  const first = Math.max(motion.looks.findLastIndex(({ at }) => at <= stopped), 0);
  const begin = motion.looks.findLastIndex(({ image }, i) => i <= first && image);
  const looks = [];
  for (const { at, image } of motion.looks.slice(begin)) {
    let text = null;
    if (image) {
      const canvas = new OffscreenCanvas(image.width, image.height);
      canvas.getContext('2d', { alpha: false }).drawImage(image, 0, 0);
      const bytes = new Uint8Array(await (await canvas.convertToBlob()).arrayBuffer());
      text = '';
      for (let from = 0; from < bytes.length; from += 32768) text += String.fromCharCode(...bytes.subarray(from, from + 32768));
      text = btoa(text);
      image.close();
    }
    looks.push({ at: at - stopped, image: text });
  }
  return { looks, wanted, seq, stopped, frames: motion.frames.map(({ at, isFinal, seq: of }) => ({ at, isFinal, seq: of })) };
}

/** The page of splatd, as recordStreamStops(). The last look before the stop counts as the look at the stop. */
export async function recordPageStops(page, url, { move, px, stops, moveSeconds, lookMs }) {
  const { box, rest } = await openAtRest(page, url, px);
  const record = { stops: [], size: await page.evaluate(() => window.splatd.wanted) };
  for (let i = 0; i < stops; i += 1) {
    const moved = moveInPage(page, move, box, moveSeconds, i % 2 === 1);
    await pause(1000 * moveSeconds - 100);
    await page.evaluate(watchEach);
    await moved;
    await pause(lookMs);
    const { looks, wanted, seq, stopped, frames } = await page.evaluate(tellEach);
    let image = null;
    for (const look of looks) {
      if (look.image) image = { bytes: Buffer.from(look.image, 'base64'), type: 'image/png' };
      Object.assign(look, { at: Math.max(look.at, 0), image });
    }
    record.stops.push({ looks, wanted, ...arrivals(frames, seq, stopped) });
    await rest();
  }
  return record;
}
