// SPDX-License-Identifier: Apache-2.0
// The real daemon as a child process on the loopback address.
import { spawn } from 'node:child_process';
import { randomBytes } from 'node:crypto';
import { mkdtempSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import path from 'node:path';
import { fileURLToPath } from 'node:url';

const DEADLINE_MS = 60000;

export const BIN = process.env.SPLATD_BIN_DIR ?? fileURLToPath(new URL('../../../build/release/bin', import.meta.url));
export const DATA = process.env.SPLATD_DATA_DIR ?? fileURLToPath(new URL('../../../../shared/data', import.meta.url));

/** Creates a token in a file, so that a restarted daemon has the same token. remove() deletes the file. */
export function tokenFile() {
  const folder = mkdtempSync(path.join(tmpdir(), 'splatd-web-'));
  const file = path.join(folder, 'token');
  const text = randomBytes(24).toString('hex');
  writeFileSync(file, `${text}\n`, { mode: 0o600 });
  return { file, text, remove: () => rmSync(folder, { recursive: true }) };
}

/**
 * Starts splatd with a token of tokenFile() or with a generated one. Resolves once it listens, to {url (with the token), port,
 * stop()}. stop() resolves to the exit status.
 */
export async function startDaemon(args, { port = 0, token = null } = {}) {
  const all = ['--listen', `127.0.0.1:${port}`, ...(token ? ['--token-file', token.file] : []), ...args];
  const child = spawn(path.join(BIN, 'splatd'), all, { stdio: ['ignore', 'pipe', 'pipe'] });
  let log = '';
  child.stderr.on('data', (data) => { log = (log + data).slice(-20000); });
  const ended = new Promise((resolve) => { child.on('close', (code, signal) => resolve(code ?? signal)); });
  let late = null;
  const printed = await new Promise((resolve, reject) => {
    let text = '';
    late = setTimeout(() => {
      child.kill('SIGKILL');
      reject(new Error(`splatd did not listen within ${DEADLINE_MS} ms:\n${log}`));
    }, DEADLINE_MS);
    child.on('error', reject);
    ended.then((status) => reject(new Error(`splatd ended with ${status}:\n${log}`)));
    child.stdout.on('data', (data) => {
      text += data;
      const [, found] = /listening on (\S+)\n/.exec(text) ?? [];
      if (found) resolve(found);
    });
  }).finally(() => clearTimeout(late));
  const url = token ? `${printed}?token=${token.text}` : printed;
  return {
    url, port: Number(new URL(url).port),
    get log() { return log; },
    async stop(signal = 'SIGTERM') {
      child.kill(signal);
      const killTimer = setTimeout(() => child.kill('SIGKILL'), DEADLINE_MS);
      const status = await ended;
      clearTimeout(killTimer);
      return status;
    },
  };
}
