// SPDX-License-Identifier: Apache-2.0
// Debian's Firefox, driven by WebDriver BiDi (https://w3c.github.io/webdriver-bidi/), which it speaks by itself.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { setTimeout } from 'node:timers/promises';
import WebSocket from 'ws';

export const FIREFOX = process.env.SPLATD_FIREFOX ?? '/usr/bin/firefox-esr';
const DEADLINE_MS = 60000;
const POLL_MS = 25;
// No requests of its own.
const PREFERENCES = { 'app.update.disabledForTesting': true, 'browser.shell.checkDefaultBrowser': false, 'datareporting.policy.dataSubmissionEnabled': false,
  'toolkit.telemetry.server': '', 'network.captive-portal-service.enabled': false, 'network.connectivity-service.enabled': false };

/** Starts Firefox. Resolves to {send(method, params), on(event, told), close()}. */
async function start() {
  const profile = mkdtempSync(path.join(tmpdir(), 'splatd-firefox-'));
  writeFileSync(path.join(profile, 'user.js'), Object.entries(PREFERENCES).map(([name, value]) => `user_pref(${JSON.stringify(name)}, ${JSON.stringify(value)});\n`).join(''));
  const child = spawn(FIREFOX, ['--headless', '--no-remote', '--profile', profile, '--remote-debugging-port', '0', 'about:blank'], { stdio: ['ignore', 'ignore', 'pipe'] });
  const ended = new Promise((resolve) => { child.on('close', resolve); });
  const end = async () => {
    child.kill();
    await ended;
    rmSync(profile, { recursive: true, force: true });
  };
  try {
    const address = await new Promise((resolve, reject) => {
      let text = '';
      const late = globalThis.setTimeout(() => reject(new Error(`no address of Firefox: ${text}`)), DEADLINE_MS);
      child.on('error', reject);
      child.stderr.on('data', (data) => {
        text += data;
        const [, found] = /WebDriver BiDi listening on (ws:\S+)/.exec(text) ?? [];
        if (!found) return;
        clearTimeout(late);
        resolve(found);
      });
      ended.then((code) => reject(new Error(`Firefox ended with ${code}: ${text}`)));
    });
    const socket = new WebSocket(`${address}/session`, { perMessageDeflate: false });
    await new Promise((resolve, reject) => {
      socket.on('open', resolve);
      socket.on('error', reject);
    });
    const waiting = new Map();
    const listeners = new Map();
    let count = 0;
    socket.on('message', (data) => {
      const message = JSON.parse(data);
      if (message.type === 'event') listeners.get(message.method)?.(message.params);
      else waiting.get(message.id)?.(message);
    });
    const send = async (method, params = {}) => {
      count += 1;
      const id = count;
      const answer = new Promise((resolve) => { waiting.set(id, resolve); });
      socket.send(JSON.stringify({ id, method, params }));
      const { type, result, message } = await answer;
      waiting.delete(id);
      if (type === 'error') throw new Error(`${method}: ${message}`);
      return result;
    };
    await send('session.new', { capabilities: {} });
    const close = async () => {
      await send('session.end').catch(() => {});
      socket.close();
      await end();
    };
    return { send, on: (event, told) => listeners.set(event, told), close };
  } catch (error) {
    await end();
    throw error;
  }
}

/**
 * Starts Firefox with one window. Resolves to {open(url), evaluate(text), until(what, text), press(...keys), drag(from, to), touch(from, to),
 * wheel(at, px), shot() → PNG, said, close()}. `text` is JavaScript; evaluate() resolves to its value, passed as JSON. said: errors and
 * warnings of the console.
 */
export async function firefox({ width, height }) {
  const { send, on, close } = await start();
  const { context } = (await send('browsingContext.getTree')).contexts[0];
  const said = [];
  on('log.entryAdded', ({ level, text }) => { if (level === 'error' || level === 'warn') said.push(`${level}: ${text}`); });
  await send('session.subscribe', { events: ['log.entryAdded'], contexts: [context] });
  await send('browsingContext.setViewport', { context, viewport: { width, height } });
  const evaluate = async (text) => {
    const { result, exceptionDetails } = await send('script.evaluate', { expression: `(async () => JSON.stringify(await (${text})) ?? 'null')()`, target: { context }, awaitPromise: true });
    if (exceptionDetails) throw new Error(exceptionDetails.text);
    return JSON.parse(result.value);
  };
  const until = async (what, text) => {
    for (const last = performance.now() + DEADLINE_MS; ; await setTimeout(POLL_MS)) {
      const value = await evaluate(text);
      if (value) return value;
      assert.ok(performance.now() < last, `${what}: not reached`);
    }
  };
  const act = (...actions) => send('input.performActions', { context, actions });
  const pull = (pointerType, [x0, y0], [x1, y1]) => {
    const at = (share) => ({ type: 'pointerMove', x: Math.round(x0 + (x1 - x0) * share), y: Math.round(y0 + (y1 - y0) * share), duration: 0 });
    const way = [1, 2, 3, 4, 5].map((step) => at(step / 5));
    return act({ type: 'pointer', id: pointerType, parameters: { pointerType }, actions: [at(0), { type: 'pointerDown', button: 0 }, ...way, { type: 'pointerUp', button: 0 }] });
  };
  return {
    said, evaluate, until, close,
    open: (url) => send('browsingContext.navigate', { context, url, wait: 'complete' }),
    press: (...keys) => act({ type: 'key', id: 'keys', actions: keys.flatMap((value) => [{ type: 'keyDown', value }, { type: 'keyUp', value }]) }),
    drag: (from, to) => pull('mouse', from, to),
    touch: (from, to) => pull('touch', from, to),
    wheel: ([x, y], deltaY) => act({ type: 'wheel', id: 'wheel', actions: [{ type: 'scroll', x, y, deltaX: 0, deltaY }] }),
    shot: async () => Buffer.from((await send('browsingContext.captureScreenshot', { context })).data, 'base64'),
  };
}
